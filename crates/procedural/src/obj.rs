//! The OBJ file: shared vertices, box-mapped textures, one group per kind of face.

use crate::materials::{LOOKS, Material, look};
use crate::mesh::{Mesh, Triangle};
use glam::{DVec2, DVec3};
use std::collections::HashMap;

/// Positions are written in tenths of a millimetre, texture coordinates likewise.
const STEPS: f64 = 1e4;

/// What a group of faces carries besides positions; every group is uniform.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Carries {
    uv: bool,
    normals: bool,
}

/// Writes `mesh` as OBJ text with `mtllib` `library`.
///
/// Triangles that have no area after rounding are left out: they lie in an edge of their
/// neighbours.
pub(crate) fn write(mesh: &Mesh, library: &str) -> Vec<u8> {
    let mut vertices = Pool::default();
    let mut uvs = Pool::default();
    let mut normals = Pool::default();
    let mut faces = String::with_capacity(mesh.triangles.len() * 40);
    for wanted in groups(mesh) {
        faces.push_str("usemtl ");
        faces.push_str(look(wanted.material).name);
        faces.push('\n');
        for t in &wanted.triangles {
            let points = t.points.map(|p| fixed(p, STEPS));
            if flat(points) {
                continue;
            }
            faces.push('f');
            let mapped = wanted.carries.uv.then(|| texture_coordinates(t));
            for (k, point) in points.into_iter().enumerate() {
                faces.push(' ');
                push_int(&mut faces, vertices.index(point));
                if let Some(uv) = mapped {
                    faces.push('/');
                    push_int(&mut faces, uvs.index(fixed(uv[k].extend(0.0), STEPS)));
                }
                if let Some(n) = t.normals {
                    faces.push_str(if mapped.is_some() { "/" } else { "//" });
                    push_int(&mut faces, normals.index(fixed(n[k], STEPS)));
                }
            }
            faces.push('\n');
        }
    }
    let mut text = format!("mtllib {library}\n");
    vertices.write(&mut text, "v", 3);
    uvs.write(&mut text, "vt", 2);
    normals.write(&mut text, "vn", 3);
    text.push_str(&faces);
    text.into_bytes()
}

struct Group<'a> {
    material: Material,
    carries: Carries,
    triangles: Vec<&'a Triangle>,
}

fn groups(mesh: &Mesh) -> Vec<Group<'_>> {
    let mut groups: Vec<Group> = LOOKS
        .iter()
        .flat_map(|look| {
            [false, true].map(|normals| Group {
                material: look.material,
                carries: Carries {
                    uv: look.texture.is_some(),
                    normals,
                },
                triangles: Vec::new(),
            })
        })
        .collect();
    for t in &mesh.triangles {
        let at = 2 * t.material as usize + usize::from(t.normals.is_some());
        groups[at].triangles.push(t);
    }
    groups.retain(|g| !g.triangles.is_empty());
    debug_assert!(
        groups.iter().all(|g| g
            .triangles
            .iter()
            .all(|t| t.normals.is_some() == g.carries.normals)),
        "groups are uniform"
    );
    groups
}

/// The triangle's own coordinates, or world metres seen along the axis it faces most.
fn texture_coordinates(t: &Triangle) -> [DVec2; 3] {
    let metres = look(t.material)
        .texture
        .map_or(1.0, |texture| texture.metres);
    let metric = t.uv.unwrap_or_else(|| {
        let n = t.cross().abs();
        t.points.map(|p| {
            // Ties go to the floor plan, so that rounding cannot flip them.
            if n.y + 1e-9 >= n.x && n.y + 1e-9 >= n.z {
                DVec2::new(p.x, p.z)
            } else if n.x > n.z + 1e-9 {
                DVec2::new(p.z, p.y)
            } else {
                DVec2::new(p.x, p.y)
            }
        })
    });
    metric.map(|uv| uv / metres)
}

fn fixed(v: DVec3, steps: f64) -> [i64; 3] {
    (v * steps).round().as_i64vec3().to_array()
}

/// Exact test: the rounded corners lie on one line.
fn flat([a, b, c]: [[i64; 3]; 3]) -> bool {
    let [u, v] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
    u[1] * v[2] == u[2] * v[1] && u[2] * v[0] == u[0] * v[2] && u[0] * v[1] == u[1] * v[0]
}

/// Distinct rounded vectors in order of first use, numbered from 1 as OBJ does.
#[derive(Default)]
struct Pool {
    index: HashMap<[i64; 3], usize>,
    values: Vec<[i64; 3]>,
}

impl Pool {
    fn index(&mut self, value: [i64; 3]) -> usize {
        *self.index.entry(value).or_insert_with(|| {
            self.values.push(value);
            self.values.len()
        })
    }

    fn write(&self, text: &mut String, keyword: &str, components: usize) {
        for value in &self.values {
            text.push_str(keyword);
            for &component in &value[..components] {
                text.push(' ');
                push_fixed(text, component);
            }
            text.push('\n');
        }
    }
}

fn push_int(text: &mut String, value: usize) {
    if value >= 10 {
        push_int(text, value / 10);
    }
    text.push(char::from(b'0' + (value % 10) as u8));
}

/// Decimal fraction of `value` / 10⁴ without trailing zeros.
fn push_fixed(text: &mut String, value: i64) {
    if value < 0 {
        text.push('-');
    }
    let magnitude = value.unsigned_abs() as usize;
    push_int(text, magnitude / 10_000);
    let mut rest = magnitude % 10_000;
    if rest > 0 {
        text.push('.');
        let mut unit = 1000;
        while rest > 0 {
            text.push(char::from(b'0' + (rest / unit) as u8));
            rest %= unit;
            unit /= 10;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_are_short_and_exact() {
        let written = |value| {
            let mut text = String::new();
            push_fixed(&mut text, value);
            text
        };
        assert_eq!(written(0), "0");
        assert_eq!(written(-12_345), "-1.2345");
        assert_eq!(written(10_050), "1.005");
        assert_eq!(written(-20_000), "-2");
    }
}
