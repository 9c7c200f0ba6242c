//! Profiles swept along paths: turned shafts, moulded piers, arches, ribs and cornices.
//!
//! A profile is a list of points in (outward, along) coordinates that each function explains;
//! what it returns is smoothed within the part and stands in its own frame.

use crate::arch::Arch;
use crate::materials::Material;
use crate::mesh::Mesh;
use crate::trig::{direction, turn};
use glam::{DAffine3, DVec2, DVec3};

/// Faces closer than this share normals: arcs are cut finer, mouldings' edges are sharper.
const CREASE: f64 = 40.0;

/// Short for a profile or outline point.
pub(crate) const fn xy(x: f64, y: f64) -> DVec2 {
    DVec2::new(x, y)
}

/// Whether a path returns to where it began.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Path {
    /// Ends where it stops.
    Open,
    /// Last point is joined to the first.
    Closed,
}

/// `profile` of (radius, height) turned about the y axis.
pub(crate) fn lathe(material: Material, profile: &[DVec2], segments: usize) -> Mesh {
    let around: Vec<DVec2> = (0..=segments)
        .map(|k| turn(k % segments, segments))
        .collect();
    revolve(material, profile, &around)
}

/// [`lathe`] through 220° about +z only, for shafts whose back stands in a wall.
pub(crate) fn half_lathe(material: Material, profile: &[DVec2], segments: usize) -> Mesh {
    revolve(
        material,
        profile,
        &arc(DVec2::ZERO, 1.0, -20.0, 200.0, segments),
    )
}

fn revolve(material: Material, profile: &[DVec2], around: &[DVec2]) -> Mesh {
    let mut mesh = Mesh::default();
    let rows: Vec<Vec<DVec3>> = around
        .iter()
        .map(|out| {
            profile
                .iter()
                .map(|p| DVec3::new(p.x * out.x, p.y, p.x * out.y))
                .collect()
        })
        .collect();
    mesh.grid(material, &rows);
    mesh.smooth(CREASE)
}

/// `profile` of (offset, height) run round a plan `outline` in (x, z).
///
/// Offsets point to the right of the direction of travel: outwards where the outline turns
/// counter-clockwise in (x, z). Corners are mitred.
pub(crate) fn mould(material: Material, outline: &[DVec2], path: Path, profile: &[DVec2]) -> Mesh {
    let n = outline.len();
    let side = |a: DVec2, b: DVec2| {
        let d = (b - a).normalize();
        xy(d.y, -d.x)
    };
    let row = |k: usize| {
        let (before, here, after) = (outline[(k + n - 1) % n], outline[k], outline[(k + 1) % n]);
        let open = path == Path::Open;
        let first = if open && k == 0 {
            side(here, after)
        } else {
            side(before, here)
        };
        let last = if open && k + 1 == n {
            first
        } else {
            side(here, after)
        };
        // Mitre of unit sides; sharp turns are cut short so that offsets stay near the corner.
        let mitre = (first + last) / (1.0 + first.dot(last)).max(0.4);
        let place = |p: &DVec2| DVec3::new(here.x + mitre.x * p.x, p.y, here.y + mitre.y * p.x);
        profile.iter().map(place).collect::<Vec<_>>()
    };
    let count = if path == Path::Closed { n + 1 } else { n };
    let rows: Vec<Vec<DVec3>> = (0..count).map(|k| row(k % n)).collect();
    let mut mesh = Mesh::default();
    mesh.grid(material, &rows);
    mesh.smooth(CREASE)
}

/// `profile` of (offset from `arch`, depth z) swept along the arch and `drop` metres down its
/// jambs; springing on y = 0. The halves keep the crease at a pointed apex.
pub(crate) fn arch_band(
    material: Material,
    arch: Arch,
    drop: f64,
    profile: &[DVec2],
    steps: usize,
) -> Mesh {
    let paths: Vec<Vec<DVec2>> = profile
        .iter()
        .map(|p| {
            let curve = arch.offset(p.x).right(steps);
            let foot = (drop > 0.0).then(|| xy(curve[0].x, -drop));
            foot.into_iter().chain(curve).collect()
        })
        .collect();
    let rows: Vec<Vec<DVec3>> = (0..paths[0].len())
        .map(|k| {
            paths
                .iter()
                .zip(profile)
                .map(|(path, p)| path[k].extend(p.y))
                .collect()
        })
        .collect();
    let mut half = Mesh::default();
    half.grid(material, &rows);
    let half = half.smooth(CREASE);
    let mut mesh = Mesh::default();
    mesh.append_with_mirror_x(&half, &DAffine3::IDENTITY);
    mesh
}

/// `profile` of (sideways, hanging) swept along a `curve` in a plane with unit normal `side`;
/// hanging is measured square to the curve, downwards where the curve is level.
pub(crate) fn rib(material: Material, curve: &[DVec3], side: DVec3, profile: &[DVec2]) -> Mesh {
    let n = curve.len();
    let across =
        |k: usize| side.cross((curve[(k + 1).min(n - 1)] - curve[k.saturating_sub(1)]).normalize());
    let sign = if across(n / 2).dot(inward(curve)) >= 0.0 {
        1.0
    } else {
        -1.0
    };
    let rows: Vec<Vec<DVec3>> = (0..n)
        .map(|k| {
            let hang = sign * across(k);
            profile
                .iter()
                .map(|p| curve[k] + side * p.x + hang * p.y)
                .collect()
        })
        .collect();
    let mut mesh = Mesh::default();
    mesh.grid(material, &rows);
    mesh.smooth(CREASE)
}

/// From the curve's middle towards its chord (or down, for a straight one).
fn inward(curve: &[DVec3]) -> DVec3 {
    let (first, last) = (curve[0], curve[curve.len() - 1]);
    (first + last) / 2.0 - curve[curve.len() / 2] - DVec3::Y * 1e-3
}

/// Points of the arc about `centre` from `from` to `to` degrees, both included.
pub(crate) fn arc(centre: DVec2, radius: f64, from: f64, to: f64, steps: usize) -> Vec<DVec2> {
    (0..=steps)
        .map(|k| {
            let angle = from + (to - from) * k as f64 / steps as f64;
            centre + radius * direction(crate::trig::degrees(angle))
        })
        .collect()
}

/// Joins two outlines of equal length in the planes z = `from_z` and z = `to_z`.
pub(crate) fn sleeve(material: Material, from: (&[DVec2], f64), to: (&[DVec2], f64)) -> Mesh {
    let closed = |points: &[DVec2], z: f64| {
        points
            .iter()
            .chain(points.first())
            .map(|p| p.extend(z))
            .collect::<Vec<_>>()
    };
    let mut mesh = Mesh::default();
    mesh.grid(material, &[closed(from.0, from.1), closed(to.0, to.1)]);
    mesh.smooth(CREASE)
}
