//! Pavements: lozenges down the nave, flags in the aisles, a marble rosette under the dome.

use super::columns::colonnette;
use super::plan::{APSE, CHOIR_FLOOR, CROSSING, HALF, NAVE_EAST, OUTER, WALL, WEST, rectangle};
use crate::materials::Material;
use crate::mesh::{Mesh, at};
use crate::polygon::panel;
use crate::sweep::{Path, arc, mould, xy};
use crate::trig::turn;
use glam::{DVec2, DVec3};

/// West edge of the lowest choir step.
const STEPS_WEST: f64 = CROSSING + HALF + 0.02;
/// Risers up to the choir.
const RISERS: usize = 6;
const TREAD: f64 = 0.34;
/// Half the width of the choir steps, between their parapets.
const CHEEK: f64 = 2.75;
/// Half the width of the nave's lozenge field and of its border.
const FIELD: f64 = 1.5;
const BORDER: f64 = 1.72;

/// Level pavement between two plan corners (x, z) at height `y`.
fn slab(mesh: &mut Mesh, material: Material, min: DVec2, max: DVec2, y: f64) {
    let corners = [
        (min.x, min.y),
        (min.x, max.y),
        (max.x, max.y),
        (max.x, min.y),
    ];
    mesh.quad(material, corners.map(|(x, z)| DVec3::new(x, y, z)));
}

/// All pavements and the choir steps.
pub(super) fn floor() -> Mesh {
    let mut mesh = Mesh::default();
    // Out to the doors, which stand deep in the portal.
    let (west, east) = (WEST - 0.9, NAVE_EAST);
    slab(
        &mut mesh,
        Material::Lozenges,
        xy(west, -FIELD),
        xy(east, FIELD),
        0.0,
    );
    for side in [-1.0, 1.0] {
        let strip = |mesh: &mut Mesh, material, near: f64, far: f64| {
            let (a, b) = (side * near, side * far);
            slab(mesh, material, xy(west, a.min(b)), xy(east, a.max(b)), 0.0);
        };
        strip(&mut mesh, Material::Green, FIELD, FIELD + 0.05);
        strip(&mut mesh, Material::White, FIELD + 0.05, BORDER - 0.05);
        strip(&mut mesh, Material::Red, BORDER - 0.05, BORDER);
        strip(&mut mesh, Material::Flags, BORDER, OUTER + 0.1);
        // Transepts, thresholds and the ground the crossing piers stand on.
        let (a, b) = (side * HALF, side * (OUTER + 0.1));
        let reach = HALF + WALL + 0.1;
        slab(
            &mut mesh,
            Material::Flags,
            xy(east, a.min(b)),
            xy(CROSSING + reach, a.max(b)),
            0.0,
        );
    }
    slab(
        &mut mesh,
        Material::Red,
        xy(east, -HALF),
        xy(CROSSING - HALF, HALF),
        0.0,
    );
    slab(
        &mut mesh,
        Material::Red,
        xy(CROSSING + HALF, -HALF),
        xy(CROSSING + HALF + WALL, HALF),
        0.0,
    );
    mesh.append(&rosette(), &at(CROSSING, 0.0, 0.0));
    choir(&mut mesh);
    mesh
}

/// Steps, the chequered choir floor and the footpace of the altar.
fn choir(mesh: &mut Mesh) {
    let rise = CHOIR_FLOOR / RISERS as f64;
    let half = CHEEK + 0.02;
    for k in 0..RISERS {
        let x = STEPS_WEST + TREAD * k as f64;
        let y = rise * k as f64;
        // Nosing: a hollow under a rounded edge; the tread runs under the next riser.
        let mut profile = vec![xy(-0.02, y - 0.01), xy(-0.02, y + rise * 0.62)];
        profile.push(xy(0.0, y + rise * 0.72));
        profile.extend(arc(xy(-0.01, y + rise - 0.022), 0.022, -60.0, 90.0, 5));
        profile.push(xy(-TREAD - 0.05, y + rise));
        let front = mould(
            Material::White,
            &[xy(x, half), xy(x, -half)],
            Path::Open,
            &profile,
        );
        mesh.merge(front);
    }
    let west = STEPS_WEST + TREAD * RISERS as f64 - 0.1;
    let runner = 1.1;
    for k in 0..RISERS {
        // Carpet down the middle, a centimetre proud.
        let x = STEPS_WEST + TREAD * k as f64 - 0.028;
        let y = rise * k as f64;
        let profile = [(x, y), (x, y + rise + 0.008), (x + TREAD, y + rise + 0.008)];
        let rows = [-runner, runner].map(|z| profile.map(|(x, y)| DVec3::new(x, y, z)).to_vec());
        mesh.grid(Material::Carpet, &rows);
    }
    for side in [-1.0, 1.0] {
        let (near, far) = (side * CHEEK, side * (HALF + WALL + 0.1));
        mesh.block(
            Material::White,
            DVec3::new(STEPS_WEST - 0.12, -0.05, near.min(far)),
            DVec3::new(west, CHOIR_FLOOR, near.max(far)),
            0.0,
        );
        mesh.append(
            &parapet(west - STEPS_WEST),
            &at(STEPS_WEST, CHOIR_FLOOR, side * (CHEEK + 0.16)),
        );
    }
    let top = CHOIR_FLOOR + 0.008;
    let carpet = rectangle(xy(west - 0.3, -runner), xy(APSE - 1.0, runner));
    let corners: Vec<DVec3> = carpet.iter().map(|p| DVec3::new(p.x, top, p.y)).collect();
    mesh.quad(
        Material::Carpet,
        [corners[0], corners[1], corners[2], corners[3]],
    );
    let tile = 0.6;
    let mut row = 0;
    let mut x = west;
    while x < APSE + HALF {
        let mut column = 0;
        let mut z = -4.8;
        while z < 4.75 {
            let material = if (row + column) % 2 == 0 {
                Material::White
            } else {
                Material::Red
            };
            slab(
                mesh,
                material,
                xy(x, z),
                xy(x + tile, z + tile),
                CHOIR_FLOOR,
            );
            z += tile;
            column += 1;
        }
        x += tile;
        row += 1;
    }
    let mut face = Mesh::default();
    for (k, reach) in [(0.0, 1.5), (1.0, 1.15)] {
        face.block(
            Material::White,
            DVec3::new(APSE - reach, CHOIR_FLOOR - 0.05, -reach - 0.9),
            DVec3::new(APSE + 1.6, CHOIR_FLOOR + 0.15 * (k + 1.0), reach + 0.9),
            0.02,
        );
    }
    mesh.merge(face);
}

/// Balustrade `length` long from the origin along +x.
fn parapet(length: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let mut stone = |min: [f64; 3], max: [f64; 3]| {
        mesh.block(
            Material::Limestone,
            DVec3::from(min),
            DVec3::from(max),
            0.02,
        );
    };
    stone([-0.06, -0.02, -0.12], [length, 0.12, 0.12]);
    stone([-0.06, 0.72, -0.13], [length, 0.84, 0.13]);
    stone([-0.1, -0.03, -0.15], [0.16, 0.92, 0.15]);
    stone([length - 0.12, -0.03, -0.15], [length + 0.14, 0.92, 0.15]);
    let count = 8;
    for k in 0..count {
        let x = 0.16 + (length - 0.28) * (f64::from(k) + 0.5) / f64::from(count);
        mesh.append(&colonnette(0.055, 0.11, 0.73), &at(x, 0.0, 0.0));
    }
    mesh
}

/// Concentric bands of marble triangles about the y axis, out to the crossing's square.
fn rosette() -> Mesh {
    const POINTS: usize = 32;
    let mut mesh = Mesh::default();
    let at_radius = |r: f64, half_steps: usize| {
        let p = turn(half_steps % (2 * POINTS), 2 * POINTS) * r;
        DVec3::new(p.x, 0.0, p.y)
    };
    let plain = |mesh: &mut Mesh, material, from: f64, to: f64| {
        for k in 0..2 * POINTS {
            mesh.quad(
                material,
                [
                    at_radius(from, k),
                    at_radius(to, k),
                    at_radius(to, k + 1),
                    at_radius(from, k + 1),
                ],
            );
        }
    };
    // Points of `inner` colour with their tips outwards, `outer` colour between them.
    let star = |mesh: &mut Mesh, inner, outer, from: f64, to: f64| {
        for k in 0..POINTS {
            let (a, m, b) = (2 * k, 2 * k + 1, 2 * k + 2);
            let (left, right) = (at_radius(from, a), at_radius(from, b));
            let (tip, foot) = (at_radius(to, m), at_radius(from, m));
            mesh.triangle(inner, [left, foot, tip]);
            mesh.triangle(inner, [foot, right, tip]);
            mesh.triangle(outer, [left, tip, at_radius(to, a)]);
            mesh.triangle(outer, [right, at_radius(to, b), tip]);
        }
    };
    plain(&mut mesh, Material::Red, 0.0, 0.3);
    plain(&mut mesh, Material::White, 0.3, 0.38);
    star(&mut mesh, Material::Green, Material::White, 0.38, 0.95);
    plain(&mut mesh, Material::Red, 0.95, 1.1);
    star(&mut mesh, Material::White, Material::Red, 1.1, 1.5);
    star(&mut mesh, Material::White, Material::Green, 1.5, 1.95);
    plain(&mut mesh, Material::White, 1.95, 2.1);
    star(&mut mesh, Material::Red, Material::White, 2.1, 2.75);
    plain(&mut mesh, Material::Green, 2.75, 2.87);
    plain(&mut mesh, Material::White, 2.87, 3.0);
    star(&mut mesh, Material::White, Material::Red, 3.0, 3.3);
    plain(&mut mesh, Material::Green, 3.3, 3.45);
    let ring: Vec<DVec2> = (0..2 * POINTS)
        .map(|k| turn(k, 2 * POINTS) * 3.45)
        .collect();
    let square = rectangle(xy(-HALF, -HALF), xy(HALF, HALF));
    let spandrels = panel(Material::White, &square, &[ring]);
    // The panel stands upright; lay it down.
    let down = crate::mesh::frame(DVec3::ZERO, DVec3::X, DVec3::NEG_Z);
    mesh.append(&spandrels, &down);
    mesh
}
