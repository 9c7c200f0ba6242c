//! Ribbed cross vaults.
//!
//! Both barrels of a bay have the same pointed profile stretched to their widths, so they meet
//! over the diagonals of the bay, where the ribs are. The crown is slightly domed.

use crate::arch::Arch;
use crate::materials::Material;
use crate::mesh::Mesh;
use crate::sweep::{arc, lathe, rib, xy};
use glam::{DAffine3, DVec2, DVec3};

/// A vault over a bay centred on the y axis, springing at y = 0.
#[derive(Clone, Copy)]
pub(super) struct Vault {
    /// Half the bay along x.
    pub(super) half_x: f64,
    /// Half the bay along z.
    pub(super) half_z: f64,
    /// Height of the edge arches' apex.
    pub(super) rise: f64,
    /// Steps from the crown to each edge.
    pub(super) steps: usize,
}

impl Vault {
    /// The profile over half a width: (fraction of the half width, fraction of the rise) from
    /// crown to springing.
    fn profile(self) -> Vec<DVec2> {
        let ratio = (self.rise / self.half_x.max(self.half_z)).max(1.0);
        let mut points = Arch::pointed(1.0, ratio).right(self.steps);
        points.reverse();
        points.iter().map(|p| xy(p.x, p.y / ratio)).collect()
    }

    /// Extra height towards the crown; zero on all four edges.
    fn crown(u: f64, v: f64) -> f64 {
        0.35 * (1.0 - u * u) * (1.0 - v * v)
    }

    /// Webs, diagonal ribs, wall ribs along z = ±`half_z` and the boss.
    pub(super) fn mesh(self) -> Mesh {
        let mut mesh = self.webs();
        let profile = self.profile();
        let both = |make: &dyn Fn(f64, f64) -> DVec3| {
            let left = profile.iter().rev().map(|p| make(-p.x, p.y));
            let right = profile.iter().skip(1).map(|p| make(p.x, p.y));
            left.chain(right).collect::<Vec<_>>()
        };
        for s in [-1.0, 1.0] {
            let diagonal = both(&|t, h| {
                let y = h * self.rise + Self::crown(t, t);
                DVec3::new(t * self.half_x, y, s * t * self.half_z)
            });
            let side = DVec3::new(-s * self.half_z, 0.0, self.half_x).normalize();
            mesh.merge(rib(
                Material::Limestone,
                &diagonal,
                side,
                &diagonal_profile(),
            ));
            let wall = both(&|t, h| DVec3::new(t * self.half_x, h * self.rise, s * self.half_z));
            mesh.merge(rib(Material::Limestone, &wall, DVec3::Z, &wall_profile()));
        }
        mesh.append(
            &boss(),
            &crate::mesh::at(0.0, self.rise + Self::crown(0.0, 0.0), 0.0),
        );
        mesh
    }

    /// One quarter of the webs, mirrored three times; smoothed apart to keep the ridges.
    fn webs(self) -> Mesh {
        let profile = self.profile();
        let mut along = vec![0.0];
        for pair in profile.windows(2) {
            let width = self.half_x.max(self.half_z);
            let step = xy(width, self.rise) * (pair[1] - pair[0]);
            along.push(along[along.len() - 1] + step.length());
        }
        let mut quarter = Mesh::default();
        // Cell 0 curves along z, cell 1 along x; each is the triangle between ridge and groin.
        for cell in 0..2 {
            let mut half = Mesh::default();
            let vertex = |outer: usize, inner: usize| {
                let (s, t) = (profile[outer].x, profile[inner]);
                let (u, v) = if cell == 0 { (s, t.x) } else { (t.x, s) };
                let y = t.y * self.rise + Self::crown(u, v);
                let ridge = s * if cell == 0 { self.half_x } else { self.half_z };
                (
                    DVec3::new(u * self.half_x, y, v * self.half_z),
                    xy(ridge, along[inner]),
                )
            };
            for outer in 1..=self.steps {
                let row = |o: usize| (0..=outer).map(|i| vertex(o, i.min(o))).collect::<Vec<_>>();
                let rows = [row(outer - 1), row(outer)];
                let rows = if cell == 0 {
                    rows
                } else {
                    [rows[1].clone(), rows[0].clone()]
                };
                half.grid_uv(Material::Web, &rows);
            }
            quarter.merge(half);
        }
        let quarter = quarter.smooth(35.0);
        let mut mesh = Mesh::default();
        for (x, z) in [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
            mesh.append(&quarter, &DAffine3::from_scale(DVec3::new(x, 1.0, z)));
        }
        mesh
    }

    /// Transverse rib over z at x = 0, to stand between two bays.
    pub(super) fn transverse(self) -> Mesh {
        let profile = self.profile();
        let point = |z: f64, p: &DVec2| DVec3::new(0.0, p.y * self.rise, z * p.x * self.half_z);
        let left = profile.iter().rev().map(|p| point(-1.0, p));
        let right = profile.iter().skip(1).map(|p| point(1.0, p));
        let curve: Vec<DVec3> = left.chain(right).collect();
        rib(Material::Limestone, &curve, DVec3::X, &transverse_profile())
    }
}

/// Fillets and a roll; starts and ends inside the web.
fn diagonal_profile() -> Vec<DVec2> {
    let mut points = vec![xy(-0.12, -0.12), xy(-0.12, 0.06)];
    points.extend(arc(xy(0.0, 0.13), 0.08, 170.0, 10.0, 3));
    points.extend([xy(0.12, 0.06), xy(0.12, -0.12)]);
    points
}

fn wall_profile() -> Vec<DVec2> {
    vec![
        xy(-0.13, -0.12),
        xy(-0.11, 0.07),
        xy(0.11, 0.07),
        xy(0.13, -0.12),
    ]
}

/// Broad soffit between two rolls.
fn transverse_profile() -> Vec<DVec2> {
    let mut points = vec![xy(-0.26, -0.15), xy(-0.26, 0.08)];
    points.extend(arc(xy(-0.2, 0.10), 0.06, 180.0, 20.0, 3));
    points.extend([xy(-0.13, 0.09), xy(-0.13, 0.19), xy(-0.10, 0.22)]);
    let mirrored: Vec<DVec2> = points.iter().rev().map(|p| xy(-p.x, p.y)).collect();
    points.extend(mirrored);
    points
}

/// Keystone with a carved rosette.
fn boss() -> Mesh {
    let profile = [
        xy(0.26, 0.1),
        xy(0.26, -0.16),
        xy(0.24, -0.20),
        xy(0.20, -0.20),
        xy(0.18, -0.17),
        xy(0.14, -0.19),
        xy(0.09, -0.25),
        xy(0.0, -0.27),
    ];
    lathe(Material::Limestone, &profile, 14)
}
