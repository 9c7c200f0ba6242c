//! Every light at every point: the exact answer.

use sampling::Rng;
use serde::Deserialize;

use super::Method;
use crate::Inputs;
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;
use crate::side_by_side::LightSample;

/// Evaluates every light, with a shadow ray for each that is above the horizon. No tree is built.
#[derive(Debug)]
pub struct AllLights<'a> {
    inputs: &'a Inputs,
}

/// It has no settings.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AllLightsSpec {}

impl<'a> Method<'a> for AllLights<'a> {
    type Spec = AllLightsSpec;
    type Scratch = ();

    fn prepare(_: &AllLightsSpec, inputs: &'a Inputs) -> Self {
        Self { inputs }
    }

    fn is_unbiased(&self) -> bool {
        true
    }

    fn point<E: LightEval>(&self, x: &GatherPoint, eval: &mut E, _: &mut Rng, (): &mut ()) {
        let all = self.inputs.lights.ids();
        eval.add(x, all.map(|id| LightSample::new(id, 1.0)));
    }
}
