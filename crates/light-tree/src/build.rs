//! Building the tree: five ways to divide lights, one way to lay them out.

mod agglomerative;
mod binned;
mod morton;
mod saoh;

use std::cmp::Ordering;

use glam::Vec3;
use rayon::prelude::*;

use crate::cone::Cone;
use crate::emission::{Emission, Profile};
use crate::light::{LightId, LightKind, luminance};
use crate::lights::LightSet;
use crate::tree::{LightTree, MAX_LIGHTS, Node, Pair};
use morton::Curve;

/// A light while the tree is built; half a cache line.
#[derive(Clone, Copy)]
struct Item {
    position: Vec3,
    intensity: f32,
    axis: Vec3,
    id: u32,
}

/// How clusters are found. Any method works on any of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TreeBuilder {
    /// Top-down, binned over position and emission axis, by the metric of Walter et al. 2005 with less weight on directions.
    #[default]
    Binned,
    /// Top-down, binned over position, by the surface area orientation heuristic of Conty Estevez and Kulla 2018.
    Saoh,
    /// Split where the highest bit of the Morton code changes.
    Morton,
    /// A perfect binary tree over Morton order, as in the real-time paper of 2020.
    PerfectMorton,
    /// Bottom-up, by the metric of Walter et al. 2005, among neighbours in Morton order.
    Agglomerative,
}

impl TreeBuilder {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Binned,
        Self::Saoh,
        Self::Morton,
        Self::PerfectMorton,
        Self::Agglomerative,
    ];
}

/// What does not change during a build.
struct Context {
    builder: TreeBuilder,
    /// The Morton curve through all lights with a position.
    curve: Curve,
    /// For the agglomerative build: size of the first child of the inner node at each pair's index.
    first_sizes: Vec<u32>,
    oriented: bool,
    /// Squared diagonal of the box around everything: c² of the published metric.
    diagonal2: f32,
    /// Below this depth clusters are halved by count, so that no input makes a deep tree.
    balance_below: u32,
}

impl Context {
    /// Does what a builder does with each of the `groups` before the tree is laid out.
    fn arrange(&mut self, items: &mut [Item], groups: &[usize]) {
        if matches!(self.builder, TreeBuilder::Binned | TreeBuilder::Saoh) {
            return;
        }
        // Pairs are numbered in depth-first order. Each group but the first is the second child of a node
        // whose first child holds the groups before it.
        let mut first = 1;
        let mut rest = items.len();
        let mut starts = vec![0; groups.len()];
        for g in (1..groups.len()).rev() {
            rest -= groups[g];
            starts[g] = first + rest;
            first += 1;
        }
        starts[0] = first;
        if self.builder == TreeBuilder::Agglomerative {
            self.first_sizes = vec![0; items.len()];
        }
        let mut left = items;
        for (&size, start) in groups.iter().zip(starts) {
            let (group, others) = left.split_at_mut(size);
            left = others;
            group.par_sort_unstable_by_key(|i| (self.curve.code(i.position), i.id));
            if self.builder == TreeBuilder::Agglomerative {
                let sizes = agglomerative::cluster(self, group);
                self.first_sizes[start..start + sizes.len()].copy_from_slice(&sizes);
            }
        }
    }

    /// Reorders `items`, whose pair has number `pair`, into two clusters; returns the size of the first.
    fn split(&self, items: &mut [Item], pair: u32, depth: u32) -> usize {
        if depth >= self.balance_below {
            return halve(items);
        }
        match self.builder {
            TreeBuilder::Binned => binned::split(self, items),
            TreeBuilder::Saoh => saoh::split(self, items),
            TreeBuilder::Morton => self.curve.split(items),
            TreeBuilder::PerfectMorton => morton::perfect_half(items.len()),
            TreeBuilder::Agglomerative => self.first_sizes[pair as usize] as usize,
        }
    }
}

/// Where a subtree of n lights puts its n − 1 pairs; the other arrays are as long or empty.
struct Out<'a> {
    pairs: &'a mut [Pair],
    cones: &'a mut [[Cone; 2]],
    profiles: &'a mut [[Profile; 2]],
    directional: &'a mut [[f32; 2]],
    /// Index of `pairs[0]` in the whole tree.
    first: u32,
}

impl<'a> Out<'a> {
    /// The pair for a node's own children, and the rest for the `left` and the other subtree.
    fn split(self, left: usize) -> (Out<'a>, Out<'a>, Out<'a>) {
        let n = left - 1;
        let (pairs, pairs_l, pairs_r) = cut(self.pairs, n);
        let (cones, cones_l, cones_r) = cut(self.cones, n);
        let (profiles, profiles_l, profiles_r) = cut(self.profiles, n);
        let (directional, directional_l, directional_r) = cut(self.directional, n);
        let first = self.first;
        (
            Out {
                pairs,
                cones,
                profiles,
                directional,
                first,
            },
            Out {
                pairs: pairs_l,
                cones: cones_l,
                profiles: profiles_l,
                directional: directional_l,
                first: first + 1,
            },
            Out {
                pairs: pairs_r,
                cones: cones_r,
                profiles: profiles_r,
                directional: directional_r,
                first: first + 1 + n as u32,
            },
        )
    }
}

/// The first entry, the `n` behind it and the rest; three times nothing of nothing.
fn cut<T>(array: &mut [T], n: usize) -> (&mut [T], &mut [T], &mut [T]) {
    let (own, rest) = array.split_at_mut(1.min(array.len()));
    let (left, right) = rest.split_at_mut(n.min(rest.len()));
    (own, left, right)
}

/// A finished subtree's top node with what lies beside it.
#[derive(Clone, Copy)]
struct Top {
    node: Node,
    emission: Emission,
    directional: f32,
    depth: u32,
}

/// Which lights get a subtree of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Apart {
    /// Those without a place.
    Distant,
    /// Those of each kind.
    Kinds,
}

impl Apart {
    /// Subtrees are numbered; those of distant lights come last.
    fn rank(self, kind: LightKind) -> usize {
        match self {
            Self::Distant => usize::from(kind.is_distant()),
            Self::Kinds => kind as usize,
        }
    }
}

pub(crate) fn build(lights: &LightSet, builder: TreeBuilder, apart: Apart) -> Option<LightTree> {
    let n = lights.len();
    assert!(
        n <= MAX_LIGHTS,
        "{n} lights; a light tree holds at most {MAX_LIGHTS}"
    );
    if n == 0 {
        return None;
    }
    let mut items: Vec<Item> = lights
        .ids()
        .map(|id| Item {
            position: lights.position(id),
            intensity: luminance(lights.intensity(id)),
            axis: lights.axis(id),
            id: id.0,
        })
        .collect();
    // Distant lights have no place: they get a subtree of their own beside all the others.
    let rank = |id| apart.rank(lights.kind(LightId(id)));
    let mut groups = [0; LightKind::ALL.len()];
    let mut distant = 0;
    for i in &items {
        groups[rank(i.id)] += 1;
        distant += usize::from(lights.kind(LightId(i.id)).is_distant());
    }
    let groups: Vec<usize> = groups.into_iter().filter(|&count| count > 0).collect();
    if groups.len() > 1 {
        items.sort_by_key(|i| (rank(i.id), i.id));
    }
    let positional = n - distant;

    let oriented = items.iter().any(|i| i.axis != Vec3::ZERO);
    let profiled = lights.count(LightKind::Spot) + lights.count(LightKind::Triangle) > 0;
    let (lo, hi) = position_bounds(&items[..positional]);
    let diagonal2 = if positional > 0 {
        (hi - lo).length_squared()
    } else {
        0.0
    };
    let mut context = Context {
        builder,
        curve: Curve::over(lo, hi),
        first_sizes: Vec::new(),
        oriented,
        diagonal2,
        balance_below: 2 * usize::BITS.saturating_sub(n.leading_zeros()),
    };
    context.arrange(&mut items, &groups);

    let mut pairs = vec![Pair([Node::UNUSED; 2]); n];
    let mut cones = if oriented {
        vec![[Cone::SPHERE; 2]; n]
    } else {
        Vec::new()
    };
    let mut profiles = if profiled {
        vec![[Profile::default(); 2]; n]
    } else {
        Vec::new()
    };
    let mut directional = if distant > 0 {
        vec![[0.0; 2]; n]
    } else {
        Vec::new()
    };
    let out = Out {
        pairs: &mut pairs[1..],
        cones: below(&mut cones),
        profiles: below(&mut profiles),
        directional: below(&mut directional),
        first: 1,
    };
    let root = subtree(&context, lights, &mut items, out, 0, &groups);
    pairs[0].0[0] = root.node;
    if let Some(c) = cones.first_mut() {
        c[0] = root.emission.cone;
    }
    if let Some(p) = profiles.first_mut() {
        p[0] = root.emission.profile;
    }
    if let Some(d) = directional.first_mut() {
        d[0] = root.directional;
    }
    Some(LightTree {
        pairs,
        cones: cones.into_iter().flatten().collect(),
        profiles: profiles.into_iter().flatten().collect(),
        directional: directional.into_iter().flatten().collect(),
        lights: n,
        depth: root.depth,
        diagonal2: if positional > 0 {
            (root.node.hi - root.node.lo).length_squared()
        } else {
            0.0
        },
        least_dist2: 0.0,
        least_dist2_below: Vec::new(),
        greatest_dist2: 0.0,
    })
}

/// All entries but the first; nothing of nothing.
fn below<T>(array: &mut [T]) -> &mut [T] {
    let first = 1.min(array.len());
    &mut array[first..]
}

/// Builds the subtree over `items`, which are `groups` of these lengths that are kept apart.
fn subtree(
    context: &Context,
    lights: &LightSet,
    items: &mut [Item],
    out: Out<'_>,
    depth: u32,
    groups: &[usize],
) -> Top {
    let n = items.len();
    if n == 1 {
        return leaf(lights, LightId(items[0].id));
    }
    let (left, groups) = match groups {
        [others @ .., last] if !others.is_empty() => (n - last, others),
        _ => (context.split(items, out.first, depth), groups),
    };
    let (own, out_l, out_r) = out.split(left);
    let (items_l, items_r) = items.split_at_mut(left);
    let build_l = |items| subtree(context, lights, items, out_l, depth + 1, groups);
    let build_r = |items| subtree(context, lights, items, out_r, depth + 1, &[]);
    // Smaller tasks cost more to hand over than to do.
    let (l, r) = if n > 4096 {
        rayon::join(|| build_l(items_l), || build_r(items_r))
    } else {
        (build_l(items_l), build_r(items_r))
    };
    own.pairs[0] = Pair([l.node, r.node]);
    if let Some(c) = own.cones.first_mut() {
        *c = [l.emission.cone, r.emission.cone];
    }
    if let Some(p) = own.profiles.first_mut() {
        *p = [l.emission.profile, r.emission.profile];
    }
    if let Some(d) = own.directional.first_mut() {
        *d = [l.directional, r.directional];
    }
    Top {
        node: Node::inner(
            l.node.lo.min(r.node.lo),
            l.node.hi.max(r.node.hi),
            l.node.intensity + r.node.intensity,
            2 * own.first,
        ),
        emission: if context.oriented {
            l.emission.union(r.emission)
        } else {
            Emission::ANY
        },
        directional: l.directional + r.directional,
        depth: 1 + l.depth.max(r.depth),
    }
}

fn leaf(lights: &LightSet, id: LightId) -> Top {
    let distant = lights.kind(id).is_distant();
    Top {
        node: lights.leaf(id),
        emission: lights.emission(id),
        directional: if distant {
            luminance(lights.intensity(id))
        } else {
            0.0
        },
        depth: 0,
    }
}

fn position_bounds(items: &[Item]) -> (Vec3, Vec3) {
    items
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), i| {
            (lo.min(i.position), hi.max(i.position))
        })
}

/// Clusters larger than this are judged by about so many of their lights.
const JUDGED: usize = 1 << 14;

/// Moves the items that are `left` to the front and returns their number.
fn partition(items: &mut [Item], left: impl Fn(&Item) -> bool) -> usize {
    let mut front = 0;
    for i in 0..items.len() {
        if left(&items[i]) {
            items.swap(front, i);
            front += 1;
        }
    }
    front
}

/// Halves by count along the longest axis; ties, and lights that coincide, by id.
fn halve(items: &mut [Item]) -> usize {
    let (lo, hi) = position_bounds(items);
    let axis = if lo.x <= hi.x {
        (hi - lo).max_position()
    } else {
        0
    };
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| {
        let by_place = a.position[axis]
            .partial_cmp(&b.position[axis])
            .unwrap_or(Ordering::Equal);
        by_place.then(a.id.cmp(&b.id))
    });
    middle
}

#[cfg(test)]
mod tests;
