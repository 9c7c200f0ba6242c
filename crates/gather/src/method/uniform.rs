//! Any light with the same probability: what every other choice is measured against.

use light_tree::LightId;
use sampling::Rng;
use serde::Deserialize;

use super::{Count, Method};
use crate::Inputs;
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;
use crate::side_by_side::LightSample;

/// Draws `samples` lights, each of n with probability 1/n, independently. Unbiased; no tree is built.
#[derive(Debug)]
pub struct Uniform {
    samples: Count,
    lights: usize,
}

/// Settings of [`Uniform`].
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct UniformSpec {
    /// Light samples a point, in 1..=65536.
    pub samples: Count,
}

impl<'a> Method<'a> for Uniform {
    type Spec = UniformSpec;
    type Scratch = ();

    fn prepare(spec: &UniformSpec, inputs: &'a Inputs) -> Self {
        Self {
            samples: spec.samples,
            lights: inputs.lights.len(),
        }
    }

    fn is_unbiased(&self) -> bool {
        true
    }

    fn point<E: LightEval>(&self, x: &GatherPoint, eval: &mut E, rng: &mut Rng, (): &mut ()) {
        if self.lights == 0 {
            return;
        }
        let n = self.lights as f64;
        let scale = n / f64::from(self.samples.get());
        let draw = |_| {
            // u < 1, but u n may round up to n.
            let i = ((rng.f64() * n) as usize).min(self.lights - 1);
            LightSample::new(LightId(i as u32), scale)
        };
        eval.add(x, (0..self.samples.get()).map(draw));
    }
}
