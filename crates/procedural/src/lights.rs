//! The lamps: rings of point lights and their RON file.

use crate::trig::turn;
use glam::DVec3;
use std::fmt::Write as _;

/// A level ring of lamps.
pub(crate) struct Ring {
    pub(crate) centre: DVec3,
    pub(crate) radius: f64,
    pub(crate) lamps: usize,
}

/// Positions of all lamps of `rings`, ring by ring.
pub(crate) fn positions(rings: &[Ring]) -> Vec<DVec3> {
    let ring = |r: &Ring| {
        let place = |k| turn(2 * k + 1, 2 * r.lamps) * r.radius;
        (0..r.lamps)
            .map(|k| r.centre + DVec3::new(place(k).x, 0.0, place(k).y))
            .collect::<Vec<_>>()
    };
    rings.iter().flat_map(ring).collect()
}

/// RON list of point lights of one `intensity` in W/sr per channel.
pub(crate) fn ron(positions: &[DVec3], intensity: [f64; 3]) -> Vec<u8> {
    let [r, g, b] = intensity;
    let mut text = String::from("[\n");
    for p in positions {
        // Adding zero turns a rounded -0.0 into 0.0.
        let [x, y, z] = p.to_array().map(|c| (c * 1e4).round() / 1e4 + 0.0);
        writeln!(
            text,
            "    (position: ({x:.4}, {y:.4}, {z:.4}), intensity: ({r:.1}, {g:.1}, {b:.1})),"
        )
        .expect("a string takes any text");
    }
    text.push_str("]\n");
    text.into_bytes()
}
