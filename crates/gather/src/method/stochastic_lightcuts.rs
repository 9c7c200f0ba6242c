//! Stochastic Lightcuts: one light from each cluster of a small cut.
//!
//! Source: Yuksel, "Stochastic Lightcuts", High-Performance Graphics 2019, and its supplement. Kept as
//! published: other methods are measured against it.

use light_tree::{Cut, DeadBranch, LightTree, NodeWeights, Selector};
use sampling::Rng;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use super::refinement::JUST_VISIBLE;
use super::running_total::{RunningTotal, SampledCut};
use super::{Fraction, Method};
use crate::Inputs;
use crate::counters::Phase;
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;

/// Splits the light tree into up to `cut` clusters by error bound and draws one light from each.
///
/// Unbiased with dead branches stopped and clusters split by their bounds alone, which is the default. That is a
/// departure from the published code, which stops by the running total of sampled values and so ties the stopping to the
/// samples: [`Stopping::RunningTotal`].
#[derive(Debug)]
pub struct StochasticLightcuts<'a> {
    spec: StochasticLightcutsSpec,
    tree: Option<&'a LightTree>,
}

/// Settings of [`StochasticLightcuts`].
///
/// Algorithm 1 says nothing of a running total: [`DeadBranches::Retry`] together with [`Stopping::RunningTotal`] is
/// refused.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields, remote = "Self")]
pub struct StochasticLightcutsSpec {
    /// Most clusters, and so most light samples a point, in 1..=65536.
    pub cut: CutSize,
    /// How children are weighed on the way down.
    pub weights: Weights,
    /// What to do when nothing below a node can light the point.
    pub dead_branches: DeadBranches,
    /// When clusters are split no further.
    pub stopping: Stopping,
}

impl<'de> Deserialize<'de> for StochasticLightcutsSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // The derived function of the same name, without a trait.
        let spec = Self::deserialize(deserializer)?;
        if spec.dead_branches == DeadBranches::Retry && spec.stopping != Stopping::Bounds {
            return Err(D::Error::custom(
                "found dead_branches: Retry with stopping: RunningTotal; expected one of them",
            ));
        }
        Ok(spec)
    }
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

/// When a cut is refined no further.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
pub enum Stopping {
    /// When it has all its clusters, or only single lights.
    #[default]
    Bounds,
    /// As soon as no cluster can be off by more than a share of the total that was sampled so far, as in the published
    /// code; biased, for that total is random.
    RunningTotal(RunningTotalSpec),
}

/// Settings of [`Stopping::RunningTotal`].
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RunningTotalSpec {
    /// Greatest error bound of a cluster as a share of the running total.
    pub error: Fraction,
}

impl Default for RunningTotalSpec {
    fn default() -> Self {
        Self {
            error: JUST_VISIBLE,
        }
    }
}

impl StochasticLightcutsSpec {
    fn dead_branch(&self) -> DeadBranch {
        match self.dead_branches {
            DeadBranches::Stop => DeadBranch::Stop,
            DeadBranches::Retry => DeadBranch::Retry,
        }
    }
}

/// Memory of [`StochasticLightcuts`], kept from point to point.
#[derive(Debug, Default)]
pub struct StochasticLightcutsScratch {
    cut: Cut,
    selector: Selector,
    sampled: SampledCut,
}

impl<'a> Method<'a> for StochasticLightcuts<'a> {
    type Spec = StochasticLightcutsSpec;
    type Scratch = StochasticLightcutsScratch;

    fn prepare(spec: &StochasticLightcutsSpec, inputs: &'a Inputs) -> Self {
        Self {
            spec: spec.clone(),
            tree: inputs.tree(),
        }
    }

    fn is_unbiased(&self) -> bool {
        self.spec.dead_branches == DeadBranches::Stop && self.spec.stopping == Stopping::Bounds
    }

    fn point<E: LightEval>(
        &self,
        x: &GatherPoint,
        eval: &mut E,
        rng: &mut Rng,
        StochasticLightcutsScratch {
            cut,
            selector,
            sampled,
        }: &mut StochasticLightcutsScratch,
    ) {
        let Some(tree) = self.tree else { return };
        let weights = self.spec.weights.node_weights();
        let size = self.spec.cut.get();
        if let Stopping::RunningTotal(RunningTotalSpec { error }) = self.spec.stopping {
            let mut running = RunningTotal::new(tree, weights, x, eval, rng);
            running.refine(sampled, size, error.get());
            eval.add_radiance(x, sampled.sum());
            return;
        }
        cut.refine(tree, weights, &x.receiver, size);
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
