//! Windows: splayed jambs, tracery and leaded glass; pointed lancets and a rose.

use crate::arch::Arch;
use crate::materials::Material;
use crate::mesh::{Mesh, at};
use crate::polygon::panel;
use crate::sweep::{arc, arch_band, sleeve, xy};
use crate::trig::{degrees, direction, turn};
use glam::DVec2;

const STEPS: usize = 7;

/// What fills the glazed plane.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Tracery {
    /// One light.
    Lancet,
    /// Two lights under a quatrefoil.
    TwoLights,
    /// Three lights under two quatrefoils and a hexafoil.
    ThreeLights,
}

/// A window whose springing is at the origin of its frame: x right, y up, z into the room, the
/// wall's face at z = 0.
#[derive(Clone, Copy)]
pub(super) struct Window {
    /// Arch of the glazed plane.
    pub(super) arch: Arch,
    /// From the springing down to the sill, at the glass.
    pub(super) drop: f64,
    /// Widening of the opening towards the room.
    pub(super) splay: f64,
    /// From the wall's face to the tracery.
    pub(super) depth: f64,
    pub(super) tracery: Tracery,
}

impl Window {
    /// The opening it needs in the wall's face.
    pub(super) fn hole(&self) -> Vec<DVec2> {
        self.arch
            .offset(self.splay)
            .opening(STEPS, self.drop + 1.6 * self.splay)
    }

    /// Jambs, edge roll, tracery and glass.
    pub(super) fn mesh(&self) -> Mesh {
        let inner = self.arch.opening(STEPS, self.drop);
        let mut mesh = sleeve(Material::Ashlar, (&self.hole(), 0.0), (&inner, -self.depth));
        mesh.merge(hood(
            self.arch.offset(self.splay),
            self.drop + 1.6 * self.splay,
        ));
        mesh.merge(traceried(&inner, &self.lights(), self.depth));
        mesh
    }

    /// Openings of the tracery.
    fn lights(&self) -> Vec<Vec<DVec2>> {
        let s = self.arch.half_span;
        let bar = 0.06 + 0.03 * s;
        match self.tracery {
            Tracery::Lancet => vec![self.arch.offset(-bar).opening(STEPS, self.drop - bar)],
            Tracery::TwoLights => {
                let half = (2.0 * s - 3.0 * bar) / 4.0;
                let low = 0.30 * s;
                let mut lights = row_of_lights(
                    &[-half - bar / 2.0, half + bar / 2.0],
                    half,
                    low,
                    self.drop - bar,
                );
                let apex = -low + light(half).rise();
                let y = (apex + self.arch.rise()) / 2.0 - 0.04 * s;
                lights.push(foil(xy(0.0, y), 0.37 * s, 4, 45.0));
                lights
            }
            Tracery::ThreeLights => {
                let half = (2.0 * s - 4.0 * bar) / 6.0;
                let (low, pitch) = (0.35 * s, 2.0 * half + bar);
                let mut lights = row_of_lights(&[-pitch, 0.0, pitch], half, low, self.drop - bar);
                let apex = -low + light(half).rise();
                let r = 0.28 * s;
                for x in [-1.0, 1.0] {
                    lights.push(foil(
                        xy(x * (r + 0.6 * bar), apex + r + 0.2 * bar),
                        r,
                        4,
                        45.0,
                    ));
                }
                let y = apex + 2.75 * r + 1.2 * bar;
                lights.push(foil(xy(0.0, y), 0.95 * r, 6, 0.0));
                lights
            }
        }
    }
}

fn light(half: f64) -> Arch {
    Arch::pointed(half, 1.5 * half)
}

fn row_of_lights(centres: &[f64], half: f64, low: f64, drop: f64) -> Vec<Vec<DVec2>> {
    let opening = light(half).opening(5, drop - low);
    centres
        .iter()
        .map(|&x| opening.iter().map(|p| *p + xy(x, -low)).collect())
        .collect()
}

/// Outline of `lobes` round lobes within `radius` of `centre`; the first lobe at `start` degrees.
pub(super) fn foil(centre: DVec2, radius: f64, lobes: usize, start: f64) -> Vec<DVec2> {
    // Neighbouring lobes meet in cusps: centres at c, lobes of radius radius − c.
    let half_step = 180.0 / lobes as f64;
    let sine = direction(degrees(half_step)).y;
    let lobe = radius * sine * 1.12 / (1.0 + sine * 1.12);
    let c = radius - lobe;
    // Angle on the lobe's circle of the cusp on the ray half-way to the next lobe.
    let ray = direction(degrees(half_step));
    let along = c * ray.x + (lobe * lobe - c * c * ray.y * ray.y).max(0.0).sqrt();
    let cusp = ray * along - xy(c, 0.0);
    let swing = crate::trig::acos(cusp.x / cusp.length()) * 180.0 / std::f64::consts::PI;
    let mut points = Vec::new();
    for k in 0..lobes {
        let angle = start + 2.0 * half_step * k as f64;
        let middle = centre + c * direction(degrees(angle));
        let lobe_arc = arc(middle, lobe, angle - swing, angle + swing, 5);
        points.extend(&lobe_arc[..5]);
    }
    points
}

/// Roll round the room-side edge of an opening.
fn hood(arch: Arch, drop: f64) -> Mesh {
    let mut profile = vec![xy(0.0, -0.05)];
    profile.extend(arc(xy(0.045, 0.0), 0.045, 180.0, 0.0, 3));
    profile.push(xy(0.12, -0.02));
    arch_band(Material::Limestone, arch, drop, &profile, STEPS)
}

/// Stone bars with openings at z = −`depth`, their reveals, and the glass behind.
pub(super) fn traceried(outline: &[DVec2], lights: &[Vec<DVec2>], depth: f64) -> Mesh {
    const REVEAL: f64 = 0.09;
    const BEVEL: f64 = 0.022;
    let mut mesh = Mesh::default();
    let wider: Vec<Vec<DVec2>> = lights.iter().map(|l| grown(l, BEVEL)).collect();
    mesh.append(
        &panel(Material::Limestone, outline, &wider),
        &at(0.0, 0.0, -depth),
    );
    for (light, wide) in lights.iter().zip(&wider) {
        mesh.merge(sleeve(
            Material::Limestone,
            (wide, -depth),
            (light, -depth - BEVEL),
        ));
        mesh.merge(sleeve(
            Material::Limestone,
            (light, -depth - BEVEL),
            (light, -depth - REVEAL),
        ));
        mesh.append(
            &panel(Material::Glass, light, &[]),
            &at(0.0, 0.0, -depth - REVEAL),
        );
    }
    mesh
}

/// The outline moved out by `by` at every point, less at sharp corners.
fn grown(outline: &[DVec2], by: f64) -> Vec<DVec2> {
    let n = outline.len();
    let side = |a: DVec2, b: DVec2| {
        let d = (b - a).normalize();
        xy(d.y, -d.x)
    };
    (0..n)
        .map(|k| {
            let (a, b, c) = (outline[(k + n - 1) % n], outline[k], outline[(k + 1) % n]);
            let (first, last) = (side(a, b), side(b, c));
            b + (first + last) / (1.0 + first.dot(last)).max(0.7) * by
        })
        .collect()
}

/// The rose of the west front, centred on the origin of its frame; see [`Window`].
pub(super) struct Rose {
    pub(super) radius: f64,
    pub(super) splay: f64,
    pub(super) depth: f64,
}

impl Rose {
    fn circle(radius: f64) -> Vec<DVec2> {
        (0..48).map(|k| turn(k, 48) * radius).collect()
    }

    /// The opening it needs in the wall's face.
    pub(super) fn hole(&self) -> Vec<DVec2> {
        Self::circle(self.radius + self.splay)
    }

    /// Jambs, rim, tracery and glass.
    pub(super) fn mesh(&self) -> Mesh {
        let inner = Self::circle(self.radius);
        let mut mesh = Mesh::default();
        // The splay falls in three steps with a roll on each.
        let rings: Vec<(Vec<DVec2>, f64)> = [
            (1.0, 0.0),
            (0.97, 0.05),
            (0.7, -0.02),
            (0.66, -0.2),
            (0.36, -0.22),
            (0.32, -0.4),
            (0.0, -0.44),
        ]
        .iter()
        .map(|&(f, z): &(f64, f64)| {
            let depth = if z == -0.44 { -self.depth } else { z };
            (Self::circle(self.radius + f * self.splay), depth)
        })
        .collect();
        for pair in rings.windows(2) {
            mesh.merge(sleeve(
                Material::Limestone,
                (&pair[0].0, pair[0].1),
                (&pair[1].0, pair[1].1),
            ));
        }
        mesh.merge(traceried(&inner, &self.lights(), self.depth));
        mesh
    }

    /// A hexafoil, twelve petals about it and twelve rounds between their tips.
    fn lights(&self) -> Vec<Vec<DVec2>> {
        let r = self.radius;
        let mut lights = vec![foil(DVec2::ZERO, 0.22 * r, 6, 0.0)];
        for k in 0..12 {
            let out = turn(k, 12);
            let across = out.perp();
            let petal = [
                (0.31, 0.035),
                (0.60, 0.105),
                (0.66, 0.11),
                (0.715, 0.095),
                (0.755, 0.06),
                (0.775, 0.0),
            ];
            let right = petal.iter().map(|&(a, w)| r * (out * a - across * w));
            let left = petal
                .iter()
                .rev()
                .skip(1)
                .map(|&(a, w)| r * (out * a + across * w));
            lights.push(right.chain(left).collect());
            let between = turn(2 * k + 1, 24);
            lights.push(
                (0..8)
                    .map(|j| r * (between * 0.86 + turn(j, 8) * 0.085))
                    .collect(),
            );
        }
        lights
    }
}
