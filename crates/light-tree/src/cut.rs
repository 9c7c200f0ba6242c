//! Cuts: which clusters represent all lights for one receiver.

use crate::bounds::Receiver;
use crate::tree::{LightTree, NodeId};

/// One cluster of a cut.
#[derive(Debug, Clone, Copy)]
struct Entry {
    node: NodeId,
    /// Upper bound of what the cluster can contribute, up to material and visibility; 0 for a leaf, which is exact.
    bound: f32,
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
    /// Only bounds decide, never a sampled value, so estimates over the cut stay unbiased. Clusters that
    /// provably contribute nothing are left out.
    ///
    /// Source: Yuksel 2019, §3.1; bounds of Walter et al. 2005, §3.2.
    pub fn refine(&mut self, tree: &LightTree, receiver: &Receiver, size: usize) {
        assert!(size >= 1, "a cut has at least one cluster");
        self.entries.clear();
        self.push(tree, receiver, tree.root());
        while self.entries.len() < size {
            let Some((worst, entry)) = self
                .entries
                .iter()
                .enumerate()
                .reduce(|a, b| if b.1.bound > a.1.bound { b } else { a })
                .filter(|(_, e)| e.bound > 0.0)
            else {
                return;
            };
            let Some(first) = tree.node(entry.node).first_child() else {
                return;
            };
            self.entries.swap_remove(worst);
            self.push(tree, receiver, first);
            self.push(tree, receiver, NodeId(first.0 + 1));
        }
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
    fn push(&mut self, tree: &LightTree, receiver: &Receiver, id: NodeId) {
        let bound = tree.contribution_bound(receiver, id);
        if bound > 0.0 {
            let is_leaf = tree.node(id).light().is_some();
            self.entries.push(Entry {
                node: id,
                bound: if is_leaf { 0.0 } else { bound },
            });
        }
    }
}

impl LightTree {
    /// F ‖I‖ / d² + Fᴰ ‖Iᴰ‖ with the nearest distance: 0 only when nothing below can light the receiver.
    #[inline]
    fn contribution_bound(&self, receiver: &Receiver, id: NodeId) -> f32 {
        let node = self.node(id);
        let mut bound = 0.0;
        if node.has_positions() {
            let (centre, half) = receiver.offset(node);
            let d2 = (centre.abs() - half)
                .max(glam::Vec3A::ZERO)
                .length_squared();
            let nearest2 = (NEAREST_SHARE * self.diagonal2).max(self.least_dist2);
            let cos = receiver.cos_bound_over(centre, half);
            if cos > 0.0 {
                let falloff = d2.max(nearest2);
                // One light alone has no diagonal. Finite and above 0 keeps it in the cut.
                let value = if falloff > 0.0 {
                    cos * node.intensity / falloff
                } else {
                    f32::MAX
                };
                bound = value.clamp(f32::MIN_POSITIVE, f32::MAX);
            }
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
