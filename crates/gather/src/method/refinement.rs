//! A cut under refinement: always the cluster that may be farthest off is split, until none can be off by more
//! than a share of the total.
//!
//! Source: Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005, §3.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::Fraction;
use crate::shadow_queue::Gathered;

/// The published share of the total that a cluster may be off by: 2 %, what can just be seen by Weber's law.
pub(super) const JUST_VISIBLE: Fraction = Fraction::of(0.02);

/// A cluster, named by `key`, that may still be split.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cluster<K, S> {
    /// Upper bound of what the cluster sends, and so of its error; in the measure of [`mean`].
    pub(super) bound: f64,
    pub(super) key: K,
    /// What is known of its representative.
    pub(super) sample: S,
    /// What all of it is taken to send.
    pub(super) estimate: DVec3,
}

impl<K: Ord, S> PartialEq for Cluster<K, S> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<K: Ord, S> Eq for Cluster<K, S> {}

impl<K: Ord, S> PartialOrd for Cluster<K, S> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<K: Ord, S> Ord for Cluster<K, S> {
    /// By bound; ties by key, so that the order is the same everywhere.
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound
            .total_cmp(&other.bound)
            .then_with(|| other.key.cmp(&self.key))
    }
}

/// The cut under way; memory is kept when it is begun anew.
#[derive(Debug)]
pub(super) struct Refinement<K, S> {
    heap: BinaryHeap<Cluster<K, S>>,
    /// What the clusters send that need no splitting.
    exact: Gathered,
    /// Clusters, exact ones included.
    size: usize,
    /// Of the estimates, as they were added and taken away.
    total: f64,
    /// The largest that `total` was since it was last added up anew: its error is some 10⁻¹⁶ of this.
    peak: f64,
}

impl<K: Ord, S> Default for Refinement<K, S> {
    fn default() -> Self {
        Self {
            heap: BinaryHeap::new(),
            exact: Gathered::default(),
            size: 0,
            total: 0.0,
            peak: 0.0,
        }
    }
}

impl<K: Ord, S> Refinement<K, S> {
    /// Begins a new cut.
    pub(super) fn clear(&mut self) {
        self.heap.clear();
        (self.exact, self.size) = (Gathered::default(), 0);
        (self.total, self.peak) = (0.0, 0.0);
    }

    /// Takes a cluster that may be split.
    pub(super) fn add(&mut self, cluster: Cluster<K, S>) {
        self.change(cluster.estimate, 1.0);
        self.size += 1;
        self.heap.push(cluster);
    }

    /// Takes a cluster whose estimate is exact. `is_source` says whether its light is one of the scene's own.
    pub(super) fn add_exact(&mut self, estimate: DVec3, is_source: bool) {
        self.change(estimate, 1.0);
        self.size += 1;
        self.exact += Gathered::by(estimate, is_source);
    }

    /// Takes the cluster of greatest bound away, to be split; `None` when the cut has `size` clusters, or no
    /// bound is above `error` of the total.
    ///
    /// Where the total is 0 every bound is above it: what cannot be seen to be little is looked at.
    pub(super) fn worst(&mut self, size: usize, error: f64) -> Option<Cluster<K, S>> {
        // So much was taken away that digits were lost.
        if self.total < 1e-6 * self.peak {
            self.total = mean(self.sum(|_| false).all);
            self.peak = self.total;
        }
        let worst = self.heap.peek()?;
        if self.size >= size || worst.bound <= error * self.total {
            return None;
        }
        let worst = self.heap.pop()?;
        self.size -= 1;
        self.change(worst.estimate, -1.0);
        Some(worst)
    }

    /// What all clusters send, added up anew. `is_source` says of those that are not exact whether their lights are the
    /// scene's own.
    pub(super) fn sum(&self, is_source: impl Fn(&Cluster<K, S>) -> bool) -> Gathered {
        let mut sum = self.exact;
        for cluster in self.clusters() {
            sum += Gathered::by(cluster.estimate, is_source(cluster));
        }
        sum
    }

    /// The clusters that are not exact, in no order that has a meaning, but always the same.
    pub(super) fn clusters(&self) -> impl Iterator<Item = &Cluster<K, S>> {
        self.heap.iter()
    }

    fn change(&mut self, estimate: DVec3, sign: f64) {
        self.total += sign * mean(estimate);
        self.peak = self.peak.max(self.total);
    }
}

/// The mean of the channels, as [`light_tree::luminance`].
pub(super) fn mean(c: DVec3) -> f64 {
    c.element_sum() * (1.0 / 3.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cluster(key: u32, bound: f64, estimate: f64) -> Cluster<u32, ()> {
        Cluster {
            bound,
            key,
            sample: (),
            estimate: DVec3::splat(estimate),
        }
    }

    #[test]
    fn the_greatest_bound_goes_first_until_all_are_small() {
        let mut cut = Refinement::default();
        for (key, bound) in [(1, 5.0), (2, 9.0), (3, f64::INFINITY), (4, 9.0), (5, 1.0)] {
            cut.add(cluster(key, bound, 10.0));
        }
        let mut order = Vec::new();
        while let Some(worst) = cut.worst(1000, 0.1) {
            order.push(worst.key);
        }
        // Of equal bounds the first; when two are left 0.1 of their total is 2.
        assert_eq!(order, [3, 2, 4, 1], "the order of splitting");
        let sum = cut.sum(|_| false);
        assert_eq!(sum.all, DVec3::splat(10.0), "one is left");
        assert_eq!(sum.of_sources, DVec3::ZERO, "it is no source");
    }

    #[test]
    fn a_full_cut_is_not_split() {
        let mut cut = Refinement::default();
        cut.add(cluster(1, 5.0, 1.0));
        cut.add_exact(DVec3::ONE, true);
        let sum = cut.sum(|c| c.key == 2);
        assert_eq!(sum.all, DVec3::splat(2.0), "all");
        assert_eq!(sum.of_sources, DVec3::ONE, "the exact one");
        assert!(cut.worst(2, 0.0).is_none(), "two clusters");
        assert!(cut.worst(3, 0.0).is_some(), "three are allowed");
    }

    #[test]
    fn what_is_dark_is_split_as_long_as_it_might_not_be() {
        let mut cut = Refinement::default();
        cut.add(cluster(1, 1e-30, 0.0));
        assert!(
            cut.worst(10, 0.02).is_some(),
            "nothing is small against nothing"
        );
    }

    #[test]
    fn a_large_estimate_that_is_taken_away_again_leaves_the_small_ones() {
        let mut cut = Refinement::default();
        cut.add(cluster(1, 1e20, 1e20));
        cut.add(cluster(2, 0.5, 1.0));
        assert_eq!(cut.worst(10, 0.02).map(|c| c.key), Some(1), "the large one");
        assert_eq!(cut.total, 0.0, "the small one is lost in rounding");
        assert!(cut.worst(10, 0.6).is_none(), "0.5 is within 0.6 of 1");
        assert_eq!(cut.total, 1.0, "added up anew");
    }
}
