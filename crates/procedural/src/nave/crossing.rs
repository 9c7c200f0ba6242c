//! The crossing: its four piers and arches, and the pendentives that carry the drum.

use super::columns::{Seen, shaft};
use super::plan::{
    ARCH_STEPS, CROSSING_ORDERS, HALF, HIGH_SPRING, RING, WALL, WALL_TOP, crossing_arch, rectangle,
};
use crate::materials::Material;
use crate::mesh::{Mesh, at};
use crate::polygon::panel;
use crate::sweep::{Path, arc, arch_band, mould, xy};
use crate::trig::{degrees, direction};
use glam::{DVec2, DVec3};

/// Steps of each half of the crossing arches.
const ROUND_STEPS: usize = 12;

/// One crossing arch in the frame of its opening: x across, y up from the floor, z through the
/// wall, whose faces are z = ±`WALL` / 2. Responds reach the floor.
pub(super) fn arch() -> Mesh {
    let intrados = crossing_arch();
    let profile = orders();
    let mut mesh = Mesh::default();
    let band = arch_band(Material::Limestone, intrados, 0.0, &profile, ROUND_STEPS);
    mesh.append(&band, &at(0.0, HIGH_SPRING, 0.0));
    mesh.append_with_mirror_x(&respond(&profile), &at(0.0, 0.0, 0.0));
    mesh
}

/// (radial offset, depth) of the orders; the far end leans back behind whatever meets it.
fn orders() -> Vec<DVec2> {
    let mut half = vec![xy(CROSSING_ORDERS, -WALL / 2.0), xy(0.36, -WALL / 2.0)];
    half.extend(
        arc(xy(0.30, -0.385), 0.06, -90.0, -200.0, 3)
            .iter()
            .map(|p| xy(p.x, p.y)),
    );
    half.extend([xy(0.24, -0.28), xy(0.12, -0.28)]);
    half.extend(arc(xy(0.07, -0.215), 0.07, -90.0, -180.0, 2));
    half.extend([xy(0.0, -0.11), xy(0.03, -0.08)]);
    let other: Vec<DVec2> = half.iter().rev().map(|p| xy(p.x, -p.y)).collect();
    half.extend(other);
    half.push(xy(CROSSING_ORDERS + 0.06, WALL / 2.0 - 0.03));
    half
}

/// The right-hand respond: the orders in plan, with base and capital.
fn respond(profile: &[DVec2]) -> Mesh {
    let edge = HALF - CROSSING_ORDERS;
    // In plan (x, z): offsets must point to the opening, so travel towards −z.
    let plan: Vec<DVec2> = profile.iter().map(|p| xy(edge + p.x, p.y)).collect();
    let plan: Vec<DVec2> = plan.iter().rev().copied().collect();
    let mut upright = vec![xy(0.10, -0.02), xy(0.10, 0.34), xy(0.08, 0.37)];
    upright.extend(arc(xy(0.05, 0.42), 0.05, -80.0, 80.0, 2));
    upright.extend([xy(0.035, 0.52), xy(0.0, 0.58), xy(0.0, HIGH_SPRING - 0.75)]);
    upright.push(xy(0.04, HIGH_SPRING - 0.70));
    upright.extend([
        xy(0.0, HIGH_SPRING - 0.64),
        xy(0.07, HIGH_SPRING - 0.24),
        xy(0.10, HIGH_SPRING - 0.19),
        xy(0.14, HIGH_SPRING - 0.12),
        xy(0.14, HIGH_SPRING),
        xy(-0.05, HIGH_SPRING),
    ]);
    mould(Material::Limestone, &plan, Path::Open, &upright)
}

/// Wall above the arch, in the same frame at depth `z`: closes what the high vault leaves open.
pub(super) fn diaphragm(z: f64) -> Mesh {
    let outer = crossing_arch().offset(CROSSING_ORDERS);
    let half = HALF + 0.2;
    let mut outline = vec![xy(half, 0.0), xy(half, WALL_TOP - HIGH_SPRING)];
    outline.extend([xy(-half, WALL_TOP - HIGH_SPRING), xy(-half, 0.0)]);
    outline.extend(outer.curve(ROUND_STEPS).iter().rev());
    let mut mesh = Mesh::default();
    mesh.append(
        &panel(Material::Ashlar, &outline, &[]),
        &at(0.0, HIGH_SPRING, z),
    );
    mesh
}

/// Core of a crossing pier about the y axis, with the shaft that carries the pendentive in the
/// corner (`corner_x`, `corner_z` = ±1) towards the crossing.
pub(super) fn pier(corner_x: f64, corner_z: f64) -> Mesh {
    let half = WALL / 2.0 - 0.001;
    let mut mesh = Mesh::default();
    for (a, b) in [
        (xy(-half, -half), xy(half, -half)),
        (xy(-half, half), xy(half, half)),
    ] {
        let face = [(a, 0.0), (b, 0.0), (b, WALL_TOP), (a, WALL_TOP)];
        mesh.quad(Material::Ashlar, face.map(|(p, y)| DVec3::new(p.x, y, p.y)));
        mesh.quad(Material::Ashlar, face.map(|(p, y)| DVec3::new(p.y, y, p.x)));
    }
    let reach = WALL / 2.0 + 0.02;
    mesh.append(
        &shaft(0.15, 0.0, HIGH_SPRING, Seen::Round),
        &at(corner_x * reach, 0.0, corner_z * reach),
    );
    mesh
}

/// The four pendentives about the y axis: what a sphere through the crossing's corners leaves
/// between the four arches and the ring under the drum.
pub(super) fn pendentives() -> Mesh {
    const AROUND: usize = 18;
    const UP: usize = 7;
    let radius = HALF * 2f64.sqrt();
    let mut quarter = Mesh::default();
    let columns: Vec<Vec<(DVec3, DVec2)>> = (0..=AROUND)
        .map(|k| {
            let angle = -45.0 + 90.0 * (k as f64 / AROUND as f64) + 45.0;
            let out = direction(degrees(angle));
            // From just inside the arches' stone up to the ring.
            let foot = out * ((HALF + 0.03) / out.x.abs().max(out.y.abs()));
            let low = DVec3::new(
                foot.x,
                (radius * radius - foot.length_squared()).max(0.0).sqrt(),
                foot.y,
            );
            let high = DVec3::new(out.x * HALF, HALF, out.y * HALF);
            (0..=UP)
                .map(|j| {
                    let t = j as f64 / UP as f64;
                    let p = low.lerp(high, t).normalize() * radius;
                    (p, xy(HALF * degrees(angle), 1.2 * p.y))
                })
                .collect()
        })
        .collect();
    quarter.grid_uv(Material::Web, &columns);
    let quarter = quarter.smooth(40.0);
    let mut mesh = Mesh::default();
    for (x, z) in [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
        let mirror = glam::DAffine3::from_scale(DVec3::new(x, 1.0, z));
        mesh.append(&quarter, &(at(0.0, HIGH_SPRING, 0.0) * mirror));
    }
    debug_assert!(
        (RING - HIGH_SPRING - HALF).abs() < 1e-9,
        "the ring touches the arches' crowns"
    );
    mesh
}

/// Wall with one arch into an aisle: frame as [`arch`], room-side face at z = 0.
pub(super) fn end_wall(half: f64, top: f64, opening: Option<(crate::arch::Arch, f64)>) -> Mesh {
    let outline = rectangle(xy(-half, 0.0), xy(half, top));
    let Some((arch, spring)) = opening else {
        return panel(Material::Ashlar, &outline, &[]);
    };
    let mut outline = vec![xy(half, 0.0), xy(half, top), xy(-half, top), xy(-half, 0.0)];
    outline.push(xy(-arch.half_span, 0.0));
    outline.extend(
        arch.curve(ARCH_STEPS)
            .iter()
            .rev()
            .map(|p| *p + xy(0.0, spring)),
    );
    outline.push(xy(arch.half_span, 0.0));
    panel(Material::Ashlar, &outline, &[])
}
