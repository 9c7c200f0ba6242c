//! Cuts of many receivers, several refined side by side.

use std::hint::select_unpredictable;

use crate::bounds::{Receiver, ReceiverLanes, SeenLanes};
use crate::cut::Cut;
use crate::pair_lanes::PairLanes;
use crate::tree::{LEAF, LightTree, NodeId, Pair};
use crate::weight::NodeWeights;
use crate::wide::by_width;

/// The [`Cut`] of each of many receivers; memory is kept from call to call.
#[derive(Debug, Clone, Default)]
pub struct Cuts {
    /// Clusters, cut by cut, and behind them what earlier calls have left.
    nodes: Vec<NodeId>,
    /// Where each cut ends among them.
    ends: Vec<usize>,
    /// Of a receiver by itself.
    own: Cut,
}

/// Whose cuts are asked for, by what bounds and of how many clusters.
#[derive(Clone, Copy)]
struct Asked<'a> {
    tree: &'a LightTree,
    weights: NodeWeights,
    size: u32,
}

impl Cuts {
    /// What [`Cut::refine`] does for each of the receivers, as far as rounding does not tell bounds apart: by the cosine they are
    /// computed side by side, with fused multiplication, also for a receiver by itself.
    pub fn refine(
        &mut self,
        tree: &LightTree,
        weights: NodeWeights,
        receivers: &[&Receiver],
        size: usize,
    ) {
        assert!(size >= 1, "a cut has at least one cluster");
        self.ends.clear();
        let by_cosine = match weights {
            NodeWeights::Yuksel2019 | NodeWeights::MinMaxWithoutCones => true,
            NodeWeights::MinMax | NodeWeights::MinMaxGlossy | NodeWeights::ContyKulla2018 => false,
        };
        if by_cosine {
            return self.refine_all(tree, weights, receivers, size);
        }
        self.nodes.clear();
        for receiver in receivers {
            self.own.refine(tree, weights, receiver, size);
            self.nodes.extend(self.own.nodes());
            self.ends.push(self.nodes.len());
        }
    }

    /// The clusters of the cut of the `i`-th receiver.
    pub fn of(&self, i: usize) -> &[NodeId] {
        let start = match i {
            0 => 0,
            _ => self.ends[i - 1],
        };
        &self.nodes[start..self.ends[i]]
    }

    fn refine_all(
        &mut self,
        tree: &LightTree,
        weights: NodeWeights,
        receivers: &[&Receiver],
        size: usize,
    ) {
        let asked = Asked {
            tree,
            weights,
            size: size as u32,
        };
        by_width!(
            self.refine_avx512(asked, receivers),
            self.refine_avx2(asked, receivers),
            self.refine_plain(asked, receivers)
        )
    }

    /// The same code and the same bits, sixteen nodes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn refine_avx512(&mut self, asked: Asked<'_>, receivers: &[&Receiver]) {
        let load = |pairs: [&Pair; 8]| PairLanes::of_avx512(pairs);
        self.refine_with::<8, 16>(asked, receivers, load);
    }

    /// The same code and the same bits, eight nodes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn refine_avx2(&mut self, asked: Asked<'_>, receivers: &[&Receiver]) {
        let load = |pairs: [&Pair; 4]| PairLanes::of_avx2(pairs);
        self.refine_with::<4, 8>(asked, receivers, load);
    }

    fn refine_plain(&mut self, asked: Asked<'_>, receivers: &[&Receiver]) {
        self.refine_with::<4, 8>(asked, receivers, PairLanes::of);
    }

    #[inline(always)]
    fn refine_with<const LANES: usize, const NODES: usize>(
        &mut self,
        asked: Asked<'_>,
        receivers: &[&Receiver],
        load: impl Fn([&Pair; LANES]) -> PairLanes<LANES, NODES>,
    ) {
        let mut groups = vec![Group::<LANES, NODES>::default(); GROUPS];
        let mut kept = 0;
        for (begun, some) in receivers.chunks(GROUPS * LANES).enumerate() {
            let of_group = |i: usize| &some[(i * LANES).min(some.len())..];
            for (i, group) in groups.iter_mut().enumerate() {
                group.begin(asked, of_group(i));
            }
            for next in receivers
                .iter()
                .skip((begun + 1) * GROUPS * LANES)
                .take(GROUPS * LANES)
            {
                next.prefetch();
            }
            // As if the last two had had their turns.
            groups[GROUPS - 2].look(asked.tree, &load);
            groups[GROUPS - 2].bound(asked, of_group(GROUPS - 2));
            groups[GROUPS - 1].look(asked.tree, &load);
            let mut is_done = false;
            while !is_done {
                is_done = true;
                for i in 0..GROUPS {
                    let before = |turns: usize| (i + GROUPS - turns) % GROUPS;
                    groups[i].look(asked.tree, &load);
                    groups[before(1)].bound(asked, of_group(before(1)));
                    groups[before(2)].split(asked.size);
                    is_done &= groups[before(2)].goes_on == [0; LANES];
                }
            }
            for (i, _) in some.iter().enumerate() {
                kept = groups[i / LANES].copy_nodes(i % LANES, &mut self.nodes, kept);
                self.ends.push(kept);
            }
        }
    }
}

/// Groups of cuts that take their steps by turns, a third of one with thirds of others: each is one long chain of operations, of
/// which the processor follows several at once.
const GROUPS: usize = 4;

/// Cuts that are refined together. `NODES` is twice `LANES`.
#[derive(Debug, Clone)]
struct Group<const LANES: usize, const NODES: usize> {
    receivers: ReceiverLanes<LANES>,
    /// Of the children of what is split.
    seen: SeenLanes<NODES>,
    intensity: [f32; NODES],
    links: [u32; NODES],
    bounds: [f32; NODES],
    /// What has been in the cuts so far, behind what is in none, and behind that what earlier ones have left.
    entries: Vec<Entries<LANES>>,
    /// How many of these are in use.
    filled: usize,
    /// Clusters of each cut.
    counts: [u32; LANES],
    /// The place among pairs of the children of what is split next; the root's own, which has no sibling, where nothing is.
    pair: [u32; LANES],
    /// Whether anything is: 0 or 1.
    goes_on: [u32; LANES],
}

/// One cluster of each of several cuts. What is written together lies in one line.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Entries<const LANES: usize> {
    node: [u32; LANES],
    /// The place of its children among pairs.
    pair: [u32; LANES],
    /// As in a [`Cut`], but for a leaf [`LEAF_BOUND`], and 0 for what is not in the cut, or not any more.
    bound: [f32; LANES],
}

impl<const LANES: usize> Entries<LANES> {
    /// In no cut, with the root's place for that of its children.
    const NONE: Self = Self {
        bound: [0.0; LANES],
        node: [0; LANES],
        pair: [0; LANES],
    };
}

/// The place of [`Entries::NONE`].
const NOWHERE: u32 = 0;
/// Less than any bound: a leaf cannot be split.
const LEAF_BOUND: f32 = -1.0;

impl<const LANES: usize, const NODES: usize> Default for Group<LANES, NODES> {
    fn default() -> Self {
        Self {
            receivers: ReceiverLanes::NOWHERE,
            seen: SeenLanes::NOTHING,
            intensity: [0.0; NODES],
            links: [0; NODES],
            bounds: [0.0; NODES],
            entries: Vec::new(),
            filled: 0,
            counts: [0; LANES],
            pair: [0; LANES],
            goes_on: [0; LANES],
        }
    }
}

impl<const LANES: usize, const NODES: usize> Group<LANES, NODES> {
    /// Begins the cuts of the first `LANES` receivers, or as many as there are.
    #[inline(always)]
    fn begin(&mut self, asked: Asked<'_>, receivers: &[&Receiver]) {
        // Where there may be two clusters the root is always split: a cut that it is too dark for holds none of its children either.
        let root = asked.tree.node(asked.tree.root());
        let first = root.first_child().filter(|_| asked.size > 1);
        self.goes_on = [0; LANES];
        for (lane, receiver) in receivers.iter().take(LANES).enumerate() {
            self.receivers.set(lane, receiver);
            self.goes_on[lane] = 1;
        }
        if self.entries.is_empty() {
            self.entries.push(Entries::NONE);
        }
        self.filled = 1;
        self.counts = [0; LANES];
        self.pair = [first.map_or(0, |first| first.0 >> 1); LANES];
    }

    /// Puts the clusters of a cut behind `kept` others; returns how many are kept then.
    fn copy_nodes(&self, lane: usize, nodes: &mut Vec<NodeId>, mut kept: usize) -> usize {
        let most = kept + self.filled;
        if nodes.len() < most {
            nodes.resize(2 * most, NodeId(0));
        }
        let nodes = &mut nodes[..most];
        for entries in &self.entries[..self.filled] {
            // Without a branch: which are split cannot be foreseen. No bound is −0.
            nodes[kept] = NodeId(entries.node[lane]);
            kept += usize::from(entries.bound[lane].to_bits() != 0);
        }
        kept
    }

    /// Looks at the children of what is split.
    #[allow(
        clippy::needless_range_loop,
        reason = "an iterator's adaptor would not be compiled for the wider instructions"
    )]
    #[inline(always)]
    fn look(
        &mut self,
        tree: &LightTree,
        load: &impl Fn([&Pair; LANES]) -> PairLanes<LANES, NODES>,
    ) {
        let mut pairs = [&tree.pairs[0]; LANES];
        for k in 0..LANES {
            pairs[k] = &tree.pairs[self.pair[k] as usize];
        }
        let children = load(pairs);
        self.seen = self.receivers.see(&children.boxes);
        (self.intensity, self.links) = (children.intensity, children.links);
    }

    /// Bounds what they bring.
    #[inline(always)]
    fn bound(&mut self, asked: Asked<'_>, receivers: &[&Receiver]) {
        let Asked { tree, weights, .. } = asked;
        self.bounds = tree.contribution_bounds(&self.seen, &self.intensity, &self.pair);
        if !tree.directional.is_empty() {
            self.bound_parallel(tree, weights, receivers);
        }
    }

    /// Bounds, lane by lane, the children among which there are lights without falloff.
    #[inline(never)]
    fn bound_parallel(&mut self, tree: &LightTree, weights: NodeWeights, receivers: &[&Receiver]) {
        for (lane, receiver) in receivers.iter().enumerate().take(LANES) {
            for c in 0..2 {
                let node = NodeId(2 * self.pair[lane] + c);
                if tree.directional_intensity(node) > 0.0 {
                    self.bounds[c as usize * LANES + lane] =
                        tree.contribution_bound(weights, receiver, node);
                }
            }
        }
    }

    /// Splits a cluster of each cut that is not complete, and finds the next.
    #[allow(
        clippy::needless_range_loop,
        reason = "an iterator's adaptor would not be compiled for the wider instructions"
    )]
    #[inline(always)]
    fn split(&mut self, size: u32) {
        if self.entries.len() < self.filled + 2 {
            // Once for all, as a call empties the registers.
            self.entries.resize(2 * self.filled + 32, Entries::NONE);
        }
        let (filled, added) = self.entries.split_at_mut(self.filled);
        let mut worst = [0.0; LANES];
        let mut place = [NOWHERE; LANES];
        for (i, entries) in filled.iter().enumerate() {
            for k in 0..LANES {
                let is_worse = entries.bound[k] > worst[k];
                worst[k] = select_unpredictable(is_worse, entries.bound[k], worst[k]);
                place[k] = select_unpredictable(is_worse, i as u32, place[k]);
            }
        }
        for c in 0..2 {
            let i = (self.filled + c) as u32;
            let mut entries = Entries::NONE;
            for k in 0..LANES {
                let (bound, link) = (self.bounds[c * LANES + k], self.links[c * LANES + k]);
                let is_lit = (self.goes_on[k] != 0) & (bound > 0.0);
                let bound = select_unpredictable(link & LEAF != 0, LEAF_BOUND, bound);
                let bound = select_unpredictable(is_lit, bound, 0.0);
                self.counts[k] += u32::from(is_lit);
                entries.bound[k] = bound;
                entries.node[k] = 2 * self.pair[k] + c as u32;
                entries.pair[k] = link >> 1;
                let is_worse = bound > worst[k];
                worst[k] = select_unpredictable(is_worse, bound, worst[k]);
                place[k] = select_unpredictable(is_worse, i, place[k]);
            }
            added[c] = entries;
        }
        self.filled += 2;
        for k in 0..LANES {
            let goes_on = (self.goes_on[k] != 0) & (worst[k] > 0.0) & (self.counts[k] < size);
            self.goes_on[k] = u32::from(goes_on);
            self.counts[k] -= u32::from(goes_on);
            place[k] = select_unpredictable(goes_on, place[k], NOWHERE);
        }
        // The only numbers that lie apart.
        let entries = &mut self.entries[..];
        for k in 0..LANES {
            let split = &mut entries[place[k] as usize];
            split.bound[k] = 0.0;
            self.pair[k] = split.pair[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::TreeBuilder;
    use crate::test_lights::{any_lights, any_receiver, receiver};

    /// The bound of a cluster by itself, as those are computed that are refined side by side.
    fn bound(tree: &LightTree, weights: NodeWeights, receiver: &Receiver, id: NodeId) -> f32 {
        if tree.directional_intensity(id) > 0.0 {
            return tree.contribution_bound(weights, receiver, id);
        }
        let pair = id.0 >> 1;
        let lanes = PairLanes::<1, 2>::of([&tree.pairs[pair as usize]]);
        let seen = ReceiverLanes::<1>::splat(receiver).see(&lanes.boxes);
        tree.contribution_bounds(&seen, &lanes.intensity, &[pair])[(id.0 & 1) as usize]
    }

    /// What [`Cut::refine`] does, by such bounds.
    fn cut(
        tree: &LightTree,
        weights: NodeWeights,
        receiver: &Receiver,
        size: usize,
    ) -> Vec<NodeId> {
        let with_bound = |id| (id, bound(tree, weights, receiver, id));
        let lit = |(id, bound): (NodeId, f32)| (bound > 0.0).then_some((id, bound));
        let mut clusters: Vec<(NodeId, f32)> = lit(with_bound(tree.root())).into_iter().collect();
        let mut split = Vec::new();
        while clusters.len() - split.len() < size {
            let inner = clusters
                .iter()
                .filter(|(id, _)| !split.contains(id) && tree.node(*id).first_child().is_some());
            let Some(&(worst, _)) = inner.reduce(|a, b| if b.1 > a.1 { b } else { a }) else {
                break;
            };
            split.push(worst);
            let first = tree.node(worst).first_child().expect("is inner");
            let children = [first, NodeId(first.0 + 1)].map(with_bound);
            clusters.extend(children.into_iter().filter_map(lit));
        }
        let rest = clusters.into_iter().map(|(id, _)| id);
        rest.filter(|id| !split.contains(id)).collect()
    }

    #[test]
    fn cuts_side_by_side_are_those_of_each_receiver_alone() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
                return Ok(());
            };
            // Up to more than there are lanes.
            let mut receivers = Vec::new();
            let most = *u.choose(&[9, 40])?;
            for _ in 0..u.int_in_range(1..=most)? {
                receivers.push(receiver(any_receiver(u, &lights)?));
            }
            let receivers: Vec<&Receiver> = receivers.iter().collect();
            let size = u.int_in_range(1..=40)?;
            let mut cuts = Cuts::default();
            let mut own = Cut::default();
            let mut check = |weights, cuts: &Cuts| {
                for (i, receiver) in receivers.iter().enumerate() {
                    let alone = match weights {
                        NodeWeights::Yuksel2019 | NodeWeights::MinMaxWithoutCones => {
                            cut(&tree, weights, receiver, size)
                        }
                        _ => {
                            own.refine(&tree, weights, receiver, size);
                            own.nodes().collect()
                        }
                    };
                    assert_eq!(cuts.of(i), alone, "{weights:?}, receiver {i}");
                }
            };
            for weights in NodeWeights::ALL {
                cuts.refine(&tree, weights, &receivers, size);
                check(weights, &cuts);
            }
            // The same by narrower instructions.
            let weights = NodeWeights::Yuksel2019;
            let asked = Asked {
                tree: &tree,
                weights,
                size: size as u32,
            };
            cuts.ends.clear();
            cuts.refine_plain(asked, &receivers);
            check(weights, &cuts);
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2")
                && std::arch::is_x86_feature_detected!("fma")
            {
                cuts.ends.clear();
                #[allow(unsafe_code, reason = "the code for a processor that has AVX2")]
                // SAFETY: this one has.
                unsafe {
                    cuts.refine_avx2(asked, &receivers);
                }
                check(weights, &cuts);
            }
            Ok(())
        });
    }
}
