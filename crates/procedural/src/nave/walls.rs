//! The high wall of a bay: arcade, gallery, string courses and clerestory; the aisle's outer wall.
//!
//! Frames: x along the wall, y up from the floor, z into the room; the room-side face is z = 0.

use super::columns::colonnette;
use super::plan::{
    ARCADE_ORDERS, ARCH_STEPS, HIGH_SPRING, LOW_SPRING, STRING, WALL, WALL_TOP, arcade, rectangle,
};
use super::windows::{Tracery, Window};
use crate::arch::Arch;
use crate::materials::Material;
use crate::mesh::{Mesh, at};
use crate::polygon::panel;
use crate::sweep::{Path, arc, arch_band, mould, sleeve, xy};
use glam::{DVec2, DVec3};

/// What lies behind the arch of a bay.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Behind {
    /// An aisle; the arch goes through.
    Aisle,
    /// A shallow chapel closed by a wall.
    Niche,
}

/// The whole bay of the high wall, `length` long and centred on x = 0, without piers.
pub(super) fn high_bay(length: f64, behind: Behind) -> Mesh {
    let arch = arcade(length);
    let window = clerestory();
    let window_at = xy(0.0, HIGH_SPRING + 1.55);
    let gallery = Gallery::within(length);
    let mut holes = gallery.holes();
    holes.push(window.hole().iter().map(|p| *p + window_at).collect());
    let mut mesh = panel(Material::Ashlar, &notched(length, arch, WALL_TOP), &holes);
    mesh.append(&window.mesh(), &at(window_at.x, window_at.y, 0.0));
    mesh.merge(gallery.mesh());
    mesh.append(&arcade_orders(arch), &at(0.0, LOW_SPRING, 0.0));
    mesh.merge(string_course(length, STRING));
    mesh.merge(string_course(length, gallery.top + 0.28));
    let back = match behind {
        Behind::Aisle => panel(Material::Ashlar, &notched(length, arch, STRING + 0.3), &[]),
        Behind::Niche => {
            let low = xy(-length / 2.0, 0.0);
            let high = xy(length / 2.0, LOW_SPRING + arch.rise() + 0.3);
            panel(Material::Ashlar, &rectangle(low, high), &[])
        }
    };
    mesh.append(&back, &at(0.0, 0.0, -WALL));
    if behind == Behind::Niche {
        mesh.merge(jambs(length, arch));
    }
    mesh
}

/// Panel outline from the springing to `top`, its lower edge cut by the arch's outer order.
fn notched(length: f64, arch: Arch, top: f64) -> Vec<DVec2> {
    let half = length / 2.0;
    // Two centimetres lower than the abaci, to stand in them.
    let mut points = vec![xy(half, LOW_SPRING - 0.02), xy(half, top), xy(-half, top)];
    points.push(xy(-half, LOW_SPRING - 0.02));
    let outer = arch.offset(ARCADE_ORDERS);
    points.push(xy(-outer.half_span, LOW_SPRING - 0.02));
    points.extend(
        outer
            .curve(ARCH_STEPS)
            .iter()
            .rev()
            .map(|p| *p + xy(0.0, LOW_SPRING)),
    );
    points.push(xy(outer.half_span, LOW_SPRING - 0.02));
    points
}

/// Two moulded orders and a hood mould, with the springing at y = 0.
fn arcade_orders(arch: Arch) -> Mesh {
    // From the room-side face: outer roll, rebate, inner roll.
    let mut profile = vec![xy(ARCADE_ORDERS, 0.0), xy(0.285, 0.0)];
    profile.extend(arc(xy(0.23, -0.045), 0.05, 80.0, 260.0, 3));
    profile.extend([xy(0.20, -0.16), xy(0.115, -0.16)]);
    profile.extend(arc(xy(0.06, -0.215), 0.06, 80.0, 180.0, 2));
    profile.push(xy(0.0, -WALL / 2.0));
    // The aisle sees two plain chamfered orders.
    profile.extend([
        xy(0.0, -WALL + 0.24),
        xy(0.07, -WALL + 0.17),
        xy(0.2, -WALL + 0.17),
        xy(0.2, -WALL + 0.06),
        xy(0.26, -WALL),
        xy(ARCADE_ORDERS, -WALL),
    ]);
    let mut mesh = arch_band(Material::Limestone, arch, 0.02, &profile, ARCH_STEPS);
    let hood = [
        xy(0.31, -0.02),
        xy(0.33, 0.07),
        xy(0.37, 0.09),
        xy(0.41, 0.05),
        xy(0.415, -0.02),
    ];
    mesh.merge(arch_band(Material::Limestone, arch, 0.0, &hood, ARCH_STEPS));
    mesh
}

/// Reveals of a niche below the springing, out to where its piers' shafts stand.
fn jambs(length: f64, arch: Arch) -> Mesh {
    let mut mesh = Mesh::default();
    let inner = arch.half_span + 0.12;
    for side in [-1.0, 1.0] {
        let post = [
            xy(side * length / 2.0, 0.0),
            xy(side * inner, 0.0),
            xy(side * inner, LOW_SPRING),
            xy(side * length / 2.0, LOW_SPRING),
        ];
        mesh.merge(panel(Material::Ashlar, &post, &[]));
        let reveal = [
            (0.0, 0.0),
            (0.0, -WALL),
            (LOW_SPRING, -WALL),
            (LOW_SPRING, 0.0),
        ];
        mesh.quad(
            Material::Ashlar,
            reveal.map(|(y, z)| DVec3::new(side * inner, y, z)),
        );
        let (a, b) = (
            side * (arch.half_span + ARCADE_ORDERS),
            side * (arch.half_span - 0.08),
        );
        mesh.block(
            Material::Limestone,
            DVec3::new(a.min(b) - 0.06, LOW_SPRING - 0.2, -WALL - 0.05),
            DVec3::new(a.max(b) + 0.06, LOW_SPRING, 0.08),
            0.04,
        );
        let x = side * (arch.half_span + 0.04);
        mesh.append(
            &colonnette(0.09, 0.0, LOW_SPRING - 0.18),
            &at(x, 0.0, -0.12),
        );
    }
    mesh
}

/// Moulded band along the wall with its top edge at `y`.
pub(super) fn string_course(length: f64, y: f64) -> Mesh {
    let half = length / 2.0;
    let profile = [
        xy(-0.03, y - 0.22),
        xy(0.02, y - 0.20),
        xy(0.03, y - 0.15),
        xy(0.09, y - 0.10),
        xy(0.12, y - 0.09),
        xy(0.12, y - 0.04),
        xy(-0.03, y + 0.02),
    ];
    // Travelling towards −x keeps the room (z > 0) on the right of (x, z).
    mould(
        Material::Limestone,
        &[xy(half, 0.0), xy(-half, 0.0)],
        Path::Open,
        &profile,
    )
}

/// The window of the high walls.
fn clerestory() -> Window {
    Window {
        arch: Arch::pointed(0.62, 0.86),
        drop: 0.62,
        splay: 0.22,
        depth: 0.36,
        tracery: Tracery::TwoLights,
    }
}

/// Blind gallery between arcade and clerestory.
struct Gallery {
    centres: Vec<f64>,
    arch: Arch,
    foot: f64,
    top: f64,
}

impl Gallery {
    const DEPTH: f64 = 0.32;

    fn within(length: f64) -> Self {
        let clear = length - 0.9;
        let count = (clear / 0.8).floor();
        let pitch = clear / count;
        let centres = (0..count as usize)
            .map(|k| (k as f64 + 0.5) * pitch - clear / 2.0)
            .collect();
        let half_span = pitch / 2.0 - 0.09;
        Self {
            centres,
            arch: Arch::pointed(half_span, 1.2 * half_span),
            foot: STRING + 0.06,
            top: 8.62,
        }
    }

    fn springing(&self) -> f64 {
        self.top - 0.12 - self.arch.rise()
    }

    fn holes(&self) -> Vec<Vec<DVec2>> {
        let drop = self.springing() - self.foot;
        let opening = self.arch.offset(0.04).opening(5, drop);
        let place = |&x: &f64| {
            opening
                .iter()
                .map(|p| *p + xy(x, self.springing()))
                .collect()
        };
        self.centres.iter().map(place).collect()
    }

    fn mesh(&self) -> Mesh {
        let mut mesh = Mesh::default();
        let drop = self.springing() - self.foot;
        let wide = self.arch.offset(0.04).opening(5, drop);
        let narrow = self.arch.opening(5, drop - 0.02);
        let mut one = sleeve(Material::Limestone, (&wide, 0.0), (&narrow, -0.05));
        one.merge(sleeve(
            Material::Limestone,
            (&narrow, -0.05),
            (&narrow, -Self::DEPTH),
        ));
        one.append(
            &panel(Material::Ashlar, &narrow, &[]),
            &at(0.0, 0.0, -Self::DEPTH),
        );
        for &x in &self.centres {
            mesh.append(&one, &at(x, self.springing(), 0.0));
        }
        // Colonnettes on the piers between the arches and at both ends.
        let pitch = self.centres[1] - self.centres[0];
        let shaft = colonnette(0.05, self.foot - 0.02, self.springing() + 0.02);
        for k in 0..=self.centres.len() {
            let x = self.centres[0] + (k as f64 - 0.5) * pitch;
            mesh.append(&shaft, &at(x, 0.0, 0.045));
        }
        mesh
    }
}

/// Lancet of the aisles and transepts.
pub(super) fn aisle_window() -> Window {
    Window {
        arch: Arch::pointed(0.55, 0.8),
        drop: 1.9,
        splay: 0.32,
        depth: 0.5,
        tracery: Tracery::TwoLights,
    }
}

/// Outer wall of an aisle bay `length` long, up to `top`, with a window above a plinth bench.
pub(super) fn aisle_wall(length: f64, top: f64) -> Mesh {
    let window = aisle_window();
    let window_at = xy(0.0, 4.55);
    let hole: Vec<DVec2> = window.hole().iter().map(|p| *p + window_at).collect();
    let outline = rectangle(xy(-length / 2.0, 0.0), xy(length / 2.0, top));
    let mut mesh = panel(Material::Ashlar, &outline, &[hole]);
    mesh.append(&window.mesh(), &at(window_at.x, window_at.y, 0.0));
    mesh.append(&string_course(length, 1.95), &at(0.0, 0.0, 0.0));
    mesh.merge(bench(length));
    mesh
}

/// Stone bench with a moulded front along a wall.
pub(super) fn bench(length: f64) -> Mesh {
    let half = length / 2.0;
    let mut profile = vec![
        xy(0.34, -0.02),
        xy(0.34, 0.08),
        xy(0.30, 0.11),
        xy(0.30, 0.36),
    ];
    profile.extend(arc(xy(0.34, 0.41), 0.04, -90.0, 60.0, 3));
    profile.extend([xy(0.33, 0.46), xy(-0.02, 0.46)]);
    mould(
        Material::Limestone,
        &[xy(half, 0.0), xy(-half, 0.0)],
        Path::Open,
        &profile,
    )
}
