//! Particles leaving the scene's own lights.

use std::f32::consts::PI;

use glam::Vec3;
use light_tree::{Cone, EnvironmentCell, LightSet, SpotCone, TriangleLight, luminance};
use sampling::{
    Discrete, Frame, Rng, cosine_hemisphere, uniform_cone, uniform_disc, uniform_sphere,
    uniform_triangle,
};
use scene::{Emitter, Scene};

/// The scene's lights themselves, which light the scene directly.
pub fn source_lights(scene: &Scene) -> LightSet {
    let mut set = LightSet::default();
    for emitter in &scene.emitters {
        match *emitter {
            Emitter::Point {
                position,
                intensity,
            } => set.push_point(position, intensity),
            Emitter::Spot {
                position,
                direction,
                intensity,
                cos_inner,
                cos_outer,
            } => {
                let cone = SpotCone {
                    cos_inner,
                    cos_outer,
                };
                set.push_spot(position, direction, intensity, cone)
            }
            Emitter::Directional {
                direction,
                irradiance,
            } => set.push_directional(direction, irradiance),
            Emitter::Triangle {
                triangle,
                radiance,
                peak,
            } => {
                let t = triangle as usize;
                set.push_triangle(&TriangleLight {
                    corners: scene.mesh.corners(t),
                    intensity: radiance * scene.mesh.area(t),
                    peak,
                    // Rounding of the point itself is a part of the offset.
                    offset: 2.0 * scene.ray_offset(t),
                    element: triangle,
                })
            }
        };
    }
    let cells = scene.environment.iter().flat_map(|e| e.cells());
    for (cell, element) in cells.zip(0..) {
        set.push_environment(&EnvironmentCell {
            travel: Cone {
                axis: -cell.middle,
                cos: cell.cos,
            },
            irradiance: cell.irradiance,
            peak: cell.peak,
            element,
        });
    }
    set
}

/// Where particles start: a light by its power, then a place and a direction by its emission.
pub(crate) struct Sources<'a> {
    scene: &'a Scene,
    /// Over the emitters, and the environment behind them.
    choice: Discrete,
    /// A sphere around everything that light can meet.
    centre: Vec3,
    radius: f32,
}

/// A particle about to fly.
pub(crate) struct Particle {
    pub(crate) origin: Vec3,
    pub(crate) direction: Vec3,
    /// Power it stands for, W.
    pub(crate) flux: Vec3,
}

impl<'a> Sources<'a> {
    /// `None` when no light has power.
    pub(crate) fn new(scene: &'a Scene) -> Option<Self> {
        let positions = &scene.mesh.positions;
        let (lo, hi) = positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| {
                (lo.min(*p), hi.max(*p))
            });
        let (centre, radius) = match positions.is_empty() {
            true => (Vec3::ZERO, 0.0),
            false => (lo.midpoint(hi), 0.5 * (hi - lo).length()),
        };
        let section = PI * radius * radius;
        let emitters = scene.emitters.iter();
        let powers = emitters.map(|e| f64::from(luminance(power(scene, e, section))));
        let environment = scene.environment.as_ref();
        let environment = environment.map_or(0.0, |e| e.total() * f64::from(section));
        Some(Self {
            scene,
            choice: Discrete::new(powers.chain([environment]))?,
            centre,
            radius,
        })
    }

    /// Particle for `u` in [0, 1), which chooses the light; it stands for all the lights' power.
    pub(crate) fn emit(&self, u: f64, rng: &mut Rng) -> Particle {
        let i = self.choice.sample(u);
        let particle = match self.scene.emitters.get(i) {
            Some(emitter) => self.emit_from(emitter, rng),
            None => self.emit_from_environment(rng),
        };
        Particle {
            flux: particle.flux / self.choice.pmf(i) as f32,
            ..particle
        }
    }

    /// A particle that stands for the power of one emitter.
    fn emit_from(&self, emitter: &Emitter, rng: &mut Rng) -> Particle {
        let section = PI * self.radius * self.radius;
        match *emitter {
            Emitter::Point { position, .. } => Particle {
                origin: position,
                direction: uniform_sphere([rng.f32(), rng.f32()]),
                flux: power(self.scene, emitter, section),
            },
            Emitter::Spot {
                position,
                direction,
                intensity,
                cos_inner,
                cos_outer,
            } => {
                let local = uniform_cone(1.0 - cos_outer, [rng.f32(), rng.f32()]);
                let cone = SpotCone {
                    cos_inner,
                    cos_outer,
                };
                let solid_angle = 2.0 * PI * (1.0 - cos_outer);
                Particle {
                    origin: position,
                    direction: Frame::around(direction).to_world(local),
                    flux: intensity * (cone.falloff(local.z) * solid_angle),
                }
            }
            Emitter::Directional { direction, .. } => Particle {
                origin: self.outside(direction, rng),
                direction,
                flux: power(self.scene, emitter, section),
            },
            Emitter::Triangle { triangle, .. } => {
                let t = triangle as usize;
                let [u, v] = uniform_triangle([rng.f32(), rng.f32()]);
                let point = self.scene.emitter_point(t, u, v);
                let side = if rng.f32() < 0.5 { 1.0 } else { -1.0 };
                let normal = point.normal() * side;
                let (local, _) = cosine_hemisphere([rng.f32(), rng.f32()]);
                Particle {
                    origin: point.off(normal),
                    direction: Frame::around(normal).to_world(local),
                    flux: self.scene.emitted(t, u, v) * (2.0 * PI * point.area()),
                }
            }
        }
    }

    fn emit_from_environment(&self, rng: &mut Rng) -> Particle {
        let drawn = self
            .scene
            .environment
            .as_ref()
            .map(|e| e.sample(rng.f64(), [rng.f32(), rng.f32()]));
        // Only an environment has power behind the emitters.
        let (direction, irradiance) = drawn.map_or((Vec3::Y, Vec3::ZERO), |drawn| {
            (-drawn.direction, drawn.power)
        });
        Particle {
            origin: self.outside(direction, rng),
            direction,
            flux: irradiance * (PI * self.radius * self.radius),
        }
    }

    /// A place before the sphere around everything, on a disc as wide as the sphere and across `direction`.
    fn outside(&self, direction: Vec3, rng: &mut Rng) -> Vec3 {
        let [x, y] = uniform_disc([rng.f32(), rng.f32()]);
        // A little before: what touches the sphere is met as well.
        let across = Frame::around(direction).to_world(Vec3::new(x, y, -1.001));
        self.centre + across * self.radius
    }
}

/// Total power, W; of distant light what passes through a `section` of the scene.
fn power(scene: &Scene, emitter: &Emitter, section: f32) -> Vec3 {
    match *emitter {
        Emitter::Point { intensity, .. } => intensity * (4.0 * PI),
        Emitter::Spot {
            intensity,
            cos_inner,
            cos_outer,
            ..
        } => {
            let cone = SpotCone {
                cos_inner,
                cos_outer,
            };
            intensity * cone.solid_angle()
        }
        Emitter::Directional { irradiance, .. } => irradiance * section,
        Emitter::Triangle {
            triangle, radiance, ..
        } => radiance * (2.0 * PI * scene.mesh.area(triangle as usize)),
    }
}
