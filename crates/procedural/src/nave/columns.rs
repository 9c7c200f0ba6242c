//! Piers, shafts and their leaf capitals.

use super::plan::{HIGH_SPRING, LOW_SPRING};
use crate::materials::Material;
use crate::mesh::{Mesh, at, upright};
use crate::sweep::{Path, arc, half_lathe, lathe, mould, xy};
use crate::trig::{acos, degrees, turn};
use glam::{DVec2, DVec3};
use std::ops::Range;

/// Round core and four engaged shafts, in plan.
struct Quatrefoil {
    core: f64,
    shaft: f64,
    reach: f64,
}

impl Quatrefoil {
    /// Counter-clockwise outline in (x, z).
    fn outline(&self) -> Vec<DVec2> {
        let (core, shaft, reach) = (self.core, self.shaft, self.reach);
        let cosine = (reach * reach + core * core - shaft * shaft) / (2.0 * reach * core);
        let meet = acos(cosine);
        let swing = acos((core * cosine - reach) / shaft) * 180.0 / std::f64::consts::PI;
        let mut points = Vec::new();
        for quarter in 0..4 {
            let (along, start) = (turn(quarter, 4), 90.0 * quarter as f64);
            points.extend(arc(along * reach, shaft, start - swing, start + swing, 6));
            let meet = meet * 180.0 / std::f64::consts::PI;
            let between = arc(DVec2::ZERO, core, start + meet, start + 90.0 - meet, 2);
            points.push(between[1]);
        }
        points
    }
}

/// Attic base of height 0.42: (offset, height) from the floor to the shaft.
fn base(floor: f64) -> Vec<DVec2> {
    let mut points = vec![
        xy(0.15, floor),
        xy(0.15, floor + 0.14),
        xy(0.13, floor + 0.16),
    ];
    points.extend(arc(xy(0.09, floor + 0.205), 0.045, -90.0, 90.0, 3));
    points.extend([xy(0.07, floor + 0.27), xy(0.055, floor + 0.30)]);
    points.extend([
        xy(0.07, floor + 0.36),
        xy(0.03, floor + 0.39),
        xy(0.0, floor + 0.42),
    ]);
    points
}

/// Astragal and bell of a capital that ends at `top`: 0.62 m times `scale` high.
fn bell(top: f64, scale: f64) -> Vec<DVec2> {
    let y = |h: f64| top - (0.62 - h) * scale;
    let mut points = vec![xy(0.0, y(0.0))];
    points.extend([
        xy(0.035 * scale, y(0.03)),
        xy(0.0, y(0.09)),
        xy(0.012 * scale, y(0.25)),
        xy(0.12 * scale, y(0.58)),
        xy(0.13 * scale, y(0.62)),
    ]);
    points
}

/// One leaf rooted at the origin: grows along y, curls towards +x, as wide as `size` along z.
fn leaf(size: f64) -> Mesh {
    // (out, up, half width) from root to the rolled tip.
    let spine = [
        (0.000, 0.00, 0.44),
        (0.04, 0.50, 0.50),
        (0.18, 0.98, 0.38),
        (0.34, 1.06, 0.26),
        (0.42, 0.92, 0.10),
    ];
    let rows: Vec<Vec<DVec3>> = spine
        .iter()
        .map(|&(out, up, half)| {
            // A raised midrib; the edges fall back to the bell.
            [(-1.0, -0.10), (0.0, 0.10), (1.0, -0.10)]
                .map(|(w, lift): (f64, f64)| {
                    size * DVec3::new(out + lift + 0.02, up - 0.10 * w.abs(), w * half)
                })
                .to_vec()
        })
        .collect();
    let mut mesh = Mesh::default();
    mesh.grid(Material::Limestone, &rows);
    mesh.smooth(50.0)
}

/// Leaves `which` of `count` about the y axis with their roots at `radius`, counted from +x
/// towards +z, `phase` of a step on.
fn wreath(which: Range<usize>, count: usize, radius: f64, size: f64, phase: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let one = leaf(size);
    for k in which {
        let out = crate::trig::direction(degrees(360.0 * (k as f64 + phase) / count as f64));
        mesh.append(
            &one,
            &upright(DVec3::new(out.x * radius, 0.0, out.y * radius), out),
        );
    }
    mesh
}

/// Square slab with a hollowed lower edge, its top closed, about the y axis.
pub(super) fn abacus(half: f64, bottom: f64, top: f64) -> Mesh {
    let high = top - bottom;
    let square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, z)| xy(x, z) * half);
    let mut profile = vec![
        xy(-half * 0.999, bottom),
        xy(-0.10, bottom),
        xy(-0.09, bottom + 0.02),
    ];
    profile.extend(arc(
        xy(-0.09, bottom + high * 0.55),
        high * 0.5,
        -70.0,
        -10.0,
        2,
    ));
    profile.extend([
        xy(0.0, bottom + high * 0.5),
        xy(0.0, top - 0.02),
        xy(-0.02, top),
        xy(-half * 0.999, top),
    ]);
    profile.retain(|p| p.x <= 0.0);
    mould(Material::Limestone, &square, Path::Closed, &profile)
}

/// Free-standing pier of the arcade about the y axis, from floor to springing.
pub(super) fn pier() -> Mesh {
    let plan = Quatrefoil {
        core: 0.37,
        shaft: 0.155,
        reach: 0.395,
    };
    let outline = plan.outline();
    let top = LOW_SPRING - 0.18;
    let mut mesh = Mesh::default();
    // A chamfered square plinth under the moulded base.
    mesh.block(
        Material::Limestone,
        DVec3::new(-0.66, -0.05, -0.66),
        DVec3::new(0.66, 0.16, 0.66),
        0.03,
    );
    mesh.merge(mould(
        Material::Limestone,
        &outline,
        Path::Closed,
        &base(0.16),
    ));
    let shaft = [xy(0.0, 0.58), xy(0.0, top - 0.62)];
    mesh.merge(drum(&outline, &shaft));
    mesh.merge(mould(
        Material::Limestone,
        &outline,
        Path::Closed,
        &bell(top, 1.0),
    ));
    // Below, a leaf on every shaft and one in every hollow; above, one between each two.
    let mut leaves = wreath(0..4, 4, 0.545, 0.27, 0.0);
    leaves.merge(wreath(0..4, 4, 0.37, 0.33, 0.5));
    leaves.append(&wreath(0..8, 8, 0.47, 0.32, 0.5), &at(0.0, 0.2, 0.0));
    mesh.append(&leaves, &at(0.0, top - 0.55, 0.0));
    mesh.merge(abacus(0.70, top, LOW_SPRING));
    mesh
}

/// The shaft itself, whose texture runs round the outline.
fn drum(outline: &[DVec2], profile: &[DVec2]) -> Mesh {
    let mut length = 0.0;
    let closed: Vec<DVec2> = outline.iter().chain(&outline[..1]).copied().collect();
    let columns: Vec<(DVec2, f64)> = closed
        .iter()
        .enumerate()
        .map(|(k, &p)| {
            length += if k == 0 {
                0.0
            } else {
                p.distance(closed[k - 1])
            };
            (p, length)
        })
        .collect();
    let row = |&(p, u): &(DVec2, f64)| {
        profile
            .iter()
            .map(|q| (DVec3::new(p.x, q.y, p.y), xy(u, q.y)))
            .collect::<Vec<_>>()
    };
    let mut mesh = Mesh::default();
    mesh.grid_uv(Material::Drum, &columns.iter().map(row).collect::<Vec<_>>());
    mesh.smooth(40.0)
}

/// How much of a shaft is seen.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Seen {
    /// The side towards +z: the back stands in a wall.
    Front,
    /// Most of it: the shaft stands in a corner or free.
    Round,
}

/// Round shaft about the y axis with base and leaf capital.
pub(super) fn shaft(radius: f64, foot: f64, top: f64, seen: Seen) -> Mesh {
    let scale = (radius / 0.2).min(1.0);
    let abacus_height = 0.14 * scale + 0.02;
    let bell_top = top - abacus_height;
    let s = scale;
    let profile = [
        xy(radius + 0.10 * s, foot),
        xy(radius + 0.10 * s, foot + 0.14 * s),
        xy(radius + 0.07 * s, foot + 0.17 * s),
        xy(radius + 0.08 * s, foot + 0.23 * s),
        xy(radius + 0.05 * s, foot + 0.28 * s),
        xy(radius, foot + 0.33 * s),
        xy(radius, bell_top - 0.62 * s),
        xy(radius + 0.03 * s, bell_top - 0.585 * s),
        xy(radius, bell_top - 0.55 * s),
        xy(radius + 0.03 * s, bell_top - 0.2 * s),
        xy(radius + 0.13 * s, bell_top),
    ];
    let root = radius * 1.02;
    let size = 0.26 * scale.max(0.5);
    let (mut mesh, leaves) = match seen {
        Seen::Front => (
            half_lathe(Material::Limestone, &profile, 8),
            wreath(0..5, 8, root, size, 0.0),
        ),
        Seen::Round => (
            lathe(Material::Limestone, &profile, 10),
            wreath(0..8, 8, root, size, 0.0),
        ),
    };
    mesh.append(&leaves, &at(0.0, bell_top - 0.46 * scale, 0.0));
    let half = radius + 0.17 * s;
    let corner = DVec3::new(half, 0.0, half);
    mesh.block(
        Material::Limestone,
        DVec3::Y * bell_top - corner,
        DVec3::Y * top + corner,
        0.05 * s,
    );
    mesh
}

/// Cluster of three shafts from the arcade's abacus to the high vault: local x along the wall,
/// z into the room, the wall's face at z = 0.
pub(super) fn vault_shafts(foot: f64) -> Mesh {
    let mut mesh = Mesh::default();
    mesh.append(
        &shaft(0.13, foot, HIGH_SPRING, Seen::Front),
        &at(0.0, 0.0, 0.04),
    );
    for x in [-0.2, 0.2] {
        mesh.append(&colonnette(0.08, foot, HIGH_SPRING), &at(x, 0.0, 0.0));
    }
    mesh
}

/// Slender colonnette of galleries and window jambs: plain bell, round abacus.
pub(super) fn colonnette(radius: f64, foot: f64, top: f64) -> Mesh {
    let sides = if radius > 0.07 { 8 } else { 6 };
    let r = radius;
    let profile = [
        xy(r * 1.7, foot),
        xy(r, foot + r * 2.2),
        xy(r * 0.95, top - r * 4.0),
        xy(r * 1.2, top - r * 3.7),
        xy(r * 0.95, top - r * 3.4),
        xy(r * 1.9, top - r * 1.1),
        xy(r * 1.9, top),
        xy(0.0, top + 0.001),
    ];
    lathe(Material::Limestone, &profile, sides)
}
