//! Descents through an eight-way tree: one light from each of many clusters, for many points at once.

use crate::block::{Block, Cluster, Lanes, Seen, ViewerLanes, WIDTH, Weighed};
use crate::bounds::Receiver;
use crate::light::LightId;
use crate::prefetch::prefetch;
use crate::region::Region;
use crate::select::BELOW_ONE;
use crate::wide::{WideTree, by_width};

/// A light that was drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawn {
    /// Which light.
    pub light: LightId,
    /// How often it is drawn on average, > 0: 1 over it makes the estimate unbiased.
    pub expected: f64,
    /// The cluster of the cut that it is in.
    pub cluster: u32,
    /// What it is expected to bring: its share of the weight of its cluster.
    pub weight: f64,
}

/// Lights drawn for several points together, all descending side by side: the memory latencies of one hide behind the steps of
/// the others. Memory is kept.
#[derive(Debug, Default)]
pub struct Descents {
    points: Vec<Point>,
    /// What was drawn, point by point; `None` where nothing in the cluster can light the point.
    drawn: Vec<Option<Drawn>>,
    /// Where clusters are weighed.
    near: Vec<Descent>,
    /// Where only intensities tell lights apart.
    far: Vec<Descent>,
    couples: Vec<Couple>,
}

/// Who is lit.
#[derive(Debug)]
struct Point {
    receiver: Receiver,
    seen: Seen,
    /// Its first place among what was drawn.
    first: usize,
}

/// A cluster from which one light is to be drawn.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pick {
    pub(crate) cluster: Cluster,
    /// The cluster of the cut that holds it.
    pub(crate) of: u32,
    /// Whether all it holds is far off.
    pub(crate) is_far: bool,
    pub(crate) expected: f64,
    /// A cluster of this weight is picked once on average.
    pub(crate) step: f64,
    /// Chooses within the cluster.
    pub(crate) u: f64,
}

impl Pick {
    /// `light`, to which the pick has led.
    #[inline]
    fn drawn(&self, light: LightId) -> Drawn {
        Drawn {
            light,
            expected: self.expected,
            cluster: self.of,
            weight: self.expected * self.step,
        }
    }
}

/// A pick under way.
#[derive(Debug, Clone, Copy)]
struct Descent {
    pick: Pick,
    /// Place among the points.
    point: u32,
    /// Place among what is drawn.
    slot: u32,
}

/// A lane of a block that was chosen.
#[derive(Debug, Clone, Copy)]
struct Chosen {
    lane: usize,
    /// No number, or 0, where the block is dark.
    pmf: f64,
    /// What is left of the random number, in [0, 1).
    u: f64,
}

impl Chosen {
    const NONE: Self = Self {
        lane: 0,
        pmf: 0.0,
        u: 0.0,
    };
}

/// Descents that take a step together: all weigh, then all choose, before any branch. A wrong guess of one then throws away
/// nothing of the next.
const TOGETHER: usize = 16;

impl Descents {
    /// Forgets all points.
    pub fn clear(&mut self) {
        self.points.clear();
        self.drawn.clear();
        self.near.clear();
        self.far.clear();
    }

    /// What was drawn for the `i`-th point since the last [`clear`](Self::clear), after [`descend`](Self::descend): the same light
    /// perhaps more than once, and `None` where a draw ended in a cluster that cannot light it.
    pub fn drawn(&self, i: usize) -> &[Option<Drawn>] {
        let end = self
            .points
            .get(i + 1)
            .map_or(self.drawn.len(), |next| next.first);
        &self.drawn[self.points[i].first..end]
    }

    /// Begins a point, whose lights the following ones are.
    #[inline]
    pub(crate) fn add_point(&mut self, tree: &WideTree, receiver: &Receiver) {
        self.points.push(Point {
            receiver: *receiver,
            seen: tree.seen(receiver),
            first: self.drawn.len(),
        });
    }

    /// Adds a light of the last point.
    pub(crate) fn take(&mut self, drawn: Drawn) {
        self.drawn.push(Some(drawn));
    }

    /// Adds a pick of the last point, and asks for what its first step reads.
    #[inline(always)]
    pub(crate) fn pick(&mut self, tree: &WideTree, pick: Pick) {
        let descent = Descent {
            pick,
            point: self.points.len() as u32 - 1,
            slot: self.drawn.len() as u32,
        };
        let light = pick.cluster.light();
        self.drawn.push(light.map(|light| pick.drawn(light)));
        if light.is_none() {
            ask(tree, &pick);
            match pick.is_far {
                true => self.far.push(descent),
                false => self.near.push(descent),
            }
        }
    }

    /// Goes on with all picks to their lights.
    pub fn descend(&mut self, tree: &WideTree) {
        by_width!(
            self.descend_avx512(tree),
            self.descend_avx2(tree),
            self.descend_with(tree)
        )
    }

    /// The same code and the same bits, for wider registers.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn descend_avx512(&mut self, tree: &WideTree) {
        self.descend_with(tree);
    }

    /// The same code and the same bits, eight lanes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn descend_avx2(&mut self, tree: &WideTree) {
        self.descend_with(tree);
    }

    #[inline(always)]
    fn descend_with(&mut self, tree: &WideTree) {
        let Self {
            points,
            drawn,
            near,
            far,
            couples,
        } = self;
        couples.resize_with(TOGETHER / 2, || Couple::NONE);
        let mut chosen = [Chosen::NONE; TOGETHER];
        while !near.is_empty() {
            let mut kept = 0;
            for from in (0..near.len()).step_by(TOGETHER) {
                let count = TOGETHER.min(near.len() - from);
                for k in 0..count {
                    let Descent { pick, point, .. } = &near[from + k];
                    let seen = &points[*point as usize].seen;
                    couples[k / 2].put(k % 2, tree, pick.cluster.0 as usize, seen);
                }
                for couple in &mut couples[..count.div_ceil(2)] {
                    couple.weigh(tree);
                }
                if !tree.parallel.is_empty() {
                    for k in 0..count {
                        let Descent { pick, point, .. } = &near[from + k];
                        let receiver = &points[*point as usize].receiver;
                        let parallel = &tree.parallel[pick.cluster.0 as usize];
                        couples[k / 2].add_parallel(k % 2, receiver, parallel);
                    }
                }
                for k in 0..count {
                    chosen[k] = choose(couples[k / 2].weights(k % 2), near[from + k].pick.u);
                }
                for k in 0..count {
                    let mut descent = near[from + k];
                    descent.pick.is_far = couples[k / 2].is_far(k % 2, chosen[k].lane);
                    if step(tree, &mut descent, chosen[k], drawn) {
                        match descent.pick.is_far {
                            true => far.push(descent),
                            false => {
                                near[kept] = descent;
                                kept += 1;
                            }
                        }
                    }
                }
            }
            near.truncate(kept);
        }
        while !far.is_empty() {
            let mut kept = 0;
            for from in (0..far.len()).step_by(TOGETHER) {
                let count = TOGETHER.min(far.len() - from);
                for k in 0..count {
                    let pick = &far[from + k].pick;
                    chosen[k] = choose(&tree.blocks[pick.cluster.0 as usize].intensity, pick.u);
                }
                for k in 0..count {
                    let mut descent = far[from + k];
                    if step(tree, &mut descent, chosen[k], drawn) {
                        far[kept] = descent;
                        kept += 1;
                    }
                }
            }
            far.truncate(kept);
        }
    }
}

/// Takes a descent to the chosen cluster of its block, and asks for what the next step reads. Whether there is one: else it has led
/// to a light, or to nothing.
#[inline(always)]
fn step(
    tree: &WideTree,
    descent: &mut Descent,
    chosen: Chosen,
    drawn: &mut [Option<Drawn>],
) -> bool {
    let pick = &mut descent.pick;
    pick.expected *= chosen.pmf;
    pick.u = chosen.u;
    // Nothing is lit, or a product of hundreds of tiny probabilities has underflowed: such a light cannot be told from none.
    if pick.expected.is_nan() || pick.expected <= 0.0 {
        return false;
    }
    pick.cluster = tree.blocks[pick.cluster.0 as usize].clusters[chosen.lane];
    match pick.cluster.light() {
        Some(light) => {
            drawn[descent.slot as usize] = Some(pick.drawn(light));
            false
        }
        None => {
            ask(tree, pick);
            true
        }
    }
}

/// Asks for what the next step of a pick reads of its block.
#[inline(always)]
fn ask(tree: &WideTree, pick: &Pick) {
    let block = tree.blocks.get(pick.cluster.0 as usize);
    match pick.is_far {
        true => prefetch(block.map(|block| &block.intensity)),
        false => prefetch(block),
    }
}

/// Two blocks, weighed at once for a point each: wide registers hold the clusters of both.
#[derive(Debug)]
struct Couple {
    block: Block<PAIR>,
    viewers: ViewerLanes<PAIR>,
    is_glossy: [bool; 2],
    weights: [f32; PAIR],
    /// As [`Weighed::alike`].
    alike: [f32; PAIR],
}

/// Clusters of two blocks.
const PAIR: usize = 2 * WIDTH;

impl Couple {
    const NONE: Self = Self {
        block: Block::EMPTY,
        viewers: ViewerLanes::NONE,
        is_glossy: [false; 2],
        weights: [0.0; PAIR],
        alike: [0.0; PAIR],
    };

    #[inline(always)]
    fn put(&mut self, which: usize, tree: &WideTree, block: usize, seen: &Seen) {
        let first = which * WIDTH;
        tree.blocks[block].unpack_to(&mut self.block, first);
        self.viewers.put(seen, first);
        self.is_glossy[which] = seen.lobe.is_some();
    }

    /// Weighs the clusters, parallel light apart.
    #[inline(always)]
    fn weigh(&mut self, tree: &WideTree) {
        let is_glossy = self.is_glossy[0] | self.is_glossy[1];
        let region = Region::default();
        // All of it were a copy by a call.
        let Weighed { weights, alike, .. } =
            tree.weigh_for::<false, false, PAIR>(&self.block, &self.viewers, is_glossy, region);
        (self.weights, self.alike) = (weights, alike);
    }

    #[inline(always)]
    fn add_parallel(&mut self, which: usize, receiver: &Receiver, parallel: &Lanes) {
        let Self { weights, alike, .. } = self;
        self.block
            .add_parallel(which * WIDTH, receiver, parallel, weights, alike);
    }

    #[inline(always)]
    fn weights(&self, which: usize) -> &Lanes {
        &self.weights.as_chunks().0[which]
    }

    #[inline(always)]
    fn is_far(&self, which: usize, lane: usize) -> bool {
        self.alike[which * WIDTH + lane] > 0.0
    }
}

/// What lights of a block's clusters are drawn by.
#[cfg(test)]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shares {
    pub(crate) weights: Lanes,
    /// As [`Weighed::alike`](crate::block::Weighed::alike).
    pub(crate) alike: Lanes,
}

#[cfg(test)]
impl WideTree {
    /// What lights of a block's clusters are drawn by: their weights, or where all that the block holds is far off, their
    /// intensities.
    pub(crate) fn shares(
        &self,
        block: usize,
        receiver: &Receiver,
        seen: &Seen,
        is_far: bool,
    ) -> Shares {
        if is_far {
            return Shares {
                weights: self.blocks[block].intensity,
                alike: [1.0; WIDTH],
            };
        }
        let weighed = self.weights::<false>(block, receiver, seen);
        Shares {
            weights: weighed.weights,
            alike: weighed.alike,
        }
    }
}

/// Running sums of weights, the sum of all last.
#[inline(always)]
pub(crate) fn running_sums(weights: &Lanes) -> [f64; WIDTH] {
    let mut w = [0.0f64; WIDTH];
    for k in 0..WIDTH {
        w[k] = f64::from(weights[k]);
    }
    // In four steps rather than seven.
    let (a, b, c, d) = (w[0] + w[1], w[2] + w[3], w[4] + w[5], w[6] + w[7]);
    let (half, most) = (a + b, (a + b) + c);
    [
        w[0],
        a,
        a + w[2],
        half,
        half + w[4],
        most,
        most + w[6],
        half + (c + d),
    ]
}

/// The lane in which `at` lies along the weights, whose running sums are `to`: lane, weight, and how far into it, in [0, 1).
/// Never a lane of weight 0 but where all are; then what is returned means nothing.
#[inline(always)]
pub(crate) fn lane_at(weights: &Lanes, to: &[f64; WIDTH], at: f64) -> (usize, f64, f64) {
    let mut lane = 0;
    for upper in &to[..WIDTH - 1] {
        lane += usize::from(*upper <= at);
    }
    let mut w = f64::from(weights[lane]);
    if w <= 0.0 {
        // Rounding has led past the last one.
        lane = weights.iter().rposition(|&w| w > 0.0).unwrap_or(lane);
        w = f64::from(weights[lane]);
    }
    let from = to[lane] - w;
    (lane, w, ((at - from) / w).clamp(0.0, BELOW_ONE))
}

/// Chooses a lane by its weight with `u`.
#[inline(always)]
fn choose(weights: &Lanes, u: f64) -> Chosen {
    let to = running_sums(weights);
    let sum = to[WIDTH - 1];
    let (lane, w, u) = lane_at(weights, &to, u * sum);
    Chosen {
        lane,
        pmf: w / sum,
        u,
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::draws::Draws;
    use crate::lobe::Lobe;
    use crate::shared_cut::SharedCut;
    use crate::test_lights::{lights_on_walls, receiver, wide};

    #[test]
    fn extreme_numbers_never_choose_a_lane_of_weight_zero() {
        let tiny = f32::from_bits(1);
        for weights in [
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, tiny, 0.0, 1.0, 0.0, tiny, 0.0, 0.0],
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-38],
            [1e38, 0.0, 0.0, tiny, 0.0, 0.0, 0.0, 0.0],
        ] {
            for u in [0.0, 1e-300, 0.5, 1.0 - 1e-9, BELOW_ONE] {
                let Chosen { lane, pmf, u: rest } = choose(&weights, u);
                assert!(
                    weights[lane] > 0.0 && pmf > 0.0,
                    "{weights:?} {u}: lane {lane}"
                );
                assert!((0.0..1.0).contains(&rest), "{weights:?} {u}: {rest}");
            }
        }
        let dark = choose(&[0.0; WIDTH], 0.5);
        assert!(dark.pmf.is_nan() && dark.lane < WIDTH, "{dark:?}");
    }

    #[test]
    fn a_number_past_the_last_weight_leads_to_it() {
        let weights = [1.0, 3.0, 0.5, 2.0, 0.25, 1e-9, 0.0, 0.0];
        let to = running_sums(&weights);
        for at in [to[WIDTH - 1], to[WIDTH - 1] * 1.000_001] {
            let (lane, _, u) = lane_at(&weights, &to, at);
            assert_eq!((lane, u), (5, BELOW_ONE), "at {at}");
        }
    }

    #[test]
    fn two_blocks_at_once_are_weighed_as_each_by_itself() {
        let tree = wide(&lights_on_walls(500)).expect("has lights");
        let matte = receiver((Vec3::new(0.1, -0.9, 0.2), Vec3::Y));
        let glossy = receiver((Vec3::new(-1.0, 0.3, 0.3), Vec3::X)).with_lobe(Lobe {
            axis: Vec3::X,
            diffuse: 0.1,
            near: 0.2,
            far: 0.0,
            far_sin2: 1.0,
            alpha2: 0.04,
        });
        let receivers = [matte, glossy];
        for blocks in [[0, 1], [5, 3], [7, 7]] {
            let mut couple = Couple::NONE;
            for which in 0..2 {
                let seen = tree.seen(&receivers[which]);
                couple.put(which, &tree, blocks[which], &seen);
            }
            couple.weigh(&tree);
            for which in 0..2 {
                let (block, x) = (blocks[which], &receivers[which]);
                let alone = tree.weights::<false>(block, x, &tree.seen(x));
                assert_eq!(
                    *couple.weights(which),
                    alone.weights,
                    "{which} of {blocks:?}"
                );
                for (lane, &alike) in alone.alike.iter().enumerate() {
                    assert_eq!(couple.is_far(which, lane), alike > 0.0, "lane {lane}");
                }
            }
        }
    }

    #[test]
    fn wide_and_narrow_instructions_draw_the_same_lights() {
        let tree = wide(&lights_on_walls(3000)).expect("has lights");
        let places = [(Vec3::new(0.1, -0.9, 0.2), Vec3::Y), (Vec3::ZERO, Vec3::X)];
        let mut cut = SharedCut::default();
        cut.refine(&tree, &[receiver(places[0])], 60);
        let drawn = |is_wide: bool| {
            let (mut draws, mut descents) = (Draws::default(), Descents::default());
            for at in places {
                let x = receiver(at);
                cut.weigh(&tree, &x, &mut draws);
                cut.settle(&tree, 37, &mut draws);
                match is_wide {
                    true => cut.pick(&tree, &x, 0.3, &mut draws, &mut descents),
                    false => draws.pick_with(&cut, &tree, &x, 0.3, &mut descents),
                }
            }
            match is_wide {
                true => descents.descend(&tree),
                false => descents.descend_with(&tree),
            }
            [0, 1].map(|i| descents.drawn(i).to_vec())
        };
        let [a, b] = drawn(true);
        assert!(a.len() > 20 && b.len() > 20, "enough to fill registers");
        assert_eq!(drawn(false), [a, b]);
    }
}
