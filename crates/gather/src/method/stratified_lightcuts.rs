//! Stratified lightcuts: a shared, fine cut, and lights drawn from it so that all samples of a pixel complement each
//! other.
//!
//! What it adds to Stochastic Lightcuts (Yuksel 2019): a cut of hundreds of clusters, made once for a tile and weighed
//! for each patch of surface eight clusters at a time, takes the place of ten clusters a point, but for those too near to be
//! weighed as a whole, which are taken apart; weights estimate rather than bound what a cluster brings, lobes
//! included, and are set right by what a few rays, and then the samples so far, find in the way; and the draws of all of a
//! pixel's samples follow one low-discrepancy sequence along the tree's order, together with the places in the pixel.

use std::ops::Range;

use light_tree::{Descents, Drawn, Draws, Receiver, SharedCut, WideTree, luminance};
use sampling::{Purpose, Rng};
use serde::Deserialize;

use super::ahead::{Ahead, first_points};
use super::patches::Patches;
use super::{Count, Method, probes};
use crate::Inputs;
use crate::counters::Phase;
use crate::learned::{Learned, Trial};
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;
use crate::side_by_side::LightSample;
use crate::tile_points::TilePoints;

/// Weighs a tile's clusters at each point and draws lights at even distances along them. Unbiased.
#[derive(Debug)]
pub struct StratifiedLightcuts<'a> {
    spec: StratifiedLightcutsSpec,
    tree: Option<&'a WideTree>,
}

/// Settings of [`StratifiedLightcuts`].
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StratifiedLightcutsSpec {
    /// Lights a point, in 1..=65536.
    pub samples: Count,
    /// Clusters that a tile shares, in 1..=65536.
    pub clusters: Count,
    /// Whether weights are set right by what reaches the tile, and blocks of 4 × 4 pixels of it, as a few rays and the samples
    /// so far find out.
    pub learn: bool,
    /// Whether clusters that are too near a point, or too wide for its lobe, are taken apart for it.
    pub open: bool,
    /// Whether what lights are drawn by is worked out once for a patch of surface, a few pixels wide, rather than for each point;
    /// done for cuts of up to 4096 clusters, whose weights hundreds of patches can keep.
    pub patches: bool,
    /// Whether the samples of a pixel are stratified jointly rather than drawn one without regard to the other.
    pub stratify: bool,
}

impl Default for StratifiedLightcutsSpec {
    fn default() -> Self {
        Self {
            samples: Count::of(10),
            clusters: Count::of(128),
            learn: true,
            open: true,
            patches: true,
            stratify: true,
        }
    }
}

/// Most clusters of a cut that patches share the weights of: 120 KB each, 30 MB a thread if each pixel sees another.
const MOST_SHARED: u32 = 4096;
/// Clusters of a point that no tile's cut was made for.
const OWN_CLUSTERS: usize = 64;
/// The first sample of a pixel that is drawn by what was learned, and from which is learned: the ones before are to be had at
/// once, and so many are a block of the sequence.
pub(super) const LEARNED_FROM: u32 = 2;
/// Points whose lights are drawn together: a step of all their descents takes longer than memory, and what it reads fits the cache.
const TOGETHER: usize = 32;
/// The sequence's dimension that chooses lights, after the two of the place in the pixel.
pub(super) const LIGHTS: u32 = 2;

/// Memory of [`StratifiedLightcuts`].
#[derive(Debug, Default)]
pub struct StratifiedScratch {
    shared: SharedCut,
    own: SharedCut,
    draws: Draws,
    /// What the weights of the shared clusters are multiplied by, block by block; empty for nothing.
    factors: Vec<f32>,
    /// What arrives typically of a light that is expected to bring 1; 0 when that is not known.
    typical: f64,
    patches: Patches,
    pilots: Vec<GatherPoint>,
    descents: Descents,
    ahead: Ahead<Option<Drawn>>,
}

impl StratifiedScratch {
    /// Whether the tile's cut serves `x`: behind the first hit points lie anywhere, and which path got there is random.
    fn is_shared_by(&self, x: &GatherPoint) -> bool {
        x.bounce == 0 && !self.shared.is_empty()
    }

    /// Which of the factors are those of `x`; none where its clusters are weighed without.
    fn factors_of(&self, x: &GatherPoint) -> Range<usize> {
        if !self.is_shared_by(x) || x.sample < LEARNED_FROM || self.factors.is_empty() {
            return 0..0;
        }
        let count = self.shared.len();
        let first = x.block as usize * count;
        first..first + count
    }
}

impl StratifiedLightcuts<'_> {
    fn has_patches(&self) -> bool {
        self.spec.patches && self.spec.clusters.get() <= MOST_SHARED
    }

    /// Works out what lights are drawn by, for so many `points`.
    fn weigh(
        &self,
        tree: &WideTree,
        cut: &SharedCut,
        receiver: &Receiver,
        factors: &[f32],
        points: u32,
        draws: &mut Draws,
    ) {
        let samples = self.spec.samples.get();
        cut.weigh(tree, receiver, draws);
        draws.scale(factors);
        if self.spec.open {
            cut.open(tree, receiver, samples, points, draws);
        }
        cut.settle(tree, samples, draws);
    }

    /// Draws lights for `points`, with the random numbers of each.
    fn draw<E: LightEval>(
        &self,
        points: &[GatherPoint],
        stream: impl Fn(&GatherPoint) -> Rng,
        eval: &mut E,
        scratch: &mut StratifiedScratch,
    ) {
        let Some(tree) = self.tree else { return };
        scratch.ahead.clear();
        for points in points.chunks(TOGETHER) {
            scratch.descents.clear();
            for x in points {
                self.pick(tree, x, stream(x), eval, scratch);
            }
            scratch.descents.descend(tree);
            for (i, x) in points.iter().enumerate() {
                let drawn = scratch.descents.drawn(i);
                scratch.ahead.push(x, drawn.len());
                scratch.ahead.items().extend(drawn);
            }
            eval.mark(Phase::Select);
        }
    }

    /// Picks the clusters from which lights of `x` are drawn.
    fn pick<E: LightEval>(
        &self,
        tree: &WideTree,
        x: &GatherPoint,
        mut rng: Rng,
        eval: &mut E,
        scratch: &mut StratifiedScratch,
    ) {
        let (is_shared, factors) = (scratch.is_shared_by(x), scratch.factors_of(x));
        let StratifiedScratch {
            shared,
            own,
            draws,
            factors: all_factors,
            patches,
            descents,
            ..
        } = scratch;
        let factors = &all_factors[factors];
        let cut = if is_shared {
            shared
        } else {
            let size = OWN_CLUSTERS.min(self.spec.clusters.get() as usize);
            own.refine(tree, &[x.receiver], size);
            own
        };
        let patch = match is_shared && self.has_patches() {
            true => patches.of(x),
            false => None,
        };
        let draws = match patch {
            None => {
                eval.mark(Phase::Select);
                self.weigh(tree, cut, &x.receiver, factors, 1, draws);
                eval.mark(Phase::Cut);
                draws
            }
            Some(patch) => {
                if !patch.is_ready {
                    eval.mark(Phase::Select);
                    let points = patch.points(x.sample);
                    let (receiver, draws) = (&patch.receiver, &mut patch.draws);
                    self.weigh(tree, cut, receiver, factors, points, draws);
                    eval.mark(Phase::Cut);
                    patch.is_ready = true;
                }
                &mut patch.draws
            }
        };
        let u = if self.spec.stratify && x.bounce == 0 {
            x.sequence.f64(x.sample, LIGHTS, &mut rng)
        } else {
            rng.f64()
        };
        cut.pick(tree, &x.receiver, u, draws, descents);
    }
}

/// Asks for lights of a point whose turn comes.
fn expect<E: LightEval>(lights: &[Option<Drawn>], eval: &mut E) {
    for drawn in lights.iter().flatten() {
        eval.expect(drawn.light);
    }
}

impl<'a> Method<'a> for StratifiedLightcuts<'a> {
    type Spec = StratifiedLightcutsSpec;
    type Scratch = StratifiedScratch;
    const CENTRES: bool = true;
    const STRATIFIED: bool = true;

    fn prepare(spec: &StratifiedLightcutsSpec, inputs: &'a Inputs) -> Self {
        Self {
            spec: spec.clone(),
            tree: inputs.wide_tree(),
        }
    }

    fn is_unbiased(&self) -> bool {
        true
    }

    fn most_learned_bytes(spec: &StratifiedLightcutsSpec) -> u64 {
        match spec.learn {
            true => Learned::most_bytes(spec.clusters.get()),
            false => 0,
        }
    }

    fn begin_tile<E: LightEval>(
        &self,
        tile: &TilePoints<'_>,
        eval: &mut E,
        learned: &mut Learned,
        scratch: &mut StratifiedScratch,
    ) {
        let Some(tree) = self.tree else { return };
        let StratifiedScratch {
            shared,
            draws,
            factors,
            typical,
            patches,
            pilots,
            descents,
            ..
        } = scratch;
        if self.has_patches() {
            patches.find(tile);
        }
        let centres = tile.centres.iter().flatten();
        pilots.clear();
        pilots.extend(centres.filter(|c| c.is_pilot).map(|c| c.point));
        let receivers: Vec<_> = pilots.iter().map(|x| x.receiver).collect();
        shared.refine(tree, &receivers, self.spec.clusters.get() as usize);
        let is_late = |x: &GatherPoint| x.bounce == 0 && x.sample >= LEARNED_FROM;
        if learned.probed.squares.len() == shared.len() {
            if tile.is_milestone {
                learned.take_in();
            }
        } else if self.spec.learn && tile.points.iter().any(is_late) {
            let rng = &mut tile.probe_stream.clone();
            let probed = probes::probe(shared, tree, pilots, eval, rng, draws, descents);
            *learned = Learned::of(probed);
        }
        factors.clone_from(&learned.factors);
        *typical = learned.probed.typical.sqrt();
        eval.mark(Phase::Cut);
        let stream = |x: &GatherPoint| (tile.stream)(x.slot, x.bounce, Purpose::Lights);
        let points = first_points(tile.points, self.spec.samples.get());
        self.draw(points, stream, eval, scratch);
    }

    fn point<E: LightEval>(
        &self,
        x: &GatherPoint,
        eval: &mut E,
        rng: &mut Rng,
        scratch: &mut StratifiedScratch,
    ) {
        if self.tree.is_none() {
            return;
        }
        if !scratch.ahead.has(x) {
            self.draw(std::slice::from_ref(x), |_| rng.clone(), eval, scratch);
            expect(scratch.ahead.coming(0), eval);
        }
        scratch.ahead.turn();
        // The next point's lights have arrived, which were asked for one point earlier, and say what lies behind them.
        for drawn in scratch.ahead.coming(0).iter().flatten() {
            eval.expect_soon(drawn.light);
        }
        expect(scratch.ahead.coming(1), eval);
        let own = scratch.factors_of(x);
        let (factors, typical) = (&scratch.factors[own.clone()], scratch.typical);
        let albedo = match factors.is_empty() {
            true => 0.0,
            false => f64::from(luminance(x.brdf.albedo(x.ns.dot(x.wo)))),
        };
        let all = scratch.ahead.now();
        for _ in all.iter().filter(|drawn| drawn.is_none()) {
            eval.count_dead();
        }
        let has_trials = !factors.is_empty() && typical != 0.0;
        let sample = |drawn: &Drawn| {
            let sample = LightSample::new(drawn.light, 1.0 / drawn.expected);
            if !has_trials {
                return sample;
            }
            let cluster = drawn.cluster as usize;
            let weight = drawn.weight / f64::from(factors[cluster]);
            let trial = Trial {
                place: (own.start + cluster) as u32,
                expected: weight * albedo * typical,
            };
            LightSample { trial, ..sample }
        };
        eval.add(x, all.iter().flatten().map(sample));
    }
}

#[cfg(test)]
mod tests {
    use light_tree::TreeBuilder;
    use sampling::{Purpose, Sequence};
    use scene::trace::Tracer;
    use verify::z_test;

    use super::*;
    use crate::VirtualShape;
    use crate::method::conformance::{gather_points, light_sets, room};
    use crate::method::{MethodSpec, conformance};
    use crate::shadow_queue::{QueueScratch, ShadowQueue};
    use crate::tile_points::{BLOCKS, Centre};

    fn centre(x: &GatherPoint, is_pilot: bool) -> Option<Centre> {
        Some(Centre {
            point: *x,
            reach: 0.1,
            is_pilot,
        })
    }

    #[test]
    fn a_cut_and_weights_made_for_other_points_give_the_light_of_all_lights() {
        let scene = room(true);
        let tracer = Tracer::build(&scene);
        let points = gather_points(&scene);
        let stream = |slot, _, purpose| Rng::new(3, u64::from(slot), 0, purpose);
        let late = [points[0], points[1]].map(|x| GatherPoint {
            slot: u32::MAX,
            sample: LEARNED_FROM,
            ..x
        });
        let (mut checked, mut has_learned) = (0, false);
        for (name, lights) in light_sets(&scene, &tracer) {
            let inputs = Inputs::new(lights, TreeBuilder::Binned);
            let spec = StratifiedLightcutsSpec {
                samples: Count::of(4),
                clusters: Count::of(12),
                ..Default::default()
            };
            let method = StratifiedLightcuts::prepare(&spec, &inputs);
            let mut scratch = StratifiedScratch::default();
            let mut memory = QueueScratch::default();
            let shape = VirtualShape::Sphere;
            let mut queue =
                ShadowQueue::new(&scene, &inputs.lights, &tracer, shape, 0, &mut memory);
            for x in &points[2..] {
                // It lies at the edge of a patch.
                let midst = x.moved(0.04 * x.ns.any_orthonormal_vector());
                let centres = [
                    centre(&late[0], true),
                    centre(&late[1], true),
                    centre(&midst, false),
                ];
                let mut learned = Learned::default();
                method.begin_tile(
                    &TilePoints {
                        points: &late,
                        width: 1,
                        samples: 1,
                        is_milestone: true,
                        centres: &centres,
                        probe_stream: &stream(0, 0, Purpose::Probe),
                        stream: &stream,
                    },
                    &mut queue,
                    &mut learned,
                    &mut scratch,
                );
                has_learned |= learned.factors.iter().any(|&factor| factor != 1.0);
                let is_on_patch = scratch.patches.of(x).is_some();
                assert_eq!(is_on_patch, method.tree.is_some(), "{name}");
                let count = 3000;
                let mut memory = QueueScratch::default();
                let mut queue = ShadowQueue::new(
                    &scene,
                    &inputs.lights,
                    &tracer,
                    VirtualShape::Sphere,
                    count as usize,
                    &mut memory,
                );
                for slot in 0..count {
                    queue.begin_point(stream(slot, 0, Purpose::LightSurface));
                    let x = GatherPoint {
                        slot,
                        sequence: Sequence(slot),
                        sample: LEARNED_FROM,
                        ..*x
                    };
                    let rng = &mut stream(slot, 0, Purpose::Lights);
                    method.point(&x, &mut queue, rng, &mut scratch);
                    queue.end_point();
                }
                let (_, values) = queue.finish();
                let estimate = conformance::running(&conformance::radiances(values), 1);
                let exact = conformance::Estimates {
                    scene: &scene,
                    inputs: &inputs,
                    tracer: &tracer,
                    x: *x,
                    count: 400,
                    seed: 31,
                };
                let (_, exact, _) = MethodSpec::AllLights(Default::default()).visit(&inputs, exact);
                let exact = conformance::running(&exact, 1);
                let rounding = 1e-7 * exact.mean();
                let variance =
                    estimate.variance_of_mean() + exact.variance_of_mean() + rounding * rounding;
                let z = z_test(estimate.mean(), variance, exact.mean());
                // 4.5 sigma over about 50 cases, a fifth more for heavy tails: false alarm below 4e-4.
                assert!(
                    z.abs() < 5.4,
                    "{name} at {}: {} instead of {}, z = {z}",
                    x.position,
                    estimate.mean(),
                    exact.mean()
                );
                checked += 1;
            }
        }
        assert!(checked >= 30 && has_learned, "{checked} cases");
    }

    #[test]
    fn what_comes_of_lights_is_noted_where_their_cluster_is() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        let points = gather_points(&scene);
        let mut lights = light_tree::LightSet::default();
        for i in 0..900 {
            let (x, z) = ((i % 30) as f32 / 7.5 - 1.99, (i / 30) as f32 / 7.5 - 1.99);
            lights.push_point(glam::Vec3::new(x, 2.5, z), glam::Vec3::ONE);
        }
        let inputs = Inputs::new(lights, TreeBuilder::Binned);
        let tree = inputs.wide_tree().expect("has lights");
        let method = StratifiedLightcuts::prepare(&Default::default(), &inputs);
        let stream = |slot, _, purpose| Rng::new(3, u64::from(slot), 0, purpose);
        let mut scratch = StratifiedScratch::default();
        let mut memory = QueueScratch::default();
        let shape = VirtualShape::Sphere;
        let set = &inputs.lights;
        let mut queue = ShadowQueue::new(&scene, set, &tracer, shape, 1, &mut memory);
        let (mut dark, mut lit) = (0, 0);
        for (block, x) in points.iter().enumerate() {
            let x = GatherPoint {
                sample: LEARNED_FROM,
                block: block as u32,
                slot: 0,
                ..*x
            };
            let mut learned = Learned::default();
            let centres: Vec<_> = points.iter().map(|x| centre(x, true)).collect();
            let tile = TilePoints {
                points: &[x],
                width: 1,
                samples: 1,
                is_milestone: true,
                centres: &centres,
                probe_stream: &stream(0, 0, Purpose::Probe),
                stream: &stream,
            };
            method.begin_tile(&tile, &mut queue, &mut learned, &mut scratch);
            queue.give_trials(std::mem::take(&mut learned.trials));
            for slot in 0..400 {
                queue.begin_point(stream(slot, 0, Purpose::LightSurface));
                let sequence = Sequence(slot);
                let rng = &mut stream(slot, 0, Purpose::Lights);
                method.point(
                    &GatherPoint { sequence, ..x },
                    &mut queue,
                    rng,
                    &mut scratch,
                );
                queue.end_point();
            }
            let trials = queue.take_trials();
            let cut = &scratch.shared;
            assert_eq!(trials.len(), BLOCKS * cut.len());
            let of_block = block * cut.len()..(block + 1) * cut.len();
            let others = trials
                .iter()
                .enumerate()
                .filter(|(i, _)| !of_block.contains(i));
            assert!(
                others.map(|(_, t)| t.count).all(|count| count == 0),
                "another block's"
            );
            let drawn: u32 = trials.iter().map(|t| t.count).sum();
            assert!((3600..=4000).contains(&drawn), "{drawn} were noted");
            let (mut draws, mut descents) = (Draws::default(), Descents::default());
            cut.weigh(tree, &x.receiver, &mut draws);
            for (i, trials) in trials[of_block].iter().enumerate() {
                if trials.count < 20 {
                    continue;
                }
                let mut arrives = |k: u32| {
                    let u = (f64::from(k) + 0.5) / 64.0;
                    let within = std::iter::once((i, u));
                    descents.clear();
                    cut.pick_within(tree, &x.receiver, within, &draws, &mut descents);
                    descents.descend(tree);
                    let drawn = descents.drawn(0)[0];
                    drawn.is_some_and(|drawn| queue.radiance(&x, drawn.light) != glam::Vec3::ZERO)
                };
                let seen = (0..64).filter(|&k| arrives(k)).count();
                let square = trials.squares() / f64::from(trials.count);
                if seen == 0 {
                    dark += 1;
                    // One of a hundred may have been missed.
                    assert!(square < 0.2, "{square} of hidden lights");
                } else if seen == 64 {
                    lit += 1;
                    assert!(square > 0.2, "{square} of lights in sight");
                }
            }
        }
        assert!(dark > 20 && lit > 20, "{dark} dark, {lit} lit clusters");
    }
}
