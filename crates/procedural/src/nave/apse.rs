//! The apse: five sides of a decagon with tall windows under a ribbed half dome.
//!
//! Frame: the middle of the apse's chord on the choir floor level y = 0, x eastwards.

use super::columns::{Seen, shaft};
use super::plan::{CHOIR_FLOOR, HALF, HIGH_SPRING, rectangle};
use super::walls::string_course;
use super::windows::{Tracery, Window};
use crate::arch::Arch;
use crate::materials::Material;
use crate::mesh::{Mesh, at, upright};
use crate::polygon::panel;
use crate::sweep::{arc, lathe, rib, xy};
use crate::trig::{degrees, direction};
use glam::{DVec2, DVec3};

const SIDES: usize = 5;
const STEPS: usize = 12;

/// Direction of corner `k` (0 to 5), from −z round the east to +z.
fn corner(k: usize) -> DVec2 {
    direction(degrees(-90.0 + 180.0 * k as f64 / SIDES as f64))
}

/// Walls, windows, shafts and vault.
pub(super) fn apse() -> Mesh {
    let mut mesh = Mesh::default();
    let half_angle = direction(degrees(90.0 / SIDES as f64));
    let side = side_wall(HALF * half_angle.y);
    for k in 0..SIDES {
        let out = (corner(k) + corner(k + 1)).normalize();
        let middle = out * (HALF * half_angle.x);
        mesh.append(
            &side,
            &upright(DVec3::new(middle.x, 0.0, middle.y), xy(-out.y, out.x)),
        );
    }
    let support = shaft(0.13, CHOIR_FLOOR, HIGH_SPRING, Seen::Front);
    for k in 1..SIDES {
        let p = corner(k) * (HALF - 0.06);
        mesh.append(
            &support,
            &upright(DVec3::new(p.x, 0.0, p.y), corner(k).perp()),
        );
    }
    mesh.append(&half_dome(), &at(0.0, HIGH_SPRING, 0.0));
    mesh
}

fn side_wall(half: f64) -> Mesh {
    let window = Window {
        arch: Arch::pointed(0.62, 0.9),
        drop: 3.5,
        splay: 0.18,
        depth: 0.4,
        tracery: Tracery::TwoLights,
    };
    let spring = 7.3;
    let hole: Vec<DVec2> = window.hole().iter().map(|p| *p + xy(0.0, spring)).collect();
    let wall = rectangle(xy(-half, 0.0), xy(half, HIGH_SPRING + 0.3));
    let mut mesh = panel(Material::Ashlar, &wall, &[hole]);
    mesh.append(&window.mesh(), &at(0.0, spring, 0.0));
    mesh.merge(string_course(2.0 * half, 3.35));
    mesh.merge(string_course(2.0 * half, HIGH_SPRING - 0.02));
    // Blind arcade of the dado.
    let arch = Arch::pointed(0.36, 0.5);
    for x in [-0.5, 0.5] {
        let mut profile = vec![xy(0.0, -0.02), xy(0.0, 0.05)];
        profile.extend(arc(xy(0.045, 0.06), 0.045, 180.0, 0.0, 3));
        profile.extend([xy(0.1, 0.03), xy(0.1, -0.02)]);
        let band = crate::sweep::arch_band(Material::Limestone, arch, 1.35, &profile, 6);
        mesh.append(&band, &at(x, CHOIR_FLOOR + 1.45, 0.0));
    }
    mesh
}

/// Five webs between six ribs that meet in a boss over the chord.
fn half_dome() -> Mesh {
    let mut mesh = Mesh::default();
    let rib_curve = |k: usize| {
        let out = corner(k);
        (0..=STEPS)
            .map(|j| {
                let p = direction(degrees(90.0 * j as f64 / STEPS as f64)) * HALF;
                DVec3::new(out.x * p.x, p.y, out.y * p.x)
            })
            .collect::<Vec<_>>()
    };
    let mut profile = vec![xy(-0.11, -0.1), xy(-0.11, 0.05)];
    profile.extend(arc(xy(0.0, 0.10), 0.085, 180.0, 0.0, 4));
    profile.extend([xy(0.11, 0.05), xy(0.11, -0.1)]);
    for k in 0..SIDES {
        let (from, to) = (rib_curve(k), rib_curve(k + 1));
        let mut web = Mesh::default();
        let rows: Vec<Vec<(DVec3, DVec2)>> = (0..=STEPS)
            .map(|j| {
                (0..=4)
                    .map(|i| {
                        let p = from[j].lerp(to[j], f64::from(i) / 4.0);
                        let across = (f64::from(i) / 4.0 - 0.5) * from[j].distance(to[j]);
                        (
                            p,
                            xy(across, HALF * degrees(90.0 * j as f64 / STEPS as f64)),
                        )
                    })
                    .collect()
            })
            .collect();
        web.grid_uv(Material::Web, &rows);
        mesh.merge(web.smooth(35.0));
        if k > 0 {
            let out = corner(k);
            mesh.merge(rib(
                Material::Limestone,
                &from,
                DVec3::new(-out.y, 0.0, out.x),
                &profile,
            ));
        }
    }
    let boss = [
        xy(0.34, 0.1),
        xy(0.34, -0.2),
        xy(0.30, -0.26),
        xy(0.2, -0.26),
        xy(0.1, -0.34),
        xy(0.0, -0.35),
    ];
    mesh.append(&lathe(Material::Limestone, &boss, 20), &at(0.12, HALF, 0.0));
    mesh
}
