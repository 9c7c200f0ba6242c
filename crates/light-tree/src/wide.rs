//! An eight-way light tree: the children of a node are weighed all at once.

#[cfg(test)]
use crate::block::Cluster;
use crate::block::{Block, Lanes, Seen, SeenLobe, Viewer, Viewers, WIDTH, Weighed};
use crate::bounds::Receiver;
#[cfg(test)]
use crate::descent::Shares;
use crate::draws::Draws;
#[cfg(test)]
use crate::light::LightId;
use crate::packed::PackedBlock;
use crate::region::Region;

/// The first call where the processor has AVX2 and fused multiplication, for which it is compiled, else the last: the same code, and
/// so the same bits. Of three, the first is for AVX-512.
macro_rules! by_width {
    ($avx2:expr, $plain:expr) => {{
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
        {
            #[allow(
                unsafe_code,
                reason = "the only way to call code for a processor found at run time"
            )]
            // SAFETY: the processor has both, as was just asked.
            return unsafe { $avx2 };
        }
        $plain
    }};
    ($avx512:expr, $avx2:expr, $plain:expr) => {{
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx512f")
            && std::arch::is_x86_feature_detected!("avx512vl")
            && std::arch::is_x86_feature_detected!("avx512dq")
            && std::arch::is_x86_feature_detected!("avx512bw")
        {
            #[allow(
                unsafe_code,
                reason = "the only way to call code for a processor found at run time"
            )]
            // SAFETY: the processor has what was just asked for.
            return unsafe { $avx512 };
        }
        by_width!($avx2, $plain)
    }};
}
pub(crate) use by_width;

/// The tree. Its clusters' weights are estimates of what they bring, not bounds; but they are 0 only where nothing
/// can arrive.
#[derive(Debug, Clone)]
pub struct WideTree {
    /// The root is the first.
    pub(crate) blocks: Vec<PackedBlock>,
    /// ‖Iᴰ‖ of each block's clusters; empty when there is none.
    pub(crate) parallel: Vec<Lanes>,
    pub(crate) oriented: bool,
    /// Power of two that makes the box around all lights about 1 wide: nothing over- or underflows and no bit is lost.
    pub(crate) scale: f32,
    pub(crate) depth: u32,
}

impl WideTree {
    /// Number of nodes, the root and the lights among them.
    pub fn node_count(&self) -> usize {
        1 + self.blocks.iter().map(PackedBlock::len).sum::<usize>()
    }

    /// Most edges from the root to a light.
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// All blocks, unpacked.
    #[cfg(test)]
    pub(crate) fn unpacked(&self) -> Vec<Block> {
        self.blocks.iter().map(PackedBlock::block).collect()
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        self.blocks.len() * size_of::<PackedBlock>() + self.parallel.len() * size_of::<Lanes>()
    }

    pub(crate) fn seen(&self, receiver: &Receiver) -> Seen {
        Seen {
            position: receiver.position() * self.scale,
            normal: receiver.normal(),
            lobe: SeenLobe::of(receiver),
            region: (receiver.region() != Region::default())
                .then(|| receiver.region().scaled(self.scale)),
        }
    }

    /// Weights of many blocks' clusters, parallel light apart, in place of what `draws` had.
    pub(crate) fn weigh_all(&self, blocks: &[Block], receiver: &Receiver, draws: &mut Draws) {
        draws.weights.clear();
        draws.peaks.clear();
        draws.swings.clear();
        draws.alike.clear();
        let seen = self.seen(receiver);
        by_width!(
            self.weigh_all_avx512(blocks, &seen, draws),
            self.weigh_all_avx2(blocks, &seen, draws),
            self.weigh_all_with(blocks, &seen, draws)
        )
    }

    /// The same code and the same bits, for wider registers.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn weigh_all_avx512(&self, blocks: &[Block], seen: &Seen, draws: &mut Draws) {
        self.weigh_all_with(blocks, seen, draws);
    }

    /// The same code and the same bits, eight lanes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn weigh_all_avx2(&self, blocks: &[Block], seen: &Seen, draws: &mut Draws) {
        self.weigh_all_with(blocks, seen, draws);
    }

    #[inline(always)]
    fn weigh_all_with(&self, blocks: &[Block], seen: &Seen, draws: &mut Draws) {
        // No iterator's adaptor: it would not be compiled for the wider instructions.
        for block in blocks {
            let weighed = match seen.region {
                Some(_) => self.weigh::<false, true>(block, seen),
                None => self.weigh::<false, false>(block, seen),
            };
            draws.weights.push(weighed.weights);
            draws.peaks.push(weighed.peaks);
            draws.swings.push(weighed.swings);
            draws.alike.push(weighed.alike);
        }
    }

    /// Weights of a block's clusters, parallel light apart: bounds of them, or for all of the region that is seen from.
    #[inline(always)]
    pub(crate) fn weigh<const BOUND: bool, const REGION: bool>(
        &self,
        block: &Block,
        seen: &Seen,
    ) -> Weighed {
        let region = seen.region.unwrap_or_default();
        self.weigh_for::<BOUND, REGION, WIDTH>(block, Viewer::of(seen), seen.lobe.is_some(), region)
    }

    /// The same for points of which some are glossy, or none.
    #[inline(always)]
    pub(crate) fn weigh_for<const BOUND: bool, const REGION: bool, const N: usize>(
        &self,
        block: &Block<N>,
        viewers: impl Viewers,
        is_glossy: bool,
        region: Region,
    ) -> Weighed<N> {
        match (self.oriented, is_glossy) {
            (false, false) => block.weigh::<false, BOUND, false, REGION>(viewers, region),
            (true, false) => block.weigh::<true, BOUND, false, REGION>(viewers, region),
            (false, true) => block.weigh::<false, BOUND, true, REGION>(viewers, region),
            (true, true) => block.weigh::<true, BOUND, true, REGION>(viewers, region),
        }
    }

    /// Probability of drawing each light below `root`, by enumeration, and the mass that is lost where nothing can
    /// light the receiver.
    #[cfg(test)]
    pub(crate) fn pmf_below(
        &self,
        receiver: &Receiver,
        root: Cluster,
    ) -> (Vec<(LightId, f64)>, f64) {
        let seen = self.seen(receiver);
        let mut lights = Vec::new();
        let mut dead = 0.0;
        let mut stack = vec![(root, 1.0, false)];
        while let Some((cluster, pmf, is_far)) = stack.pop() {
            if let Some(light) = cluster.light() {
                lights.push((light, pmf));
                continue;
            }
            let Some(block) = cluster.block() else {
                continue;
            };
            let Shares { weights, alike } = self.shares(block, receiver, &seen, is_far);
            let sum: f64 = weights.iter().map(|&w| f64::from(w)).sum();
            if sum <= 0.0 {
                dead += pmf;
                continue;
            }
            for (lane, &w) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
                let is_far = is_far || alike[lane] > 0.0;
                let child = self.blocks[block].clusters[lane];
                stack.push((child, pmf * f64::from(w) / sum, is_far));
            }
        }
        (lights, dead)
    }

    /// The lights of a cluster.
    #[cfg(test)]
    pub(crate) fn lights_below(&self, root: Cluster) -> Vec<LightId> {
        let mut lights = Vec::new();
        let mut stack = vec![root];
        while let Some(cluster) = stack.pop() {
            match (cluster.light(), cluster.block()) {
                (Some(light), _) => lights.push(light),
                (None, Some(block)) => {
                    let block = &self.blocks[block];
                    stack.extend(&block.clusters[..block.len()]);
                }
                (None, None) => unreachable!("a cluster is one or the other"),
            }
        }
        lights
    }

    /// What each of a block's clusters could bring to all of the receivers together, were all its lights at the nearest point of
    /// its box. `seen` are the receivers [in the tree's units](Self::seen).
    pub(crate) fn bounds(&self, block: usize, receivers: &[Receiver], seen: &[Seen]) -> Lanes {
        by_width!(
            self.bounds_avx2(block, receivers, seen),
            self.bounds_with(block, receivers, seen)
        )
    }

    /// The same code and the same bits, eight lanes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn bounds_avx2(&self, block: usize, receivers: &[Receiver], seen: &[Seen]) -> Lanes {
        self.bounds_with(block, receivers, seen)
    }

    #[inline(always)]
    fn bounds_with(&self, block: usize, receivers: &[Receiver], seen: &[Seen]) -> Lanes {
        let (unpacked, parallel) = (self.blocks[block].block(), self.parallel.get(block));
        let mut bounds = [0.0; WIDTH];
        for (receiver, seen) in receivers.iter().zip(seen) {
            let weighed = self.weigh_whole::<true, false>(&unpacked, parallel, receiver, seen);
            for (sum, bound) in bounds.iter_mut().zip(weighed.weights) {
                *sum += bound;
            }
        }
        bounds
    }

    /// Weights of the clusters of a block.
    #[inline(always)]
    pub(crate) fn weights<const REGION: bool>(
        &self,
        block: usize,
        receiver: &Receiver,
        seen: &Seen,
    ) -> Weighed {
        let (packed, parallel) = (&self.blocks[block], self.parallel.get(block));
        self.weigh_whole::<false, REGION>(&packed.block(), parallel, receiver, seen)
    }

    /// [`weigh`](Self::weigh), with the parallel light.
    #[inline(always)]
    pub(crate) fn weigh_whole<const BOUND: bool, const REGION: bool>(
        &self,
        block: &Block,
        parallel: Option<&Lanes>,
        receiver: &Receiver,
        seen: &Seen,
    ) -> Weighed {
        let mut weighed = self.weigh::<BOUND, REGION>(block, seen);
        if let Some(parallel) = parallel {
            let Weighed { weights, alike, .. } = &mut weighed;
            block.add_parallel(0, receiver, parallel, weights, alike);
        }
        weighed
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::lights::LightSet;
    use crate::lobe::Lobe;
    use crate::shared_cut::SharedCut;
    use crate::test_lights::{
        BLACK, any_lights, any_receiver, contribution, lights_on_walls, receiver, wide,
    };

    #[test]
    fn every_light_that_contributes_can_be_drawn_and_probabilities_sum_to_one() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let at = any_receiver(u, &lights)?;
            let Some(tree) = wide(&lights) else {
                return Ok(());
            };
            let (pmfs, dead) = tree.pmf_below(&receiver(at), Cluster(0));
            let sum: f64 = pmfs.iter().map(|p| p.1).sum::<f64>() + dead;
            assert!((sum - 1.0).abs() < 1e-9, "sum {sum}");
            let all: f64 = lights
                .ids()
                .map(|id| contribution(&lights, id, at.0, at.1))
                .sum();
            // A share of 10⁻²⁵ is beyond what f32 weights tell apart, and beyond any picture.
            let black = BLACK.max(1e-25 * all);
            for id in lights.ids() {
                let lit = contribution(&lights, id, at.0, at.1);
                let pmf = pmfs.iter().find(|p| p.0 == id).map_or(0.0, |p| p.1);
                assert!(
                    lit <= black || pmf > 0.0,
                    "{id:?} brings {lit} to {at:?}, never drawn"
                );
            }
            Ok(())
        });
    }

    #[test]
    fn each_light_lies_in_one_block_and_children_behind_their_parents() {
        for n in [1, 2, 7, 8, 9, 1000] {
            let lights = lights_on_walls(n);
            let tree = wide(&lights).expect("has lights");
            let mut seen = vec![0; lights.len()];
            for (i, block) in tree.blocks.iter().enumerate() {
                for cluster in &block.clusters[..block.len()] {
                    match (cluster.light(), cluster.block()) {
                        (Some(light), _) => seen[light.index()] += 1,
                        (None, Some(child)) => assert!(child > i, "block {child} of {i}"),
                        (None, None) => unreachable!("a cluster is one or the other"),
                    }
                }
            }
            assert!(seen.iter().all(|&times| times == 1), "{n} lights: {seen:?}");
        }
    }

    #[test]
    fn a_cluster_lit_by_a_corner_weighs_a_share_of_what_it_brings() {
        // Eight groups of eight are the clusters of the root. One reaches above the horizon by a thousandth of its height, and
        // all its light is there; the others are all below the lamp that they light.
        let mut set = LightSet::default();
        for group in 0..8 {
            for i in 0..8 {
                let (x, z) = (10.0 * group as f32, 0.01 * i as f32);
                let (y, bright) = match (group, i) {
                    (0, 7) => (0.001, 1.0),
                    (0, _) => (-1.0, 1e-6),
                    _ => (3.0, 1.0),
                };
                set.push_point(Vec3::new(x, y, z), Vec3::splat(bright));
            }
        }
        let tree = wide(&set).expect("has lights");
        let at = (Vec3::new(1.0, 0.0, 0.0), Vec3::Y);
        let mut cut = SharedCut::default();
        cut.refine(&tree, &[], 1);
        let mut draws = Draws::default();
        cut.weigh(&tree, &receiver(at), &mut draws);
        let mut corner = 0.0;
        let mut whole = f64::INFINITY;
        for group in 0..8 {
            let lights = tree.lights_below(cut.cluster(group));
            assert_eq!(lights.len(), 8, "a group");
            let brings = lights.iter().map(|&id| contribution(&set, id, at.0, at.1));
            let share = f64::from(draws.weight(group)) / brings.sum::<f64>();
            match lights.contains(&LightId(0)) {
                true => corner = share,
                false => whole = whole.min(share),
            }
        }
        assert!(corner > 0.004 * whole, "{corner} and {whole}");
    }

    #[test]
    fn far_lights_are_drawn_by_their_intensities_and_near_ones_are_not() {
        let mut lights = LightSet::default();
        for i in 0..500 {
            let place = Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32);
            lights.push_point(0.1 * place, Vec3::splat(1.0 + (i * 7 % 13) as f32));
        }
        let tree = wide(&lights).expect("has lights");
        let spread_at = |at: Receiver| {
            let (pmfs, _) = tree.pmf_below(&at, Cluster(0));
            let mut spread = 0.0f64;
            // The first choice is always made by weights.
            for lane in tree.blocks[0].clusters {
                let below = tree.lights_below(lane);
                let pmfs = pmfs.iter().filter(|(id, _)| below.contains(id));
                let ratios = pmfs.map(|(id, pmf)| pmf / f64::from(lights.intensity(*id).x));
                let (lo, hi) =
                    ratios.fold((f64::MAX, 0.0f64), |(lo, hi), r| (lo.min(r), hi.max(r)));
                spread = spread.max(hi / lo);
            }
            spread
        };
        let down = |height| receiver((Vec3::new(0.5, height, 0.3), Vec3::NEG_Y));
        assert!(spread_at(down(9.0)) < 1.0 + 1e-4, "far");
        assert!(spread_at(down(1.2)) > 1.5, "near");
        let polished = Lobe {
            axis: Vec3::NEG_Y,
            diffuse: 0.02,
            near: 0.25,
            far: 0.0,
            far_sin2: 1.0,
            alpha2: 1e-4,
        };
        assert!(
            spread_at(down(9.0).with_lobe(polished)) > 1.5,
            "a narrow lobe"
        );
    }

    #[test]
    fn blocks_are_nearly_full() {
        let lights = lights_on_walls(20_000);
        let tree = wide(&lights).expect("has lights");
        // 37 at best, and 79 where the brightest is always opened first.
        let each = tree.bytes() / lights.len();
        assert!(each < 50, "{each} bytes a light");
    }

    #[test]
    fn wide_and_narrow_instructions_give_the_same_bits() {
        let lights = lights_on_walls(500);
        let tree = wide(&lights).expect("has lights");
        for at in [
            (Vec3::new(0.1, -0.9, 0.2), Vec3::Y),
            (Vec3::new(-1.0, 0.3, 0.3), Vec3::X),
        ] {
            let region = Region {
                radius: 0.1,
                lift: 0.01,
                tilt: 0.1,
            };
            for x in [receiver(at), receiver(at).with_region(region)] {
                let (mut fast, mut plain) = (Draws::default(), Draws::default());
                tree.weigh_all(&tree.unpacked(), &x, &mut fast);
                tree.weigh_all_with(&tree.unpacked(), &tree.seen(&x), &mut plain);
                let bits = |all: &[Lanes]| -> Vec<u32> {
                    all.iter().flatten().map(|w| w.to_bits()).collect()
                };
                assert!(
                    bits(&fast.weights) == bits(&plain.weights),
                    "weights at {at:?}"
                );
                assert!(bits(&fast.peaks) == bits(&plain.peaks), "peaks at {at:?}");
                assert!(
                    bits(&fast.swings) == bits(&plain.swings),
                    "swings at {at:?}"
                );
            }
        }
    }

    #[test]
    fn scaling_the_scene_by_powers_of_two_keeps_every_weight() {
        let place = |i: u32| {
            Vec3::new(
                (i * 7 % 13) as f32,
                (i * 5 % 11) as f32 + 1.0,
                (i % 3) as f32,
            )
        };
        let weights = |scale: f32| {
            let mut set = LightSet::default();
            for i in 0..40 {
                set.push_point(
                    place(i) * scale,
                    Vec3::splat((1 + i % 4) as f32) * scale * scale,
                );
            }
            let tree = wide(&set).expect("has lights");
            let at = receiver((Vec3::ZERO, Vec3::Y)).with_region(Region {
                radius: 0.5 * scale,
                lift: 0.125 * scale,
                tilt: 0.1,
            });
            let mut draws = Draws::default();
            tree.weigh_all(&tree.unpacked(), &at, &mut draws);
            (draws.weights, draws.peaks, draws.swings)
        };
        for k in [-30, -7, 9, 30] {
            assert_eq!(weights(2.0f32.powi(k)), weights(1.0), "at 2^{k}");
        }
    }
}
