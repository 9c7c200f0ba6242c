//! Bottom-up clustering by the metric of Walter et al. 2005.
//!
//! Pairing the two clusters of least cost in all the set costs a search over everything for each merge.
//! Here each cluster looks at its neighbours along the Morton curve, and those that choose each other
//! merge, all at once: the pairs are nearly always those the full search finds.
//!
//! Sources: Walter et al., "Lightcuts", 2005, §3.1 (metric, greedy pairing); Meister and Bittner, "Parallel
//! Locally-Ordered Clustering", 2018 (neighbours that choose each other).

use rayon::prelude::*;

use super::binned::Bin;
use super::{Context, Item};

/// Neighbours looked at to each side.
const RADIUS: usize = 16;

/// A cluster with its place in the forest.
#[derive(Clone, Copy)]
struct Cluster {
    bin: Bin,
    node: u32,
}

/// Reorders `items`, which are sorted along a curve, so that every cluster is a range, and returns the size of
/// the first child of each inner node in depth-first order.
pub(super) fn cluster(context: &Context, items: &mut [Item]) -> Vec<u32> {
    let n = items.len();
    // Leaves are 0..n; inner nodes follow as they are made.
    let mut children: Vec<[u32; 2]> = Vec::with_capacity(n);
    let mut sizes: Vec<u32> = vec![1; n];
    let mut clusters: Vec<Cluster> = items
        .iter()
        .enumerate()
        .map(|(i, item)| Cluster {
            bin: Bin::of(item),
            node: i as u32,
        })
        .collect();
    while clusters.len() > 1 {
        let nearest: Vec<usize> = (0..clusters.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| nearest(context, &clusters, i))
            .collect();
        let mut next = Vec::with_capacity(clusters.len() / 2 + 1);
        for (i, cluster) in clusters.iter().enumerate() {
            let other = nearest[i];
            if nearest[other] != i {
                next.push(*cluster);
            } else if i < other {
                let node = sizes.len() as u32;
                let pair = [cluster.node, clusters[other].node];
                children.push(pair);
                sizes.push(sizes[pair[0] as usize] + sizes[pair[1] as usize]);
                let mut bin = cluster.bin;
                bin.merge(&clusters[other].bin);
                next.push(Cluster { bin, node });
            }
        }
        clusters = next;
    }
    lay_out(items, &children, &sizes)
}

/// The neighbour that `clusters[i]` is cheapest together with.
///
/// Pairs are ordered alike seen from both sides, so the least pair of all always choose each other. Among
/// equals that order prefers neighbours, and of those the pairs that begin at an even place: clusters that
/// coincide then merge two by two, all at once, instead of one after the other.
fn nearest(context: &Context, clusters: &[Cluster], i: usize) -> usize {
    let mut best: Option<(f64, [usize; 3], usize)> = None;
    for j in i.saturating_sub(RADIUS)..(i + RADIUS + 1).min(clusters.len()) {
        if j == i {
            continue;
        }
        let mut both = clusters[i].bin;
        both.merge(&clusters[j].bin);
        let cost = both.cost(context.diagonal2);
        let first = i.min(j);
        let tie = [i.abs_diff(j), first & 1, first];
        if best.is_none_or(|(c, t, _)| cost < c || (cost == c && tie < t)) {
            best = Some((cost, tie, j));
        }
    }
    // Only a cluster with a neighbour is asked.
    best.map_or(i, |(.., j)| j)
}

/// Puts the items in depth-first order.
fn lay_out(items: &mut [Item], children: &[[u32; 2]], sizes: &[u32]) -> Vec<u32> {
    let n = items.len();
    let mut ordered = Vec::with_capacity(n);
    let mut first_sizes = Vec::with_capacity(children.len());
    let mut stack = vec![sizes.len() as u32 - 1];
    while let Some(node) = stack.pop() {
        match (node as usize).checked_sub(n) {
            None => ordered.push(items[node as usize]),
            Some(inner) => {
                let [a, b] = children[inner];
                first_sizes.push(sizes[a as usize]);
                stack.extend([b, a]);
            }
        }
    }
    items.copy_from_slice(&ordered);
    first_sizes
}
