//! Stochastic Lightcuts: one light from each cluster of a small cut.
//!
//! Source: Yuksel, "Stochastic Lightcuts", High-Performance Graphics 2019, and its supplement. Kept as
//! published: other methods are measured against it.

use light_tree::{Cut, DeadBranch, LightTree, NodeWeights, Selector};
use sampling::Rng;
use serde::Deserialize;

use super::Method;
use crate::Inputs;
use crate::counters::Phase;
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;

/// Splits the light tree into up to `cut` clusters by error bound and draws one light from each.
///
/// Unbiased with dead branches stopped. One departure from the paper: clusters are split by their bounds
/// alone, never by the running total of sampled values, which would tie the stopping to the samples.
#[derive(Debug)]
pub struct StochasticLightcuts<'a> {
    spec: StochasticLightcutsSpec,
    tree: Option<&'a LightTree>,
}

/// Settings of [`StochasticLightcuts`].
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StochasticLightcutsSpec {
    /// Most clusters, and so most light samples a point, in 1..=65536.
    pub cut: CutSize,
    /// How children are weighed on the way down.
    pub weights: Weights,
    /// What to do when nothing below a node can light the point.
    pub dead_branches: DeadBranches,
}

/// Number of clusters in a cut, 1..=65536.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "u64")]
pub struct CutSize(pub(super) usize);

impl CutSize {
    /// As a number.
    pub fn get(self) -> usize {
        self.0
    }
}

impl Default for CutSize {
    /// 10, as in the paper.
    fn default() -> Self {
        Self(10)
    }
}

impl TryFrom<u64> for CutSize {
    type Error = String;

    fn try_from(value: u64) -> Result<Self, String> {
        match usize::try_from(value) {
            Ok(size @ 1..=65536) => Ok(Self(size)),
            _ => Err(format!("found {value}; expected 1..=65536")),
        }
    }
}

/// [`NodeWeights`] in a run file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum Weights {
    /// As published in 2019.
    #[default]
    Yuksel2019,
    /// As in the real-time paper of 2020.
    MinMax,
    /// As in the real-time paper of 2020, where lights point is not looked at.
    MinMaxWithoutCones,
    /// As published with adaptive tree splitting in 2018.
    ContyKulla2018,
}

impl Weights {
    pub(super) fn node_weights(self) -> NodeWeights {
        match self {
            Self::Yuksel2019 => NodeWeights::Yuksel2019,
            Self::MinMax => NodeWeights::MinMax,
            Self::MinMaxWithoutCones => NodeWeights::MinMaxWithoutCones,
            Self::ContyKulla2018 => NodeWeights::ContyKulla2018,
        }
    }
}

/// [`DeadBranch`] in a run file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum DeadBranches {
    /// The sample is worth 0; unbiased.
    #[default]
    Stop,
    /// Algorithm 1 to the letter; too bright.
    Retry,
}

impl StochasticLightcutsSpec {
    fn dead_branch(&self) -> DeadBranch {
        match self.dead_branches {
            DeadBranches::Stop => DeadBranch::Stop,
            DeadBranches::Retry => DeadBranch::Retry,
        }
    }
}

impl<'a> Method<'a> for StochasticLightcuts<'a> {
    type Spec = StochasticLightcutsSpec;
    type Scratch = (Cut, Selector);

    fn prepare(spec: &StochasticLightcutsSpec, inputs: &'a Inputs) -> Self {
        Self {
            spec: spec.clone(),
            tree: inputs.tree(),
        }
    }

    fn is_unbiased(&self) -> bool {
        self.spec.dead_branches == DeadBranches::Stop
    }

    fn point<E: LightEval>(
        &self,
        x: &GatherPoint,
        eval: &mut E,
        rng: &mut Rng,
        (cut, selector): &mut (Cut, Selector),
    ) {
        let Some(tree) = self.tree else { return };
        let weights = self.spec.weights.node_weights();
        cut.refine(tree, weights, &x.receiver, self.spec.cut.get());
        eval.mark(Phase::Cut);
        let drawn = selector.select(
            tree,
            weights,
            self.spec.dead_branch(),
            &x.receiver,
            cut.nodes(),
            || rng.f64(),
        );
        eval.mark(Phase::Select);
        for selected in drawn {
            match selected {
                Some(s) => eval.add(x, s.light, 1.0 / s.pmf),
                None => eval.count_dead(),
            }
        }
    }
}
