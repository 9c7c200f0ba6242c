//! Cuts: which clusters represent all lights for one receiver.

use std::hint::select_unpredictable;

use crate::bounds::{Receiver, SeenLanes, greater, lesser};
use crate::tree::{LightTree, NodeId};
use crate::weight::NodeWeights;

/// One cluster of a cut.
#[derive(Debug, Clone, Copy)]
struct Entry {
    node: NodeId,
    /// Upper bound of what the cluster can contribute, up to material and visibility; 0 for a leaf, which is exact.
    bound: f32,
    /// Whether its children have taken its place.
    is_split: bool,
}

/// A partition of the lights that can reach a receiver into clusters; memory is kept between receivers.
#[derive(Debug, Clone, Default)]
pub struct Cut {
    entries: Vec<Entry>,
}

/// Squared distances below this share of the squared diagonal of all lights count alike in a bound, so that
/// one near light does not claim the whole cut.
const NEAREST_SHARE: f32 = 1e-4;

impl Cut {
    /// Splits the tree for `receiver`, always the cluster of greatest error bound, into at most `size` ≥ 1 clusters.
    ///
    /// Bounds look at where lights point if `weights` do. Only bounds decide, never a sampled value, so estimates over
    /// the cut stay unbiased. Clusters that provably contribute nothing are left out.
    ///
    /// Source: Yuksel 2019, §3.1; bounds of Walter et al. 2005, §3.2.
    pub fn refine(
        &mut self,
        tree: &LightTree,
        weights: NodeWeights,
        receiver: &Receiver,
        size: usize,
    ) {
        self.grow::<false>(tree, weights, receiver, size);
    }

    /// As [`refine`](Self::refine), but keeps the clusters that contribute nothing to `receiver`, which count among the
    /// `size`: every light is in one, so that other receivers can share the cut.
    ///
    /// Source: Lin and Yuksel 2020, "Real-Time Stochastic Lightcuts".
    pub fn refine_for_many(
        &mut self,
        tree: &LightTree,
        weights: NodeWeights,
        receiver: &Receiver,
        size: usize,
    ) {
        self.grow::<true>(tree, weights, receiver, size);
    }

    #[inline]
    fn grow<const KEEP_DARK: bool>(
        &mut self,
        tree: &LightTree,
        weights: NodeWeights,
        receiver: &Receiver,
        size: usize,
    ) {
        assert!(size >= 1, "a cut has at least one cluster");
        self.entries.clear();
        self.push::<KEEP_DARK>(tree, weights, receiver, tree.root());
        let mut split = 0;
        while self.entries.len() - split < size {
            let Some(worst) = self
                .entries
                .iter_mut()
                .reduce(|a, b| if b.bound > a.bound { b } else { a })
                .filter(|entry| entry.bound > 0.0)
            else {
                break;
            };
            let Some(first) = tree.node(worst.node).first_child() else {
                break;
            };
            (worst.bound, worst.is_split) = (0.0, true);
            split += 1;
            self.push::<KEEP_DARK>(tree, weights, receiver, first);
            self.push::<KEEP_DARK>(tree, weights, receiver, NodeId(first.0 + 1));
        }
        self.entries.retain(|entry| !entry.is_split);
    }

    /// The clusters.
    pub fn nodes(&self) -> impl ExactSizeIterator<Item = NodeId> + '_ {
        self.entries.iter().map(|e| e.node)
    }

    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether no light can reach the receiver.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    #[inline]
    fn push<const KEEP_DARK: bool>(
        &mut self,
        tree: &LightTree,
        weights: NodeWeights,
        receiver: &Receiver,
        id: NodeId,
    ) {
        let bound = tree.contribution_bound(weights, receiver, id);
        if bound > 0.0 || KEEP_DARK {
            let is_leaf = tree.node(id).light().is_some();
            self.entries.push(Entry {
                node: id,
                bound: if is_leaf { 0.0 } else { bound },
                is_split: false,
            });
        }
    }
}

impl LightTree {
    /// The bound by which a [`Cut`] is refined, for methods that stop by other rules: what the lights below `id` bring
    /// the receiver at most, up to material and visibility, in W/m² for scene units of a metre. It looks at where lights
    /// point if `weights` do.
    ///
    /// Finite; 0 only when nothing below can light the receiver. Distances below a hundredth of the diagonal of all
    /// lights count as that, so that one near light does not claim the whole cut.
    #[inline]
    pub fn bound(&self, weights: NodeWeights, receiver: &Receiver, id: NodeId) -> f32 {
        self.contribution_bound(weights, receiver, id)
    }

    /// The bounds, by the cosine, of both of each of `PAIRS` pairs of siblings, whose places are `pairs`; of no meaning where lights
    /// are without falloff. What is seen of them lies as in [`PairLanes`](crate::pair_lanes::PairLanes).
    #[inline(always)]
    pub(crate) fn contribution_bounds<const PAIRS: usize, const NODES: usize>(
        &self,
        seen: &SeenLanes<NODES>,
        intensity: &[f32; NODES],
        pairs: &[u32; PAIRS],
    ) -> [f32; NODES] {
        let mut nearest2 = [NEAREST_SHARE * self.diagonal2; NODES];
        if nearest2[0] < self.greatest_dist2 {
            for (lane, nearest2) in nearest2.iter_mut().enumerate() {
                let node = NodeId(2 * pairs[lane % PAIRS] + (lane / PAIRS) as u32);
                *nearest2 = nearest2.max(self.least_dist2(node));
            }
        }
        let mut bounds = [0.0; NODES];
        for k in 0..NODES {
            bounds[k] = bound(seen.cos(k), intensity[k], seen.least2[k], nearest2[k]);
        }
        bounds
    }

    /// F ‖I‖ / d² + Fᴰ ‖Iᴰ‖ with the nearest distance: 0 only when nothing below can light the receiver.
    #[inline]
    pub(crate) fn contribution_bound(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        id: NodeId,
    ) -> f32 {
        let node = self.node(id);
        let mut bound = 0.0;
        if node.has_positions() {
            let seen = receiver.relative(node);
            let nearest2 = (NEAREST_SHARE * self.diagonal2).max(self.least_dist2(id));
            let mut reflected = weights.reflection(receiver, &seen);
            if weights.bounds_emission() {
                reflected *= seen.emission_bound(self.emission(id));
            }
            bound = self::bound(reflected, node.intensity, seen.least2(), nearest2);
        }
        let parallel = self.directional_intensity(id);
        if parallel > 0.0 {
            let cos = receiver.cos_bound_parallel(self.cone(id));
            if cos > 0.0 {
                bound = (bound + parallel * cos).clamp(f32::MIN_POSITIVE, f32::MAX);
            }
        }
        bound
    }
}

/// What lights of this intensity in all, of which `reflected` arrives at most, bring at a squared distance that is no less than
/// `nearest2`: 0 only where nothing arrives.
#[inline(always)]
fn bound(reflected: f32, intensity: f32, dist2: f32, nearest2: f32) -> f32 {
    let falloff = greater(dist2, nearest2);
    // One light alone has no diagonal. Finite and above 0 keeps it in the cut.
    let value = reflected * intensity / falloff;
    let value = select_unpredictable(falloff > 0.0, value, f32::MAX);
    let value = lesser(greater(value, f32::MIN_POSITIVE), f32::MAX);
    select_unpredictable(reflected > 0.0, value, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::TreeBuilder;
    use crate::test_lights::{BLACK, any_lights, any_receiver, contribution, receiver};

    #[test]
    fn a_cut_holds_every_light_that_contributes_once() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let at = any_receiver(u, &lights)?;
            let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
                return Ok(());
            };
            let size = u.int_in_range(1..=40usize)?;
            let mut cut = Cut::default();
            let weights = *u.choose(&NodeWeights::ALL)?;
            cut.refine(&tree, weights, &receiver(at), size);
            assert!(cut.len() <= size, "{} clusters of {size}", cut.len());
            let mut seen = vec![0; lights.len()];
            for node in cut.nodes() {
                for id in tree.lights_below(node) {
                    seen[id.index()] += 1;
                }
            }
            for id in lights.ids() {
                let lit = contribution(&lights, id, at.0, at.1);
                let times = seen[id.index()];
                assert!(
                    times <= 1 && (times == 1 || lit <= BLACK),
                    "{id:?} brings {lit}, is in the cut {times} times"
                );
            }
            Ok(())
        });
    }

    #[test]
    fn a_cut_for_many_holds_every_light_once_and_is_no_larger() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let at = any_receiver(u, &lights)?;
            let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
                return Ok(());
            };
            let size = u.int_in_range(1..=40usize)?;
            let weights = *u.choose(&NodeWeights::ALL)?;
            let mut cut = Cut::default();
            cut.refine_for_many(&tree, weights, &receiver(at), size);
            assert!(cut.len() <= size, "{} clusters of {size}", cut.len());
            let mut below: Vec<u32> = cut
                .nodes()
                .flat_map(|node| tree.lights_below(node))
                .map(|id| id.0)
                .collect();
            below.sort_unstable();
            assert!(below.into_iter().eq(0..lights.len() as u32), "a partition");
            Ok(())
        });
    }

    #[test]
    fn a_bound_is_never_below_what_its_lights_bring() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let at = any_receiver(u, &lights)?;
            let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
                return Ok(());
            };
            let floor = f64::from(NEAREST_SHARE * tree.diagonal2).max(f64::from(tree.least_dist2));
            for id in tree.nodes_below(tree.root()) {
                let bound =
                    f64::from(tree.contribution_bound(NodeWeights::MinMax, &receiver(at), id));
                // Nearer than the floor a bound counts the floor, by design.
                let truth: f64 = tree
                    .lights_below(id)
                    .map(|l| {
                        let lit = contribution(&lights, l, at.0, at.1);
                        let d2 = lights
                            .bounds(l)
                            .map(|(lo, hi)| f64::from(at.0.clamp(lo, hi).distance_squared(at.0)));
                        match d2 {
                            Some(d2) if d2 < floor => lit * d2 / floor,
                            _ => lit,
                        }
                    })
                    .sum();
                assert!(
                    bound >= truth * (1.0 - 1e-4) - 1e-37,
                    "node {}: bound {bound} truth {truth}",
                    id.0
                );
            }
            Ok(())
        });
    }
}
