//! Importance sampling of the tree, split where one light cannot stand for all.
//!
//! Source: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting".

use light_tree::{EnergyVariance, LightTree, Selected, Splitter, SplittingRule};
use sampling::Rng;
use serde::Deserialize;

use super::stochastic_lightcuts::Weights;
use super::{Count, Fraction, Method};
use crate::Inputs;
use crate::counters::Phase;
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;
use crate::side_by_side::LightSample;

/// Descends the light tree from its root, into both children where the lights below differ much for the point and
/// into one, drawn by importance, elsewhere; `samples` times over, and takes the mean. Unbiased.
///
/// Without splitting (`threshold` 0) it is importance sampling of the whole tree with independent samples.
/// Departures from the paper are told where they are made: [`EnergyVariance::deviation`],
/// [`SplittingRule::new`] and [`light_tree::NodeWeights::ContyKulla2018`].
#[derive(Debug)]
pub struct AdaptiveSplitting<'a> {
    spec: AdaptiveSplittingSpec,
    tree: Option<&'a LightTree>,
    rule: SplittingRule,
    variance: Option<&'a EnergyVariance>,
}

/// Settings of [`AdaptiveSplitting`].
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdaptiveSplittingSpec {
    /// How readily clusters are split, from 0 for never to 1 for always: those for which (1 / (1 + σ))^¼ is less.
    pub threshold: Fraction,
    /// Most light samples that splitting may lead to, of one descent, in 1..=65536.
    pub max_samples: Count,
    /// Descents a point, in 1..=65536.
    pub samples: Count,
    /// How children are weighed on the way down.
    pub weights: Weights,
}

impl Default for AdaptiveSplittingSpec {
    fn default() -> Self {
        Self {
            threshold: Fraction::of(0.5),
            max_samples: Count::of(64),
            samples: Count::of(1),
            weights: Weights::ContyKulla2018,
        }
    }
}

impl<'a> Method<'a> for AdaptiveSplitting<'a> {
    type Spec = AdaptiveSplittingSpec;
    type Scratch = Splitter;

    fn prepare(spec: &AdaptiveSplittingSpec, inputs: &'a Inputs) -> Self {
        let rule = SplittingRule::new(spec.threshold.get(), spec.max_samples.get() as usize);
        Self {
            spec: spec.clone(),
            tree: inputs.tree(),
            rule,
            variance: if rule.never_splits() {
                None
            } else {
                inputs.energy_variance()
            },
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
        splitter: &mut Splitter,
    ) {
        let Some(tree) = self.tree else { return };
        let samples = f64::from(self.spec.samples.get());
        for _ in 0..self.spec.samples.get() {
            let drawn = splitter.select(
                tree,
                self.variance,
                self.rule,
                self.spec.weights.node_weights(),
                &x.receiver,
                || rng.f64(),
            );
            eval.mark(Phase::Select);
            for selected in drawn.iter().flatten() {
                eval.expect(selected.light);
            }
            for _ in drawn.iter().filter(|selected| selected.is_none()) {
                eval.count_dead();
            }
            let sample = |s: &Selected| LightSample::new(s.light, 1.0 / (samples * s.pmf));
            eval.add(x, drawn.iter().flatten().map(sample));
            eval.mark(Phase::Evaluate);
        }
    }
}
