//! Particles leaving the scene's own lights.

use std::f32::consts::PI;

use glam::Vec3;
use light_tree::{LightSet, luminance};
use sampling::{Discrete, Rng, uniform_sphere};
use scene::Emitter;

/// The scene's lights themselves, which light the scene directly.
pub fn source_lights(emitters: &[Emitter]) -> LightSet {
    let mut set = LightSet::default();
    for emitter in emitters {
        match *emitter {
            Emitter::Point {
                position,
                intensity,
            } => set.push_point(position, intensity),
        };
    }
    set
}

/// Where particles start: a light by its power, then a direction by its emission.
pub(crate) struct Sources<'a> {
    emitters: &'a [Emitter],
    choice: Discrete,
}

/// A particle about to fly.
pub(crate) struct Particle {
    pub(crate) origin: Vec3,
    pub(crate) direction: Vec3,
    /// Power it stands for, W.
    pub(crate) flux: Vec3,
}

/// Total power, W.
fn power(emitter: &Emitter) -> Vec3 {
    match *emitter {
        Emitter::Point { intensity, .. } => intensity * (4.0 * PI),
    }
}

impl<'a> Sources<'a> {
    /// `None` when no light has power.
    pub(crate) fn new(emitters: &'a [Emitter]) -> Option<Self> {
        let choice = Discrete::new(emitters.iter().map(|e| f64::from(luminance(power(e)))))?;
        Some(Self { emitters, choice })
    }

    /// Particle for `u` in [0, 1), which chooses the light; it stands for all the lights' power.
    pub(crate) fn emit(&self, u: f64, rng: &mut Rng) -> Particle {
        let i = self.choice.sample(u);
        let flux = power(&self.emitters[i]) / self.choice.pmf(i) as f32;
        match self.emitters[i] {
            Emitter::Point { position, .. } => Particle {
                origin: position,
                direction: uniform_sphere([rng.f32(), rng.f32()]),
                flux,
            },
        }
    }
}
