//! Lights in proportion to what each can bring the point at hand, found by looking at all of them.
//!
//! Source: Shirley, Wang and Zimmerman 1996, "Monte Carlo Techniques for Direct Lighting Calculations", §3:
//! a probability for each light that varies over the scene.

use light_tree::{LightId, LightSet};
use sampling::Rng;
use serde::Deserialize;

use super::{Count, Method};
use crate::Inputs;
use crate::counters::Phase;
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;
use crate::side_by_side::LightSample;
use crate::weight::{rough_weight, unoccluded_weight};

/// Draws `samples` lights with probabilities in proportion to a weight that is worked out for every light at every
/// point: time grows with the number of lights. Unbiased; no tree is built.
///
/// With exact weights only visibility and colour leave noise: no other choice of independent lights, made
/// without tracing rays, is better. Samples are spread over the distribution evenly, at one random shift
/// (systematic sampling); a light drawn k times is evaluated once and counted k times.
#[derive(Debug)]
pub struct Importance<'a> {
    spec: ImportanceSpec,
    lights: &'a LightSet,
}

/// Settings of [`Importance`].
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImportanceSpec {
    /// Light samples a point, in 1..=65536.
    pub samples: Count,
    /// How a light is weighed.
    pub weights: LightWeights,
}

/// How [`Importance`] weighs a light for a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum LightWeights {
    /// What it brings if nothing is in the way; a bound where that is random.
    #[default]
    Exact,
    /// Intensity × cosine at the point / squared distance.
    Cheap,
}

impl<'a> Method<'a> for Importance<'a> {
    type Spec = ImportanceSpec;
    type Scratch = SystematicSampler;

    fn prepare(spec: &ImportanceSpec, inputs: &'a Inputs) -> Self {
        Self {
            spec: spec.clone(),
            lights: &inputs.lights,
        }
    }

    fn is_unbiased(&self) -> bool {
        true
    }

    fn point<E: LightEval>(
        &self,
        x: &GatherPoint,
        eval: &mut E,
        rng: &mut Rng,
        sampler: &mut SystematicSampler,
    ) {
        let shape = eval.shape();
        let u = rng.f64();
        sampler.set(self.lights.ids().map(|id| match self.spec.weights {
            LightWeights::Exact => unoccluded_weight(self.lights, shape, x, id, rng),
            LightWeights::Cheap => rough_weight(self.lights, x, id),
        }));
        eval.mark(Phase::Select);
        let drawn = sampler.draw(self.spec.samples.get(), u);
        eval.add(
            x,
            drawn.map(|(i, scale)| LightSample::new(LightId(i as u32), scale)),
        );
    }
}

/// Draws many times from one discrete distribution, evenly. Memory is kept from one distribution to the next.
#[derive(Debug, Default)]
pub struct SystematicSampler {
    /// `cumulative[i]` = sum of weights 0..=i, in f64.
    cumulative: Vec<f64>,
}

impl SystematicSampler {
    /// Takes the distribution over; each weight is ≥ 0 and finite.
    fn set(&mut self, weights: impl Iterator<Item = f64>) {
        self.cumulative.clear();
        let mut sum = 0.0;
        self.cumulative.extend(weights.map(|w| {
            debug_assert!(w >= 0.0 && w.is_finite(), "weight {w}");
            sum += w;
            sum
        }));
    }

    /// Draws `samples` times, at (k + u) / samples for k = 0, 1, …, and gives each index drawn once, with the number of
    /// times over the number expected. Nothing is drawn when all weights are 0.
    fn draw(&self, samples: u32, u: f64) -> impl Iterator<Item = (usize, f64)> {
        let total = self.cumulative.last().copied().unwrap_or(0.0);
        let step = total / f64::from(samples);
        // Below the total also where the product rounds up to it, so that there is an index for each.
        let target = move |k: u32| ((f64::from(k) + u) * step).min(total.next_down());
        let mut k = if total > 0.0 { 0 } else { samples };
        std::iter::from_fn(move || {
            if k >= samples {
                return None;
            }
            let i = self.cumulative.partition_point(|&c| c <= target(k));
            let end = self.cumulative[i];
            let weight = end - if i == 0 { 0.0 } else { self.cumulative[i - 1] };
            let first = k;
            k += 1;
            while k < samples && target(k) < end {
                k += 1;
            }
            Some((i, f64::from(k - first) * step / weight))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sampling::Purpose;
    use verify::chi_square;

    fn sampler(weights: &[f64]) -> SystematicSampler {
        let mut sampler = SystematicSampler::default();
        sampler.set(weights.iter().copied());
        sampler
    }

    const WEIGHTS: [f64; 8] = [0.0, 1.0, 0.5, 0.0, 7.0, 0.01, 2.0, 0.0];

    #[test]
    fn a_single_draw_has_the_stated_probability() {
        let sampler = sampler(&WEIGHTS);
        let total: f64 = WEIGHTS.iter().sum();
        let mut observed = vec![0; WEIGHTS.len()];
        let mut rng = Rng::new(4, 0, 0, Purpose::Lights);
        for _ in 0..200_000 {
            for (i, scale) in sampler.draw(1, rng.f64()) {
                observed[i] += 1;
                assert!(
                    (scale * WEIGHTS[i] / total - 1.0).abs() < 1e-9,
                    "scale {scale}"
                );
            }
        }
        let fit = chi_square(&observed, &WEIGHTS.map(|w| w / total));
        assert!(fit.p_value > 1e-6, "{fit:?}");
    }

    #[test]
    fn many_draws_are_spread_evenly_and_none_is_lost() {
        let sampler = sampler(&WEIGHTS);
        let total: f64 = WEIGHTS.iter().sum();
        for samples in [1, 2, 10, 1000] {
            for u in [0.0, 0.3, 1.0 - f64::EPSILON / 2.0] {
                let mut drawn = 0.0;
                for (i, scale) in sampler.draw(samples, u) {
                    let expected = f64::from(samples) * WEIGHTS[i] / total;
                    let times = scale * expected;
                    assert!(
                        (times - expected).abs() < 1.0 + 1e-9,
                        "{i}: {times} of {expected}"
                    );
                    drawn += times;
                }
                assert!(
                    (drawn - f64::from(samples)).abs() < 1e-6,
                    "{drawn} of {samples}"
                );
            }
        }
    }

    #[test]
    fn nothing_is_drawn_where_nothing_has_weight() {
        for weights in [&[][..], &[0.0, 0.0]] {
            assert_eq!(sampler(weights).draw(10, 0.5).next(), None, "{weights:?}");
        }
    }

    #[test]
    fn a_weight_that_the_sum_swallows_is_never_drawn_with_an_infinite_scale() {
        let sampler = sampler(&[1e30, 1e-30, 1.0]);
        // The last number rounds up to a share of the whole.
        let last = 1.0 - f64::EPSILON / 2.0;
        for u in (0..1000).map(|k| f64::from(k) / 1000.0).chain([last]) {
            for (i, scale) in sampler.draw(3, u) {
                assert!(i == 0 && scale.is_finite(), "drew {i}, scale {scale}");
            }
        }
    }
}
