//! What people left in the building: benches, altar, candlesticks, pulpit, doors.

use super::plan::{APSE, CHOIR_FLOOR};
use crate::materials::Material;
use crate::mesh::{Mesh, at, upright};
use crate::polygon::panel;
use crate::sweep::{arc, arch_band, lathe, xy};
use crate::trig::turn;
use glam::{DVec2, DVec3};

/// A bench `length` long: local z along it, its back to −x, seen from the east.
pub(super) fn bench(length: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let half = length / 2.0;
    let mut board = |min: DVec3, max: DVec3| mesh.block(Material::Oak, min, max, 0.0);
    board(DVec3::new(-0.02, 0.42, -half), DVec3::new(0.40, 0.46, half));
    board(
        DVec3::new(-0.10, 0.55, -half),
        DVec3::new(-0.05, 0.92, half),
    );
    board(
        DVec3::new(-0.13, 0.90, -half),
        DVec3::new(-0.02, 0.95, half),
    );
    board(
        DVec3::new(-0.34, 0.60, -half),
        DVec3::new(-0.08, 0.63, half),
    );
    board(
        DVec3::new(-0.36, 0.12, -half),
        DVec3::new(-0.24, 0.16, half),
    );
    // Ends cut to a scroll.
    let mut outline = vec![
        xy(-0.38, 0.0),
        xy(0.42, 0.0),
        xy(0.42, 0.08),
        xy(0.36, 0.12),
    ];
    outline.extend([xy(0.36, 0.38), xy(0.42, 0.42), xy(0.42, 0.50)]);
    outline.extend(arc(xy(0.17, 0.86), 0.33, -70.0, -160.0, 4));
    outline.extend(arc(xy(-0.08, 1.0), 0.09, -10.0, 190.0, 6));
    outline.extend([
        xy(-0.22, 0.66),
        xy(-0.36, 0.62),
        xy(-0.36, 0.12),
        xy(-0.38, 0.08),
    ]);
    for z in [-half, half] {
        let thick = 0.035;
        for side in [-thick, thick] {
            mesh.append(
                &panel(Material::Oak, &outline, &[]),
                &at(0.0, 0.0, z + side),
            );
        }
        let rim = crate::sweep::sleeve(Material::Oak, (&outline, -thick), (&outline, thick));
        mesh.append(&rim, &at(0.0, 0.0, z));
    }
    mesh
}

/// Standing or table candlestick with a lit-looking candle, `height` to the wick.
pub(super) fn candlestick(height: f64) -> Mesh {
    let s = height / 1.4;
    let profile: Vec<DVec2> = [
        (0.0, 0.0),
        (0.17, 0.0),
        (0.17, 0.03),
        (0.12, 0.06),
        (0.05, 0.12),
        (0.03, 0.2),
        (0.055, 0.26),
        (0.03, 0.32),
        (0.022, 0.5),
        (0.04, 0.56),
        (0.022, 0.62),
        (0.02, 0.88),
        (0.05, 0.94),
        (0.03, 0.98),
        (0.11, 1.03),
        (0.11, 1.05),
        (0.03, 1.06),
    ]
    .iter()
    .map(|&(r, y)| xy(r * s, y * s))
    .collect();
    let mut mesh = lathe(Material::Brass, &profile, 7);
    let candle = [
        xy(0.03 * s, 1.04 * s),
        xy(0.03 * s, 1.37 * s),
        xy(0.02 * s, 1.39 * s),
        xy(0.0, 1.4 * s),
    ];
    mesh.merge(lathe(Material::Linen, &candle, 6));
    mesh
}

/// The altar with its linen, cross and six candles, in world coordinates.
pub(super) fn altar() -> Mesh {
    let mut mesh = Mesh::default();
    let floor = CHOIR_FLOOR + 0.3;
    let (x, half) = (APSE + 0.2, 1.35);
    let mut stone = |min: [f64; 3], max: [f64; 3], bevel| {
        mesh.block(
            Material::Limestone,
            DVec3::from(min),
            DVec3::from(max),
            bevel,
        );
    };
    stone(
        [x - 0.42, floor - 0.02, -half],
        [x + 0.42, floor + 0.12, half],
        0.03,
    );
    stone(
        [x - 0.36, floor, -half + 0.08],
        [x + 0.36, floor + 0.9, half - 0.08],
        0.02,
    );
    stone(
        [x - 0.46, floor + 0.88, -half - 0.04],
        [x + 0.46, floor + 1.0, half + 0.04],
        0.03,
    );
    // Gradine for the candles.
    stone(
        [x + 0.2, floor + 0.98, -half],
        [x + 0.5, floor + 1.22, half],
        0.02,
    );
    mesh.block(
        Material::Linen,
        DVec3::new(x - 0.475, floor + 0.72, -half + 0.25),
        DVec3::new(x + 0.15, floor + 1.012, half - 0.25),
        0.012,
    );
    for z in [-1.1, -0.75, -0.4, 0.4, 0.75, 1.1] {
        mesh.append(&candlestick(0.75), &at(x + 0.35, floor + 1.21, z));
    }
    // Cross on a stepped foot.
    let y = floor + 1.21;
    for (foot, top, reach) in [(0.0, 0.08, 0.16), (0.06, 0.15, 0.1)] {
        mesh.block(
            Material::Brass,
            DVec3::new(x + 0.35 - reach * 0.7, y + foot, -reach),
            DVec3::new(x + 0.35 + reach * 0.7, y + top, reach),
            0.01,
        );
    }
    let bar = [
        ([-0.03, 0.12, -0.03], [0.03, 1.35, 0.03]),
        ([-0.028, 0.92, -0.3], [0.028, 0.98, 0.3]),
    ];
    for (min, max) in bar {
        let origin = DVec3::new(x + 0.35, y, 0.0);
        mesh.block(
            Material::Brass,
            origin + DVec3::from(min),
            origin + DVec3::from(max),
            0.008,
        );
    }
    mesh
}

/// Octagonal pulpit on a stem about the y axis.
pub(super) fn pulpit() -> Mesh {
    let mut mesh = Mesh::default();
    let stem = [
        xy(0.45, 0.0),
        xy(0.45, 0.14),
        xy(0.36, 0.18),
        xy(0.22, 0.24),
        xy(0.17, 0.32),
        xy(0.16, 1.0),
        xy(0.2, 1.06),
        xy(0.17, 1.12),
        xy(0.24, 1.3),
        xy(0.42, 1.48),
        xy(0.56, 1.56),
        xy(0.0, 1.57),
    ];
    mesh.merge(lathe(Material::Limestone, &stem, 12));
    let ring = |profile: &[DVec2], material| lathe(material, profile, 8);
    let body = [
        xy(0.0, 1.56),
        xy(0.72, 1.56),
        xy(0.74, 1.62),
        xy(0.68, 1.68),
        xy(0.66, 1.72),
        xy(0.66, 2.44),
        xy(0.69, 2.48),
        xy(0.75, 2.54),
        xy(0.75, 2.62),
        xy(0.58, 2.62),
        xy(0.58, 1.62),
        xy(0.0, 1.62),
    ];
    mesh.merge(ring(&body, Material::Limestone));
    let arch = crate::arch::Arch::round(0.17);
    let frame = [
        xy(0.0, -0.03),
        xy(0.01, 0.03),
        xy(0.05, 0.03),
        xy(0.055, -0.03),
    ];
    let blind = arch_band(Material::Limestone, arch, 0.36, &frame, 5);
    for k in 0..8 {
        let out = turn(2 * k + 1, 16);
        let middle = out * (0.66 * turn(1, 16).x);
        // Facing outwards: local z along `out`.
        let place = upright(DVec3::new(middle.x, 2.17, middle.y), xy(out.y, -out.x));
        mesh.append(&blind, &place);
        let post = turn(2 * k, 16) * 0.67;
        mesh.append(
            &super::columns::colonnette(0.035, 1.7, 2.46),
            &at(post.x, 0.0, post.y),
        );
    }
    mesh
}

/// Panelled double door of half width `half` and `height`, in the frame of its wall.
pub(super) fn door(half: f64, height: f64) -> Mesh {
    let mut mesh = Mesh::default();
    for side in [-1.0, 1.0] {
        let (a, b) = (side * 0.01, side * half);
        mesh.block(
            Material::Oak,
            DVec3::new(a.min(b), 0.0, -0.08),
            DVec3::new(a.max(b), height, 0.0),
            0.01,
        );
        for row in 0..4 {
            let y = 0.15 + f64::from(row) * (height - 0.2) / 4.0;
            let (c, d) = (side * 0.14, side * (half - 0.12));
            mesh.block(
                Material::Oak,
                DVec3::new(c.min(d), y, -0.02),
                DVec3::new(c.max(d), y + (height - 0.2) / 4.0 - 0.12, 0.035),
                0.03,
            );
        }
    }
    mesh
}
