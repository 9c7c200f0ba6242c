//! Stochastic Lightcuts: one light from each cluster of a small cut.
//!
//! Source: Yuksel, "Stochastic Lightcuts", High-Performance Graphics 2019, and its supplement. Kept as
//! published: other methods are measured against it.

use light_tree::{
    Cut, Cuts, DeadBranch, LightSet, LightTree, NodeWeights, Receiver, Selected, Start,
};
use sampling::{Numbers, Purpose, Rng};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use super::ahead::{Ahead, first_points};
use super::refinement::JUST_VISIBLE;
use super::running_total::{RunningTotal, SampledCut};
use super::shared_cuts::{BlockEdge, SharedCuts};
use super::{Count, Fraction, Method};
use crate::Inputs;
use crate::counters::Phase;
use crate::learned::Learned;
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;
use crate::side_by_side::LightSample;
use crate::tile_points::TilePoints;

/// Splits the light tree into up to `cut` clusters by error bound and draws one light from each.
///
/// Unbiased with dead branches stopped and clusters split by their bounds alone, which is the default. That is a
/// departure from the published code, which stops by the running total of sampled values and so ties the stopping to the
/// samples: [`Stopping::RunningTotal`].
#[derive(Debug)]
pub struct StochasticLightcuts<'a> {
    spec: StochasticLightcutsSpec,
    tree: Option<&'a LightTree>,
    lights: &'a LightSet,
}

/// Settings of [`StochasticLightcuts`].
///
/// [`Stopping::RunningTotal`] is refused together with [`DeadBranches::Retry`], as Algorithm 1 knows no total, with a cut that is
/// shared, as the total is that of one point, and with a roulette, as the total is of what is seen.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields, remote = "Self")]
pub struct StochasticLightcutsSpec {
    /// Most clusters, and so most light samples a point, in 1..=65536.
    pub cut: Count,
    /// How children are weighed on the way down.
    pub weights: Weights,
    /// What to do when nothing below a node can light the point.
    pub dead_branches: DeadBranches,
    /// When clusters are split no further.
    pub stopping: Stopping,
    /// Pixels along the edge of the blocks that share a cut, in 1..=8; 1 for a cut at every point.
    pub share: BlockEdge,
    /// Lights that would add less than this share of what a point's lights add on average, in 0..=1, are traced by chance, in
    /// proportion; 0 to trace all, as published. 0.3 leaves out up to a third of the rays at hardly more noise.
    pub roulette: Fraction,
}

impl<'de> Deserialize<'de> for StochasticLightcutsSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // The derived function of the same name, without a trait.
        let spec = Self::deserialize(deserializer)?;
        let by_total = spec.stopping != Stopping::Bounds;
        if by_total && spec.dead_branches == DeadBranches::Retry {
            return Err(D::Error::custom(
                "found stopping: RunningTotal with dead_branches: Retry; expected one of them",
            ));
        }
        if by_total && spec.share != BlockEdge::default() {
            return Err(D::Error::custom(
                "found stopping: RunningTotal with share; expected one of them",
            ));
        }
        if by_total && spec.roulette.get() > 0.0 {
            return Err(D::Error::custom(
                "found stopping: RunningTotal with roulette; expected one of them",
            ));
        }
        Ok(spec)
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
    /// As `MinMax`, with regard to what a glossy surface reflects.
    MinMaxGlossy,
    /// As published with adaptive tree splitting in 2018.
    ContyKulla2018,
}

impl Weights {
    pub(super) fn node_weights(self) -> NodeWeights {
        match self {
            Self::Yuksel2019 => NodeWeights::Yuksel2019,
            Self::MinMax => NodeWeights::MinMax,
            Self::MinMaxWithoutCones => NodeWeights::MinMaxWithoutCones,
            Self::MinMaxGlossy => NodeWeights::MinMaxGlossy,
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
    cuts: Cuts,
    starts: Vec<Start>,
    ahead: Ahead<Option<Selected>>,
    sampled: SampledCut,
    shared: SharedCuts,
}

/// Points whose lights are drawn together: so many that hardly any lane is ever idle, so few that all stays in the cache.
const TOGETHER: usize = 2048;

impl StochasticLightcuts<'_> {
    /// Draws lights for `points`, with the random numbers of each.
    fn draw<E: LightEval>(
        &self,
        points: &[GatherPoint],
        stream: impl Fn(&GatherPoint) -> Rng,
        eval: &mut E,
        scratch: &mut StochasticLightcutsScratch,
    ) {
        let Some(tree) = self.tree else { return };
        let weights = self.spec.weights.node_weights();
        let size = self.spec.cut.get() as usize;
        let is_shared = self.spec.share != BlockEdge::default();
        let StochasticLightcutsScratch {
            cuts,
            starts,
            ahead,
            shared,
            ..
        } = scratch;
        ahead.clear();
        for points in points.chunks(TOGETHER) {
            let receivers: Vec<&Receiver> = points.iter().map(|x| &x.receiver).collect();
            if !is_shared {
                cuts.refine(tree, weights, &receivers, size);
            }
            starts.clear();
            // By themselves: each is a long chain of operations, of which the processor follows several at once.
            let numbers: Vec<Numbers> = points.iter().map(|x| stream(x).numbers()).collect();
            for (i, (x, mut numbers)) in points.iter().zip(numbers).enumerate() {
                let nodes = match (is_shared, shared.next()) {
                    (false, _) => cuts.of(i),
                    (true, Some(nodes)) => nodes,
                    (true, None) => {
                        cuts.refine(tree, weights, &receivers[i..=i], size);
                        cuts.of(0)
                    }
                };
                ahead.push(x, nodes.len());
                starts.extend(nodes.iter().map(|&node| Start {
                    receiver: i as u32,
                    node,
                    u: numbers.next().expect("they are endless"),
                }));
            }
            eval.mark(Phase::Cut);
            let dead_branch = self.spec.dead_branch();
            tree.select_each(weights, dead_branch, &receivers, starts, ahead.items());
            eval.mark(Phase::Select);
        }
    }
}

/// Asks for lights of a point whose turn comes.
fn expect<E: LightEval>(lights: &[Option<Selected>], eval: &mut E) {
    for selected in lights.iter().flatten() {
        eval.expect(selected.light);
    }
}

impl<'a> Method<'a> for StochasticLightcuts<'a> {
    type Spec = StochasticLightcutsSpec;
    type Scratch = StochasticLightcutsScratch;

    fn prepare(spec: &StochasticLightcutsSpec, inputs: &'a Inputs) -> Self {
        Self {
            spec: spec.clone(),
            tree: inputs.tree_for(spec.weights.node_weights()),
            lights: &inputs.lights,
        }
    }

    fn is_unbiased(&self) -> bool {
        self.spec.dead_branches == DeadBranches::Stop && self.spec.stopping == Stopping::Bounds
    }

    fn begin_tile<E: LightEval>(
        &self,
        tile: &TilePoints<'_>,
        eval: &mut E,
        _learned: &mut Learned,
        scratch: &mut StochasticLightcutsScratch,
    ) {
        let Some(tree) = self.tree else { return };
        if self.spec.stopping != Stopping::Bounds {
            return;
        }
        let edge = self.spec.share.get();
        if edge > 1 {
            let weights = self.spec.weights.node_weights();
            let size = self.spec.cut.get() as usize;
            scratch
                .shared
                .refine(tile, edge, size, tree, weights, &mut scratch.cut);
        }
        let stream = |x: &GatherPoint| (tile.stream)(x.slot, x.bounce, Purpose::Lights);
        let points = first_points(tile.points, self.spec.cut.get());
        self.draw(points, stream, eval, scratch);
    }

    fn point<E: LightEval>(
        &self,
        x: &GatherPoint,
        eval: &mut E,
        rng: &mut Rng,
        scratch: &mut StochasticLightcutsScratch,
    ) {
        let Some(tree) = self.tree else { return };
        if let Stopping::RunningTotal(RunningTotalSpec { error }) = self.spec.stopping {
            let weights = self.spec.weights.node_weights();
            let size = self.spec.cut.get() as usize;
            let mut running = RunningTotal::new(tree, self.lights, weights, x, eval, rng);
            running.refine(&mut scratch.sampled, size, error.get());
            let total = scratch.sampled.sum(|cluster| cluster.sample.is_source);
            eval.add_radiance(x, total);
            return;
        }
        if !scratch.ahead.has(x) {
            self.draw(std::slice::from_ref(x), |_| rng.clone(), eval, scratch);
            expect(scratch.ahead.coming(0), eval);
        }
        scratch.ahead.turn();
        // The next point's lights have arrived, which were asked for one point earlier, and say what lies behind them.
        for selected in scratch.ahead.coming(0).iter().flatten() {
            eval.expect_soon(selected.light);
        }
        expect(scratch.ahead.coming(1), eval);
        let drawn = scratch.ahead.now();
        for _ in drawn.iter().filter(|selected| selected.is_none()) {
            eval.count_dead();
        }
        let sample = |s: &Selected| LightSample::new(s.light, 1.0 / s.pmf);
        eval.add_by_roulette(
            x,
            drawn.iter().flatten().map(sample),
            self.spec.roulette.get(),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contribution::VirtualShape;
    use crate::method::MethodSpec;
    use crate::method::conformance::{Estimates, gather_points, light_sets, room, running};
    use crate::method::fixtures::{all_lights, at};
    use glam::{DVec3, Vec3};
    use light_tree::{LightSet, TreeBuilder};
    use scene::trace::{Hit, Tracer};
    use scene::{Material, MaterialId, Mesh, Scene};

    #[test]
    fn a_cut_of_single_lights_is_all_lights() {
        let scene = room(true);
        let tracer = Tracer::build(&scene);
        // Lights that are points leave nothing to chance.
        for (name, lights) in light_sets(&scene, &tracer).into_iter().take(5) {
            let inputs = Inputs::new(lights, TreeBuilder::Binned);
            let spec = StochasticLightcutsSpec {
                cut: Count::of(65536),
                ..Default::default()
            };
            let method = StochasticLightcuts::prepare(&spec, &inputs);
            for x in gather_points(&scene) {
                let value = |sample| {
                    let shape = VirtualShape::Sphere;
                    let (exact, _) = at(&all_lights(&inputs), &inputs, &tracer, shape, &x, sample);
                    let (value, _) = at(&method, &inputs, &tracer, shape, &x, sample);
                    (value, exact)
                };
                for (value, exact) in (0..4).map(value) {
                    let off: DVec3 = (value - exact).abs();
                    assert!(
                        off.max_element() <= 1e-6 * exact.max_element(),
                        "{name} at {}: {value} instead of {exact}",
                        x.position
                    );
                }
            }
        }
    }

    #[test]
    fn samples_that_end_in_a_dead_branch_are_counted() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        let x = gather_points(&scene)[0];
        // Two lights below the point's horizon, whose box reaches above it, and one above.
        let mut lights = LightSet::default();
        let slope = (x.ns + Vec3::X).normalize();
        let (across, p) = (Vec3::Z, x.position);
        let tilted = GatherPoint {
            ns: slope,
            ng: slope,
            receiver: light_tree::Receiver::new(p, slope),
            ..x
        };
        lights.push_point(p + Vec3::new(1.0, -1.5, 0.0) + 0.1 * across, Vec3::ONE);
        lights.push_point(p + Vec3::new(-1.5, 1.0, 0.0), Vec3::ONE);
        lights.push_point(p + Vec3::new(9.0, 9.0, 0.0), Vec3::ONE);
        let inputs = Inputs::new(lights, TreeBuilder::Binned);
        let tree = inputs.tree().expect("has lights");
        let weights = NodeWeights::Yuksel2019;
        let (_, dead) = tree.pmf_below(weights, &tilted.receiver, tree.root());
        assert!(
            dead > 0.05 && dead < 0.95,
            "the case has a dead branch: {dead}"
        );
        let method = MethodSpec::StochasticLightcuts(StochasticLightcutsSpec {
            cut: Count::of(1),
            ..Default::default()
        });
        let count = 10_000;
        let estimates = Estimates {
            scene: &scene,
            inputs: &inputs,
            tracer: &tracer,
            x: tilted,
            count,
            seed: 5,
        };
        let (_, _, counters) = method.visit(&inputs, estimates);
        let expected = f64::from(count) * dead;
        let deviation = (expected * (1.0 - dead)).sqrt();
        let z = (counters.dead_samples as f64 - expected) / deviation;
        // At 5 sigma a false alarm is 6e-7.
        assert!(
            z.abs() < 5.0,
            "{} instead of {expected}",
            counters.dead_samples
        );
    }

    #[test]
    fn roulette_leaves_rays_out() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        let x = gather_points(&scene)[0];
        let mut rng = Rng::new(8, 0, 0, Purpose::Build);
        let mut lights = LightSet::default();
        for _ in 0..200 {
            let offset = Vec3::new(rng.f32(), 0.1 + rng.f32(), rng.f32());
            lights.push_point(x.position + offset, Vec3::ONE);
        }
        let inputs = Inputs::new(lights, TreeBuilder::Binned);
        let rays = |roulette| {
            let method = MethodSpec::StochasticLightcuts(StochasticLightcutsSpec {
                roulette: Fraction::of(roulette),
                ..Default::default()
            });
            let estimates = Estimates {
                scene: &scene,
                inputs: &inputs,
                tracer: &tracer,
                x,
                count: 1000,
                seed: 7,
            };
            let (_, _, counters) = method.visit(&inputs, estimates);
            assert_eq!(counters.light_samples, 10_000, "all are looked at");
            counters.shadow_rays
        };
        let [all, some, few] = [0.0, 0.3, 1.0].map(rays);
        // Nothing is random here but by the seed above.
        assert!(some < all && few < some, "{all}, {some}, {few} rays");
    }

    /// A polished floor below two thousand lamps.
    fn polished_floor() -> (Scene, LightSet) {
        let mut mesh = Mesh {
            positions: [
                [-5.0, 0.0, -5.0],
                [-5.0, 0.0, 5.0],
                [5.0, 0.0, 5.0],
                [5.0, 0.0, -5.0],
            ]
            .map(Vec3::from)
            .to_vec(),
            ..Mesh::default()
        };
        mesh.indices = vec![[0, 1, 2], [0, 2, 3]];
        mesh.materials = vec![MaterialId(0); 2];
        let material = Material {
            diffuse: Vec3::splat(0.2),
            specular: Vec3::splat(0.5),
            alpha: 0.08,
            ..Material::default()
        };
        let mut rng = Rng::new(12, 0, 0, sampling::Purpose::Build);
        let mut lights = LightSet::default();
        for _ in 0..2000 {
            let position = Vec3::new(
                8.0 * rng.f32() - 4.0,
                1.5 + rng.f32(),
                8.0 * rng.f32() - 4.0,
            );
            lights.push_point(position, Vec3::splat(0.5 + rng.f32()));
        }
        let scene = Scene {
            mesh,
            materials: vec![material],
            ..Scene::default()
        };
        (scene, lights)
    }

    #[test]
    fn lamps_in_the_mirror_direction_of_a_polished_floor_are_found() {
        let (scene, lights) = polished_floor();
        let tracer = Tracer::build(&scene);
        let inputs = Inputs::new(lights, TreeBuilder::Binned);
        // Relative variance of a channel, on average over points seen steeply and at grazing angles.
        let variance = |weights| {
            let method = MethodSpec::StochasticLightcuts(StochasticLightcutsSpec {
                weights,
                ..Default::default()
            });
            let mut sum = 0.0;
            let at = [(0.1, 0.2), (0.4, 0.5), (0.3, 0.3), (0.2, 0.6)];
            for (k, (u, v)) in at.into_iter().enumerate() {
                let hit = Hit {
                    t: 1.0,
                    triangle: k as u32 % 2,
                    u,
                    v,
                };
                let direction = Vec3::new(0.6, -0.2 - 0.2 * k as f32, 0.3).normalize();
                let surface = scene.surface(&hit, direction);
                let estimates = Estimates {
                    scene: &scene,
                    inputs: &inputs,
                    tracer: &tracer,
                    x: GatherPoint::new(&surface, -direction, Vec3::ONE, 0),
                    count: 2000,
                    seed: 6,
                };
                let (_, values, _) = method.visit(&inputs, estimates);
                let of = running(&values, 0);
                sum += of.variance() / (of.mean() * of.mean());
            }
            sum / at.len() as f64
        };
        let (blind, seeing) = (variance(Weights::MinMax), variance(Weights::MinMaxGlossy));
        // Nothing is random here but by the seeds above.
        assert!(
            seeing < 0.25 * blind,
            "{seeing} with regard to the lobe, {blind} without"
        );
    }
}
