//! End walls: the west front with its rose and portal, and the transepts' great windows.

use super::furniture::door;
use super::plan::{
    AISLE, HALF, HIGH_SPRING, LOW_RISE, LOW_SPRING, WALL, WALL_TOP, WEST, rectangle,
};
use super::walls::{aisle_window, bench, string_course};
use super::windows::{Rose, Tracery, Window};
use crate::arch::Arch;
use crate::materials::Material;
use crate::mesh::{Mesh, at, upright};
use crate::polygon::panel;
use crate::sweep::{arc, arch_band, xy};
use glam::{DVec2, DVec3};

fn moved(hole: &[DVec2], by: DVec2) -> Vec<DVec2> {
    hole.iter().map(|p| *p + by).collect()
}

/// The west front in world coordinates.
pub(super) fn front() -> Mesh {
    let mut mesh = Mesh::default();
    // Facing east, seen from inside: right is towards −z.
    let place = |z: f64| upright(DVec3::new(WEST, 0.0, z), DVec2::NEG_Y);
    mesh.append(&nave_end(), &place(0.0));
    let aisle = aisle_end();
    for side in [-1.0, 1.0] {
        mesh.append(&aisle, &place(side * (HALF + WALL + AISLE / 2.0)));
    }
    mesh
}

fn nave_end() -> Mesh {
    let rose = Rose {
        radius: 1.65,
        splay: 0.5,
        depth: 0.55,
    };
    let rose_at = xy(0.0, 10.4);
    let portal = Arch::round(1.15);
    let spring = 2.7;
    let outer = portal.offset(0.5);
    let hole = moved(&outer.opening(14, spring + 0.05), xy(0.0, spring));
    let half = HALF + WALL;
    let outline = rectangle(xy(-half, -0.1), xy(half, WALL_TOP));
    let mut mesh = panel(
        Material::Ashlar,
        &outline,
        &[moved(&rose.hole(), rose_at), hole],
    );
    mesh.append(&rose.mesh(), &at(rose_at.x, rose_at.y, 0.0));
    // Three receding orders, the door and a plain tympanum.
    let mut profile = vec![xy(0.5, 0.0)];
    for k in 0..3 {
        let (r, z) = (0.5 - 0.165 * f64::from(k), -0.18 * f64::from(k));
        profile.extend(arc(xy(r - 0.07, z - 0.02), 0.05, 90.0, 240.0, 3));
        profile.extend([xy(r - 0.10, z - 0.18), xy(r - 0.165, z - 0.18)]);
    }
    profile.extend([xy(0.0, -0.54), xy(0.0, -0.8)]);
    let band = arch_band(Material::Limestone, portal, spring + 0.05, &profile, 14);
    mesh.append(&band, &at(0.0, spring, 0.0));
    let back = portal.offset(0.1).opening(14, spring + 0.05);
    mesh.append(
        &panel(Material::Limestone, &back, &[]),
        &at(0.0, spring, -0.78),
    );
    mesh.append(&door(1.16, spring - 0.06), &at(0.0, 0.0, -0.68));
    mesh.block(
        Material::Limestone,
        DVec3::new(-1.2, spring - 0.08, -0.79),
        DVec3::new(1.2, spring + 0.2, -0.6),
        0.03,
    );
    let mut string = string_course(2.0 * HALF, 7.05);
    string.merge(string_course(2.0 * HALF, HIGH_SPRING - 1.2));
    mesh.merge(string);
    mesh
}

fn aisle_end() -> Mesh {
    let window = aisle_window();
    let window_at = xy(0.0, 4.55);
    let half = AISLE / 2.0 + 0.1;
    let outline = rectangle(xy(-half, -0.1), xy(half, LOW_SPRING + LOW_RISE + 0.6));
    let mut mesh = panel(
        Material::Ashlar,
        &outline,
        &[moved(&window.hole(), window_at)],
    );
    mesh.append(&window.mesh(), &at(window_at.x, window_at.y, 0.0));
    mesh.merge(string_course(AISLE, 1.95));
    mesh
}

/// End wall of a transept: a three-light window over a string course and a bench.
pub(super) fn transept_end() -> Mesh {
    let window = Window {
        arch: Arch::pointed(1.5, 2.15),
        drop: 2.9,
        splay: 0.45,
        depth: 0.6,
        tracery: Tracery::ThreeLights,
    };
    let window_at = xy(0.0, 8.6);
    let half = HALF + 0.1;
    let outline = rectangle(xy(-half, -0.1), xy(half, WALL_TOP));
    let mut mesh = panel(
        Material::Ashlar,
        &outline,
        &[moved(&window.hole(), window_at)],
    );
    mesh.append(&window.mesh(), &at(window_at.x, window_at.y, 0.0));
    mesh.merge(string_course(2.0 * HALF, 4.4));
    mesh.merge(bench(2.0 * HALF));
    // A row of blind arches under the string course.
    let arch = Arch::pointed(0.5, 0.68);
    for k in 0..5 {
        let x = (f64::from(k) - 2.0) * 1.32;
        let mut profile = vec![xy(0.0, -0.02), xy(0.0, 0.06)];
        profile.extend(arc(xy(0.05, 0.07), 0.05, 180.0, 0.0, 3));
        profile.extend([xy(0.13, 0.03), xy(0.14, -0.02)]);
        mesh.append(
            &arch_band(Material::Limestone, arch, 1.9, &profile, 6),
            &at(x, 2.5, 0.0),
        );
    }
    mesh
}
