//! A soup of triangles under construction: placing, mirroring and smoothing parts.
//!
//! Parts are built in their own frame and appended where they stand, so one pier serves a whole
//! arcade. Normals come from [`Mesh::smooth`], texture coordinates from the part or, where it
//! gives none, from a box projection in world metres when the file is written.

use crate::materials::Material;
use glam::{DAffine3, DMat3, DVec2, DVec3};
use std::collections::HashMap;

/// One triangle; `normals` is `None` where the surface is flat, `uv` where it is box-mapped.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triangle {
    pub(crate) material: Material,
    pub(crate) points: [DVec3; 3],
    pub(crate) normals: Option<[DVec3; 3]>,
    pub(crate) uv: Option<[DVec2; 3]>,
}

impl Triangle {
    /// Twice the area times the unit normal of the winding.
    pub(crate) fn cross(&self) -> DVec3 {
        let [a, b, c] = self.points;
        (b - a).cross(c - a)
    }
}

/// Triangles of one part or of the whole building.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mesh {
    pub(crate) triangles: Vec<Triangle>,
}

impl Mesh {
    /// Adds a triangle unless it has no area (the tip of a fan, the pole of a dome).
    pub(crate) fn triangle(&mut self, material: Material, points: [DVec3; 3]) {
        self.push(Triangle {
            material,
            points,
            normals: None,
            uv: None,
        });
    }

    fn push(&mut self, triangle: Triangle) {
        if triangle.cross().length_squared() > 1e-14 {
            self.triangles.push(triangle);
        }
    }

    /// Adds a quadrilateral as two triangles, cut along its shorter diagonal.
    pub(crate) fn quad(&mut self, material: Material, [a, b, c, d]: [DVec3; 4]) {
        if a.distance_squared(c) <= b.distance_squared(d) + 1e-9 {
            self.triangle(material, [a, b, c]);
            self.triangle(material, [a, c, d]);
        } else {
            self.triangle(material, [a, b, d]);
            self.triangle(material, [b, c, d]);
        }
    }

    /// Adds the quadrilaterals between successive `rows` of equal length.
    pub(crate) fn grid(&mut self, material: Material, rows: &[Vec<DVec3>]) {
        for pair in rows.windows(2) {
            for i in 1..pair[0].len() {
                self.quad(
                    material,
                    [pair[0][i - 1], pair[0][i], pair[1][i], pair[1][i - 1]],
                );
            }
        }
    }

    /// [`Mesh::grid`] whose points carry texture coordinates of their own.
    pub(crate) fn grid_uv(&mut self, material: Material, rows: &[Vec<(DVec3, DVec2)>]) {
        for pair in rows.windows(2) {
            for i in 1..pair[0].len() {
                let [a, b, c, d] = [pair[0][i - 1], pair[0][i], pair[1][i], pair[1][i - 1]];
                for t in [[a, b, c], [a, c, d]] {
                    self.push(Triangle {
                        material,
                        points: t.map(|v| v.0),
                        normals: None,
                        uv: Some(t.map(|v| v.1)),
                    });
                }
            }
        }
    }

    /// Adds an axis-aligned block whose edges are bevelled by `bevel` metres (0 for sharp ones).
    pub(crate) fn block(&mut self, material: Material, min: DVec3, max: DVec3, bevel: f64) {
        let (centre, half) = ((min + max) / 2.0, (max - min) / 2.0);
        let inner = half - bevel;
        // A corner of face `axis`: pulled in by the bevel along the two other axes.
        let corner = |axis: usize, signs: DVec3| {
            let mut at = inner;
            at[axis] = half[axis];
            centre + at * signs
        };
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for side in [-1.0, 1.0] {
                let sign = |su: f64, sv: f64| {
                    let mut s = DVec3::ONE;
                    (s[axis], s[u], s[v]) = (side, su, sv);
                    s
                };
                let face = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
                self.quad(material, face.map(|(su, sv)| corner(axis, sign(su, sv))));
                if bevel > 0.0 {
                    // The edge shared with face `u`, and one third of every corner's triangle.
                    for su in [-1.0, 1.0] {
                        let (lo, hi) = (sign(su, -1.0), sign(su, 1.0));
                        self.quad(
                            material,
                            [
                                corner(axis, lo),
                                corner(axis, hi),
                                corner(u, hi),
                                corner(u, lo),
                            ],
                        );
                        if axis == 0 {
                            for s in [lo, hi] {
                                self.triangle(material, [corner(0, s), corner(1, s), corner(2, s)]);
                            }
                        }
                    }
                }
            }
        }
    }

    /// Adds a copy of `part` standing at `place`; a mirroring keeps the winding's side.
    pub(crate) fn append(&mut self, part: &Mesh, place: &DAffine3) {
        // All placements are rotations or mirrorings, so the matrix carries normals as it is.
        let mirrored = place.matrix3.determinant() < 0.0;
        self.triangles.extend(part.triangles.iter().map(|t| {
            let mut points = t.points.map(|p| place.transform_point3(p));
            let mut normals = t.normals.map(|n| n.map(|n| place.matrix3 * n));
            let mut uv = t.uv;
            if mirrored {
                points.swap(1, 2);
                if let Some(n) = &mut normals {
                    n.swap(1, 2);
                }
                if let Some(uv) = &mut uv {
                    uv.swap(1, 2);
                }
            }
            Triangle {
                material: t.material,
                points,
                normals,
                uv,
            }
        }));
    }

    /// Adds `part` where it is.
    pub(crate) fn merge(&mut self, part: Mesh) {
        self.triangles.extend(part.triangles);
    }

    /// Drops the triangles that lie wholly where `buried` holds: inside a wall, out of sight.
    pub(crate) fn bury(&mut self, buried: impl Fn(DVec3) -> bool) {
        self.triangles
            .retain(|t| !t.points.iter().all(|&p| buried(p)));
    }

    /// Adds `part` and its mirror image across the plane x = 0 of its frame.
    pub(crate) fn append_with_mirror_x(&mut self, part: &Mesh, place: &DAffine3) {
        self.append(part, place);
        let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        self.append(part, &(*place * mirror));
    }

    /// Gives curved surfaces shared normals: at every point the faces within `crease_degrees` of
    /// a face are averaged by area. Faces whose normals all agree stay flat.
    ///
    /// The part must be wound consistently; parts smoothed apart keep the crease between them.
    #[must_use]
    pub(crate) fn smooth(mut self, crease_degrees: f64) -> Mesh {
        let least_cosine = crate::trig::direction(crate::trig::degrees(crease_degrees)).x;
        let key = |p: DVec3| (p * 1e5).round().as_i64vec3().to_array();
        let mut around: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        for (index, t) in self.triangles.iter().enumerate() {
            for p in t.points {
                around.entry(key(p)).or_default().push(index);
            }
        }
        let crosses: Vec<DVec3> = self.triangles.iter().map(Triangle::cross).collect();
        let units: Vec<DVec3> = crosses.iter().map(|c| c.normalize()).collect();
        for (index, t) in self.triangles.iter_mut().enumerate() {
            let normals = t.points.map(|p| {
                let faces = around[&key(p)].iter();
                let near = faces.filter(|&&f| units[f].dot(units[index]) >= least_cosine);
                near.map(|&f| crosses[f]).sum::<DVec3>().normalize()
            });
            let flat = normals.iter().all(|n| n.dot(units[index]) > 1.0 - 1e-6);
            let bent = normals.iter().any(|n| n.dot(units[index]) < 0.2);
            t.normals = if flat || bent { None } else { Some(normals) };
        }
        self
    }
}

/// Placement at `origin` with local x along `right`, y along `up` and z along `right × up`.
pub(crate) fn frame(origin: DVec3, right: DVec3, up: DVec3) -> DAffine3 {
    DAffine3::from_mat3_translation(DMat3::from_cols(right, up, right.cross(up)), origin)
}

/// Placement at `origin` turned about the vertical so that local x points along (`x`, `z`).
pub(crate) fn upright(origin: DVec3, right: DVec2) -> DAffine3 {
    frame(origin, DVec3::new(right.x, 0.0, right.y), DVec3::Y)
}

/// Placement at `origin` without turning.
pub(crate) fn at(x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(x, y, z))
}
