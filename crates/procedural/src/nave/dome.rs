//! Drum, coffered dome and lantern over the crossing, about the y axis.

use super::columns::colonnette;
use super::plan::{DOME_SPRING, HALF, OCULUS, RING};
use super::windows::{Tracery, Window};
use crate::arch::Arch;
use crate::lights::Ring;
use crate::materials::Material;
use crate::mesh::{Mesh, at, upright};
use crate::polygon::panel;
use crate::sweep::{arc, lathe, rib, xy};
use crate::trig::{acos, direction, turn};
use glam::{DVec2, DVec3};

/// Windows of the drum, ribs of the dome.
const SIDES: usize = 16;
/// Segments of the round cornices.
const ROUND: usize = 40;
/// Rings of coffers.
const COFFERS: usize = 4;

/// The lamps: two rings under the upper coffers, 120 in all.
pub(super) fn lamps(centre: DVec2) -> Vec<Ring> {
    let ring = |height: f64, radius: f64, lamps: usize| Ring {
        centre: DVec3::new(centre.x, DOME_SPRING + height, centre.y),
        radius,
        lamps,
    };
    vec![ring(1.9, 2.65, 72), ring(2.75, 1.9, 48)]
}

/// Everything above the pendentives.
pub(super) fn dome() -> Mesh {
    let mut mesh = drum();
    mesh.append(&calotte(), &at(0.0, DOME_SPRING, 0.0));
    mesh.append(&lantern(), &at(0.0, oculus_height(), 0.0));
    mesh
}

fn oculus_height() -> f64 {
    DOME_SPRING + (HALF * HALF - OCULUS * OCULUS).sqrt()
}

/// Cornice with dentils, sixteen windows between shafts, and the cornice under the dome.
fn drum() -> Mesh {
    let mut mesh = Mesh::default();
    // The moulding starts behind the pendentives and ends behind the drum's wall.
    let mut lower = vec![xy(HALF + 0.1, RING - 0.12), xy(HALF - 0.02, RING - 0.12)];
    lower.extend([
        xy(HALF - 0.05, RING - 0.02),
        xy(HALF - 0.09, RING),
        xy(HALF - 0.09, RING + 0.16),
    ]);
    lower.extend([xy(HALF - 0.24, RING + 0.18), xy(HALF - 0.25, RING + 0.24)]);
    lower.extend(arc(xy(HALF - 0.25, RING + 0.29), 0.05, -90.0, -270.0, 4));
    lower.extend([xy(HALF - 0.22, RING + 0.37), xy(HALF + 0.1, RING + 0.40)]);
    mesh.merge(lathe(Material::Limestone, &lower, ROUND));
    let mut dentil = Mesh::default();
    dentil.block(
        Material::Limestone,
        DVec3::new(HALF - 0.20, RING + 0.02, -0.07),
        DVec3::new(HALF, RING + 0.19, 0.07),
        0.0,
    );
    for k in 0..ROUND {
        mesh.append(&dentil, &upright(DVec3::ZERO, turn(2 * k + 1, 2 * ROUND)));
    }

    let (foot, top) = (RING + 0.38, DOME_SPRING - 0.28);
    let corner = turn(1, 2 * SIDES);
    let (apothem, half) = (HALF * corner.x, HALF * corner.y);
    let window = Window {
        arch: Arch::round(0.32),
        drop: 0.5,
        splay: 0.12,
        depth: 0.3,
        tracery: Tracery::Lancet,
    };
    let spring = foot + 0.86;
    let hole: Vec<DVec2> = window.hole().iter().map(|p| *p + xy(0.0, spring)).collect();
    let wall = super::plan::rectangle(xy(-half, foot - 0.1), xy(half, top + 0.1));
    let mut side = panel(Material::Ashlar, &wall, &[hole]);
    side.append(&window.mesh(), &at(0.0, spring, 0.0));
    let column = colonnette(0.11, foot - 0.03, top + 0.06);
    for k in 0..SIDES {
        let out = turn(k, SIDES);
        // The wall looks back at the axis: its x runs to the left of `out`.
        let middle = DVec3::new(out.x * apothem, 0.0, out.y * apothem);
        mesh.append(&side, &upright(middle, xy(-out.y, out.x)));
        let between = turn(2 * k + 1, 2 * SIDES) * (HALF - 0.05);
        mesh.append(
            &column,
            &upright(DVec3::new(between.x, 0.0, between.y), out),
        );
    }

    let y = top;
    let upper = [
        xy(HALF + 0.1, y),
        xy(HALF - 0.12, y),
        xy(HALF - 0.14, y + 0.05),
        xy(HALF - 0.14, y + 0.12),
        xy(HALF - 0.22, y + 0.17),
        xy(HALF - 0.25, y + 0.17),
        xy(HALF - 0.25, y + 0.24),
        xy(HALF - 0.17, y + 0.28),
        xy(HALF + 0.1, y + 0.29),
    ];
    mesh.merge(lathe(Material::Limestone, &upper, ROUND));
    mesh
}

/// The half sphere: ribs with stepped coffers between, springing at y = 0.
fn calotte() -> Mesh {
    let mut mesh = Mesh::default();
    let top = std::f64::consts::FRAC_PI_2 - acos((1.0 - (OCULUS / HALF) * (OCULUS / HALF)).sqrt());
    let sector = std::f64::consts::TAU / SIDES as f64;
    let mut slice = Mesh::default();
    // Rows shrink towards the oculus so that coffers stay about square.
    let mut edges = vec![0.0];
    let mut height = 0.0;
    for k in 0..COFFERS {
        height += direction(0.9 * top * k as f64 / COFFERS as f64).x;
        edges.push(height);
    }
    let edges: Vec<f64> = edges.iter().map(|e| e / height * top).collect();
    for row in edges.windows(2) {
        slice.merge(coffer([-sector / 2.0, sector / 2.0], [row[0], row[1]]));
    }
    let slice = slice.smooth(25.0);
    let meridian: Vec<DVec3> = (0..=12)
        .map(|k| {
            let up = direction(top * f64::from(k) / 12.0) * (HALF + 0.02);
            DVec3::new(up.x, up.y, 0.0)
        })
        .collect();
    let mut profile = vec![xy(-0.11, -0.08), xy(-0.11, 0.08)];
    profile.extend(arc(xy(0.0, 0.09), 0.06, 180.0, 0.0, 3));
    profile.extend([xy(0.11, 0.08), xy(0.11, -0.08)]);
    let ridge = rib(Material::Limestone, &meridian, DVec3::Z, &profile);
    for k in 0..SIDES {
        mesh.append(&slice, &upright(DVec3::ZERO, turn(k, SIDES)));
        mesh.append(&ridge, &upright(DVec3::ZERO, turn(2 * k + 1, 2 * SIDES)));
    }
    mesh
}

/// One cell of the sphere between two longitudes and two latitudes, sunk in two steps round a
/// rosette.
fn coffer(longitude: [f64; 2], latitude: [f64; 2]) -> Mesh {
    const CUTS: usize = 3;
    let on_sphere = |a: f64, b: f64, radius: f64| {
        let (along, up) = (direction(a), direction(b));
        DVec3::new(up.x * along.x, up.y, up.x * along.y) * radius
    };
    // Margins in metres keep the frames even where the cell narrows.
    let frame = |inset: f64, radius: f64| {
        let latitudes = [latitude[0] + inset / HALF, latitude[1] - inset / HALF];
        let point = |s: f64, t: f64| {
            let b = latitudes[0] + (latitudes[1] - latitudes[0]) * t;
            let half = (longitude[1] - longitude[0]) / 2.0 - inset / (HALF * direction(b).x);
            on_sphere((2.0 * s - 1.0) * half, b, radius)
        };
        (0..=CUTS)
            .map(|j| {
                let t = j as f64 / CUTS as f64;
                (0..=CUTS)
                    .map(|i| point(i as f64 / CUTS as f64, t))
                    .collect::<Vec<_>>()
            })
            .collect::<Vec<_>>()
    };
    let border = |rows: &[Vec<DVec3>]| {
        let mut ring: Vec<DVec3> = rows[0].clone();
        ring.extend(rows[1..].iter().map(|r| r[CUTS]));
        ring.extend(rows[CUTS][..CUTS].iter().rev());
        ring.extend(rows[..CUTS].iter().rev().map(|r| r[0]));
        ring
    };
    let levels = [
        (0.0, 0.0),
        (0.17, 0.0),
        (0.175, 0.09),
        (0.25, 0.095),
        (0.255, 0.18),
    ];
    let frames: Vec<Vec<Vec<DVec3>>> = levels
        .iter()
        .map(|&(inset, sunk)| frame(inset, HALF + sunk))
        .collect();
    let mut mesh = Mesh::default();
    let rings: Vec<Vec<DVec3>> = frames.iter().map(|f| border(f)).collect();
    mesh.grid(Material::Stucco, &rings);
    mesh.grid(Material::Stucco, &frames[frames.len() - 1]);
    let middle = on_sphere(0.0, (latitude[0] + latitude[1]) / 2.0, HALF + 0.18);
    let size = (HALF * (latitude[1] - latitude[0])).min(1.0);
    let bloom: Vec<DVec2> = [
        (0.2, -0.05),
        (0.18, 0.05),
        (0.09, 0.05),
        (0.06, 0.09),
        (0.0, 0.11),
    ]
    .iter()
    .map(|&(r, y)| xy(r * size, y * size))
    .collect();
    let inwards = -middle.normalize();
    let place = crate::mesh::frame(middle, inwards.any_orthonormal_vector(), inwards);
    mesh.append(&lathe(Material::Limestone, &bloom, 6), &place);
    mesh
}

/// Ring at the oculus, eight lights and a small cap; the oculus at y = 0.
fn lantern() -> Mesh {
    let mut mesh = Mesh::default();
    let r = OCULUS;
    let mut lip = vec![xy(r + 0.35, 0.05), xy(r + 0.3, -0.16)];
    lip.extend(arc(xy(r + 0.13, -0.13), 0.09, -20.0, -190.0, 5));
    lip.extend([
        xy(r + 0.03, 0.0),
        xy(r, 0.05),
        xy(r, 0.15),
        xy(r - 0.12, 0.22),
        xy(r - 0.12, 0.27),
        xy(r + 0.1, 0.3),
    ]);
    mesh.merge(lathe(Material::Limestone, &lip, 24));
    let corner = turn(1, 16);
    let (apothem, half) = (r * corner.x, r * corner.y);
    let window = Window {
        arch: Arch::round(0.16),
        drop: 0.75,
        splay: 0.05,
        depth: 0.15,
        tracery: Tracery::Lancet,
    };
    let hole: Vec<DVec2> = window.hole().iter().map(|p| *p + xy(0.0, 1.3)).collect();
    let wall = super::plan::rectangle(xy(-half, 0.2), xy(half, 1.75));
    let mut side = panel(Material::Limestone, &wall, &[hole]);
    side.append(&window.mesh(), &at(0.0, 1.3, 0.0));
    for k in 0..8 {
        let out = turn(k, 8);
        let middle = DVec3::new(out.x * apothem, 0.0, out.y * apothem);
        mesh.append(&side, &upright(middle, xy(-out.y, out.x)));
    }
    let mut cap = vec![xy(r + 0.1, 1.66), xy(r - 0.1, 1.66), xy(r - 0.12, 1.74)];
    cap.extend(arc(xy(0.0, 1.74), r - 0.06, 0.0, 90.0, 8));
    let last = cap.len() - 1;
    cap[last].x = 0.0;
    mesh.merge(lathe(Material::Stucco, &cap, 24));
    mesh
}
