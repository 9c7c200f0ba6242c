//! Hierarchical importance sampling: one light from a cluster.

use std::hint::select_unpredictable;

use crate::bounds::{Receiver, ReceiverLanes, SeenLanes};
use crate::light::LightId;
use crate::pair_lanes::PairLanes;
use crate::prefetch::{prefetch, prefetch_at};
use crate::tree::{LEAF, LightTree, NodeId, Pair};
use crate::weight::NodeWeights;
use crate::wide::by_width;

/// What happens when neither child of a node can light the receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeadBranch {
    /// No light is drawn: the sample is worth 0, and the estimate unbiased.
    #[default]
    Stop,
    /// Algorithm 1 to the letter: go on with the sibling passed last, with the probability and the random
    /// number held before that branch. Brightens: see [`LightTree::select_retry`].
    Retry,
}

/// A light drawn from a cluster. 16 bytes, and no more where there may be none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Selected {
    /// Which light.
    pub light: LightId,
    /// Probability of drawing it, given the cluster, in (0, 1].
    pub pmf: f64,
    /// The other values that a byte can have stand for none.
    is_there: Yes,
}

#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(u8)]
enum Yes {
    Yes,
}

impl Selected {
    #[inline(always)]
    pub(crate) fn new(light: LightId, pmf: f64) -> Self {
        Self {
            light,
            pmf,
            is_there: Yes::Yes,
        }
    }
}

/// The child of a node that a random number falls to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chosen {
    /// Which child.
    pub child: NodeId,
    /// Probability of choosing it, given the node, in (0, 1].
    pub pmf: f64,
    /// What is left of the number: again uniform in [0, 1). It draws the light below the child that the whole number
    /// draws below the node.
    pub u: f64,
}

/// A descent under way.
#[derive(Debug, Clone, Copy)]
struct Descent {
    node: NodeId,
    /// Random number, rescaled at each level to [0, 1).
    u: f64,
    pmf: f64,
}

/// Where a descent starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Position of its receiver among those that lights are drawn for.
    pub receiver: u32,
    /// The cluster of which a light is drawn.
    pub node: NodeId,
    /// Random number, in [0, 1).
    pub u: f64,
}

/// Largest f64 below 1.
pub(crate) const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

/// Chooses by `weights` with `u`; returns the chosen child, its probability and the rescaled number.
#[inline]
pub(crate) fn choose(weights: [f32; 2], u: f64) -> Option<(u32, f64, f64)> {
    let chosen = choose_live(weights, u);
    (!chosen.is_dead).then_some((u32::from(chosen.is_right), chosen.pmf, chosen.u))
}

/// What is chosen of two children.
struct Side {
    is_right: bool,
    /// Whether both weights are 0: then nothing is chosen.
    is_dead: bool,
    pmf: f64,
    u: f64,
}

/// As [`choose`], but without a branch: the outcome is random, and a wrong guess costs more than the sums.
#[inline(always)]
fn choose_live(weights: [f32; 2], u: f64) -> Side {
    let (w0, w1) = (f64::from(weights[0]), f64::from(weights[1]));
    let sum = w0 + w1;
    debug_assert!(sum.is_finite(), "weights {weights:?}");
    // A child of weight 0 is never taken: scaled < w0 fails for w0 = 0 and holds for w0 = sum.
    let scaled = u * sum;
    let is_right = (scaled >= w0) & (w1 > 0.0);
    let w = select_unpredictable(is_right, w1, w0);
    let passed = select_unpredictable(is_right, w0, 0.0);
    Side {
        is_right,
        is_dead: sum <= 0.0,
        pmf: w / sum,
        u: ((scaled - passed) / w).clamp(0.0, BELOW_ONE),
    }
}

/// Many descents, some of them under way.
struct Descending<'a> {
    tree: &'a LightTree,
    weights: NodeWeights,
    receivers: &'a [&'a Receiver],
    starts: &'a [Start],
    /// How many starts have been taken.
    begun: usize,
    /// How many lanes have one.
    busy: usize,
    drawn: &'a mut [Option<Selected>],
}

/// Descents that take a step together, each for a receiver of its own. `NODES` is twice `LANES`.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Lanes<const LANES: usize, const NODES: usize> {
    /// As in [`PairLanes`].
    receivers: ReceiverLanes<LANES>,
    /// What each chooses from.
    intensity: [f32; NODES],
    links: [u32; NODES],
    seen: SeenLanes<NODES>,
    weights: [[f32; LANES]; 2],
    /// Random numbers, rescaled at each level to [0, 1).
    u: [f64; LANES],
    pmf: [f64; LANES],
    /// The children of the node that each is at, by their place among pairs; the root itself where a descent is over.
    pair: [u32; LANES],
    /// What led there.
    link: [u32; LANES],
    /// Whether each is over: 0 or 1.
    over: [u8; LANES],
    /// Positions among the starts, or [`BEFORE_FIRST`] or [`NO_START`].
    slot: [usize; LANES],
    /// How many are not at the latter.
    busy: usize,
}

/// The position of a lane that has not had a start yet.
const BEFORE_FIRST: usize = usize::MAX - 1;
/// And of one that gets none any more.
const NO_START: usize = usize::MAX;

/// Groups of lanes that are renewed at once: of dozens of lanes some are always over, so that it cannot be guessed wrong.
const RENEWED: usize = 8;
/// Groups that take their steps by turns: when one goes on, what it asked of memory has arrived.
const GROUPS: usize = 2 * RENEWED;

impl<'a> Descending<'a> {
    fn new(
        tree: &'a LightTree,
        weights: NodeWeights,
        receivers: &'a [&'a Receiver],
        starts: &'a [Start],
        drawn: &'a mut [Option<Selected>],
    ) -> Self {
        Self {
            tree,
            weights,
            receivers,
            starts,
            begun: 0,
            busy: 0,
            drawn,
        }
    }

    /// Goes on with all to their ends.
    fn run(&mut self) {
        by_width!(self.run_avx512(), self.run_avx2(), self.run_plain())
    }

    /// The same code and the same bits, sixteen nodes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn run_avx512(&mut self) {
        self.run_with::<8, 16>(|pairs| PairLanes::of_avx512(pairs));
    }

    /// The same code and the same bits, eight nodes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn run_avx2(&mut self) {
        self.run_with::<4, 8>(|pairs| PairLanes::of_avx2(pairs));
    }

    fn run_plain(&mut self) {
        self.run_with::<4, 8>(PairLanes::of);
    }

    #[inline(always)]
    fn run_with<const LANES: usize, const NODES: usize>(
        &mut self,
        load: impl Fn([&Pair; LANES]) -> PairLanes<LANES, NODES>,
    ) {
        let mut groups = [Lanes::<LANES, NODES>::UNUSED; GROUPS];
        self.busy = GROUPS * LANES;
        for turn in 0usize.. {
            // The parts of a step in different turns: what one of them waits for has long been there when the next begins.
            let before = |turns: usize| turn.wrapping_sub(turns) % GROUPS;
            if groups[before(0)].busy > 0 {
                self.look(&mut groups[before(0)], &load);
            }
            if groups[before(1)].busy > 0 {
                self.weigh(&mut groups[before(1)]);
            }
            if groups[before(2)].busy > 0 {
                groups[before(2)].descend();
            }
            if groups[before(3)].busy > 0 {
                self.prefetch(&groups[before(3)]);
            }
            if turn.is_multiple_of(RENEWED) {
                self.renew(&mut groups, before(RENEWED + 2));
                if self.busy == 0 {
                    return;
                }
            }
        }
    }

    /// Where a descent is over another begins, in so many groups from this one on.
    #[inline(always)]
    fn renew<const LANES: usize, const NODES: usize>(
        &mut self,
        groups: &mut [Lanes<LANES, NODES>; GROUPS],
        from: usize,
    ) {
        const { assert!(LANES * RENEWED <= 64, "a bit each") };
        let mut over = 0;
        for i in 0..RENEWED {
            over |= groups[(from + i) % GROUPS].over_bits() << (i * LANES);
        }
        while over != 0 {
            let bit = over.trailing_zeros() as usize;
            over &= over - 1;
            let (lanes, lane) = (&mut groups[(from + bit / LANES) % GROUPS], bit % LANES);
            if let Some(drawn) = self.drawn.get_mut(lanes.slot[lane]) {
                let pmf = lanes.pmf[lane];
                let light = LightId(lanes.link[lane] & !LEAF);
                // Where nothing can light the receiver the last probability is no number, or 0.
                *drawn = (pmf > 0.0).then_some(Selected::new(light, pmf));
            }
            self.begin(lanes, lane);
        }
    }

    /// Asks for what the next step of the lanes reads.
    #[inline(always)]
    fn prefetch<const LANES: usize, const NODES: usize>(&self, lanes: &Lanes<LANES, NODES>) {
        for k in 0..LANES {
            prefetch_at(&self.tree.pairs, lanes.pair[k] as usize);
        }
    }

    /// Looks at what each of the lanes chooses from.
    #[allow(
        clippy::needless_range_loop,
        reason = "an iterator's adaptor would not be compiled for the wider instructions"
    )]
    #[inline(always)]
    fn look<const LANES: usize, const NODES: usize>(
        &self,
        lanes: &mut Lanes<LANES, NODES>,
        load: &impl Fn([&Pair; LANES]) -> PairLanes<LANES, NODES>,
    ) {
        let mut pairs = [&self.tree.pairs[0]; LANES];
        for k in 0..LANES {
            pairs[k] = &self.tree.pairs[lanes.pair[k] as usize];
        }
        let children = load(pairs);
        lanes.seen = lanes.receivers.see(&children.boxes);
        (lanes.intensity, lanes.links) = (children.intensity, children.links);
    }

    /// Weighs it.
    #[inline(always)]
    fn weigh<const LANES: usize, const NODES: usize>(&self, lanes: &mut Lanes<LANES, NODES>) {
        match self.weights {
            NodeWeights::Yuksel2019 => {
                let Lanes {
                    intensity,
                    seen,
                    weights,
                    pair,
                    ..
                } = lanes;
                self.tree.weigh_seen(seen, intensity, pair, weights);
                if !self.tree.directional.is_empty() {
                    self.weigh_each(lanes, |first| self.tree.has_parallel(first));
                }
            }
            _ => self.weigh_each(lanes, |_| true),
        }
    }

    /// Begins the next descent in a lane, or leaves it unused.
    #[inline(always)]
    fn begin<const LANES: usize, const NODES: usize>(
        &mut self,
        lanes: &mut Lanes<LANES, NODES>,
        lane: usize,
    ) {
        lanes.pair[lane] = 0;
        loop {
            let slot = self.begun;
            let Some(start) = self.starts.get(slot) else {
                if lanes.slot[lane] != NO_START {
                    lanes.busy -= 1;
                    self.busy -= 1;
                }
                (lanes.slot[lane], lanes.over[lane]) = (NO_START, 0);
                return;
            };
            self.begun += 1;
            let node = self.tree.node(start.node);
            if let Some(first) = node.first_child() {
                lanes.slot[lane] = slot;
                (lanes.u[lane], lanes.pmf[lane]) = (start.u, 1.0);
                lanes.pair[lane] = first.0 >> 1;
                prefetch_at(&self.tree.pairs, (first.0 >> 1) as usize);
                lanes
                    .receivers
                    .set(lane, self.receivers[start.receiver as usize]);
                return;
            }
            self.drawn[slot] = node.light().map(|light| Selected::new(light, 1.0));
        }
    }

    /// Weighs, lane by lane, the pairs that are not weighed side by side.
    #[inline(never)]
    fn weigh_each<const LANES: usize, const NODES: usize>(
        &self,
        lanes: &mut Lanes<LANES, NODES>,
        is_one: impl Fn(NodeId) -> bool,
    ) {
        for k in 0..LANES {
            let Some(start) = self.starts.get(lanes.slot[k]) else {
                continue;
            };
            let first = NodeId(2 * lanes.pair[k]);
            if is_one(first) {
                let receiver = self.receivers[start.receiver as usize];
                let [a, b] = self.tree.weigh(self.weights, receiver, first);
                (lanes.weights[0][k], lanes.weights[1][k]) = (a, b);
            }
        }
    }
}

impl<const LANES: usize, const NODES: usize> Lanes<LANES, NODES> {
    /// All go one level down.
    #[inline(always)]
    fn descend(&mut self) {
        for k in 0..LANES {
            // Without a branch, so that the processor works on several steps at once.
            let chosen = choose_live([self.weights[0][k], self.weights[1][k]], self.u[k]);
            self.u[k] = chosen.u;
            self.pmf[k] *= chosen.pmf;
            let links = [self.links[k], self.links[LANES + k]];
            let link = select_unpredictable(chosen.is_right, links[1], links[0]);
            let is_over = (link & LEAF != 0) | chosen.is_dead;
            self.link[k] = link;
            self.over[k] = u8::from(is_over);
            self.pair[k] = select_unpredictable(is_over, 0, link >> 1);
        }
    }

    /// A bit for each lane that is over.
    #[inline(always)]
    fn over_bits(&self) -> u64 {
        let mut bytes = [0; 8];
        bytes[..LANES].copy_from_slice(&self.over);
        // The product's last byte gathers the bits of all.
        u64::from_le_bytes(bytes).wrapping_mul(0x0102_0408_1020_4080) >> 56
    }

    const UNUSED: Self = Self {
        receivers: ReceiverLanes::NOWHERE,
        intensity: [0.0; NODES],
        links: [0; NODES],
        seen: SeenLanes::NOTHING,
        weights: [[0.0; LANES]; 2],
        u: [0.0; LANES],
        pmf: [1.0; LANES],
        pair: [0; LANES],
        link: [0; LANES],
        over: [1; LANES],
        slot: [BEFORE_FIRST; LANES],
        busy: LANES,
    };
}

impl LightTree {
    /// Draws one light of each of many clusters, for one receiver or many, dozens of them descending side by side: vector
    /// code weighs several at once, and the memory latencies of one hide behind the work for others.
    ///
    /// Appends to `drawn` in the order of `starts`: `None` where nothing can light the receiver or, with
    /// [`DeadBranch::Stop`], where a dead branch was met.
    pub fn select_each(
        &self,
        weights: NodeWeights,
        dead_branches: DeadBranch,
        receivers: &[&Receiver],
        starts: &[Start],
        drawn: &mut Vec<Option<Selected>>,
    ) {
        match dead_branches {
            DeadBranch::Stop => {
                let before = drawn.len();
                drawn.resize(before + starts.len(), None);
                let drawn = &mut drawn[before..];
                Descending::new(self, weights, receivers, starts, drawn).run();
            }
            DeadBranch::Retry => drawn.extend(starts.iter().map(|start| {
                let receiver = receivers[start.receiver as usize];
                self.select_retry(weights, receiver, start.node, start.u)
            })),
        }
    }
}

enum Step {
    Deeper,
    Leaf(LightId),
    Dead,
}

impl LightTree {
    /// Asks for the memory that the next step below `id` reads: by the time its turn comes it has arrived.
    #[inline(always)]
    pub(crate) fn prefetch_children(&self, id: NodeId) {
        let children = self.node(id).first_child();
        prefetch(children.map(|first| &self.pairs[(first.0 >> 1) as usize]));
    }

    #[inline]
    fn descend(&self, weights: NodeWeights, receiver: &Receiver, descent: &mut Descent) -> Step {
        let node = self.node(descent.node);
        let Some(first) = node.first_child() else {
            return node.light().map_or(Step::Dead, Step::Leaf);
        };
        let Some((child, p, u)) = choose(self.weigh(weights, receiver, first), descent.u) else {
            return Step::Dead;
        };
        descent.node = NodeId(first.0 + child);
        descent.pmf *= p;
        descent.u = u;
        // A product of hundreds of tiny probabilities could underflow: such a light cannot be told from none.
        if descent.pmf > 0.0 {
            Step::Deeper
        } else {
            Step::Dead
        }
    }

    /// Chooses between the children of `id` by `u` in [0, 1), as each step of [`select`](Self::select) does; `None` for
    /// a leaf, and where nothing below can light the receiver.
    pub fn choose_child(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        id: NodeId,
        u: f64,
    ) -> Option<Chosen> {
        let first = self.node(id).first_child()?;
        let (child, pmf, u) = choose(self.weigh(weights, receiver, first), u)?;
        Some(Chosen {
            child: NodeId(first.0 + child),
            pmf,
            u,
        })
    }

    /// Draws one light below `root` by `u` in [0, 1), as [`select_each`](Self::select_each) with [`DeadBranch::Stop`] does for many
    /// clusters; `None` where a dead branch is met.
    pub fn select(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        root: NodeId,
        u: f64,
    ) -> Option<Selected> {
        let mut now = Descent {
            node: root,
            u,
            pmf: 1.0,
        };
        loop {
            match self.descend(weights, receiver, &mut now) {
                Step::Leaf(light) => {
                    return Some(Selected::new(light, now.pmf));
                }
                Step::Deeper => {}
                Step::Dead => return None,
            }
        }
    }

    /// Draws one light below `root` by Algorithm 1 as printed, dead branches retried.
    ///
    /// The reported probability ignores the redirected mass, so estimates are too bright: by 1 + D where a
    /// share D of the probability of a node's other child is dead.
    ///
    /// Source: Yuksel 2019, supplement, Algorithm 1.
    pub fn select_retry(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        root: NodeId,
        u: f64,
    ) -> Option<Selected> {
        let mut passed: Vec<Descent> = Vec::new();
        let mut now = Descent {
            node: root,
            u,
            pmf: 1.0,
        };
        loop {
            let before = now;
            match self.descend(weights, receiver, &mut now) {
                Step::Leaf(light) => {
                    return Some(Selected::new(light, now.pmf));
                }
                Step::Deeper => {
                    let sibling = NodeId(now.node.0 ^ 1);
                    passed.push(Descent {
                        node: sibling,
                        ..before
                    });
                }
                Step::Dead => now = passed.pop()?,
            }
        }
    }

    /// Probability of drawing each light below `root`, by enumeration, and the dead mass left over; for tests
    /// and analysis: costs a visit of every live node.
    pub fn pmf_below(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        root: NodeId,
    ) -> (Vec<(LightId, f64)>, f64) {
        let mut lights = Vec::new();
        let mut dead = 0.0;
        let mut stack = vec![(root, 1.0)];
        while let Some((id, pmf)) = stack.pop() {
            let node = self.node(id);
            match (node.light(), node.first_child()) {
                (Some(light), _) => lights.push((light, pmf)),
                (None, Some(first)) => {
                    let [w0, w1] = self.weigh(weights, receiver, first).map(f64::from);
                    let sum = w0 + w1;
                    if sum <= 0.0 {
                        dead += pmf;
                        continue;
                    }
                    for (k, w) in [w0, w1].into_iter().enumerate() {
                        if w > 0.0 {
                            stack.push((NodeId(first.0 + k as u32), pmf * w / sum));
                        }
                    }
                }
                (None, None) => dead += pmf,
            }
        }
        (lights, dead)
    }
}

#[cfg(test)]
mod tests;
