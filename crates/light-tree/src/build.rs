//! Building the tree: five ways to divide lights, one way to lay them out.

mod agglomerative;
mod binned;
mod few;
mod morton;
mod saoh;

use std::cmp::Ordering;

use glam::Vec3;
use rayon::prelude::*;

use crate::cone::Cone;
use crate::emission::{Emission, Profile};
use crate::light::{LightId, LightKind, luminance};
use crate::lights::LightSet;
use crate::tree::{Directions, Floor, LightTree, MAX_LIGHTS, Node, Pair};
use few::{FEW, Joined};
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
    /// Whether lights have directions, and whether the tree keeps them.
    oriented: bool,
    keeps_directions: bool,
    /// Squared diagonal of the box around everything: c² of the published metric.
    diagonal2: f32,
    /// c² of the metric of the binned build, 0 where lights have no directions.
    c2: f32,
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

    /// Whether `n` lights at this depth are joined from below, which might take a level for each.
    fn is_joined(&self, n: usize, depth: u32) -> bool {
        self.builder == TreeBuilder::Binned && n <= FEW && depth + n as u32 <= self.balance_below
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
    /// One a pair.
    least_dist2: &'a mut [Floor],
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
        let (least_dist2, least_dist2_l, least_dist2_r) = cut(self.least_dist2, n);
        let first = self.first;
        (
            Out {
                pairs,
                cones,
                profiles,
                directional,
                least_dist2,
                first,
            },
            Out {
                pairs: pairs_l,
                cones: cones_l,
                profiles: profiles_l,
                directional: directional_l,
                least_dist2: least_dist2_l,
                first: first + 1,
            },
            Out {
                pairs: pairs_r,
                cones: cones_r,
                profiles: profiles_r,
                directional: directional_r,
                least_dist2: least_dist2_r,
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
    least_dist2: f32,
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

pub(crate) fn build(
    lights: &LightSet,
    builder: TreeBuilder,
    apart: Apart,
    directions: Directions,
) -> Option<LightTree> {
    let n = lights.len();
    assert!(
        n <= MAX_LIGHTS,
        "{n} lights; a light tree holds at most {MAX_LIGHTS}"
    );
    if n == 0 {
        return None;
    }
    let item = |id| Item {
        position: lights.position(LightId(id)),
        intensity: luminance(lights.intensity(LightId(id))),
        axis: lights.axis(LightId(id)),
        id,
    };
    let mut items: Vec<Item> = (0..n as u32).into_par_iter().map(item).collect();
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
    // Weights of lights without falloff look at where they travel.
    let keeps_directions = oriented && (directions == Directions::Kept || distant > 0);
    let has_profiles = lights.count(LightKind::Spot) + lights.count(LightKind::Triangle) > 0;
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
        keeps_directions,
        diagonal2,
        c2: match (oriented, diagonal2 > 0.0) {
            (true, true) => diagonal2 * binned::DIRECTION,
            // All in one place, or in none: only directions tell them apart, whatever their weight.
            (true, false) => 1.0,
            (false, _) => 0.0,
        },
        balance_below: 2 * usize::BITS.saturating_sub(n.leading_zeros()),
    };
    context.arrange(&mut items, &groups);

    let if_any = |is_any| if is_any { n } else { 0 };
    let mut pairs = filled(Pair([Node::UNUSED; 2]), n);
    let mut cones = filled([Cone::SPHERE; 2], if_any(keeps_directions));
    let mut profiles = filled(
        [Profile::default(); 2],
        if_any(keeps_directions && has_profiles),
    );
    let mut directional = filled([0.0; 2], if_any(distant > 0));
    let mut least_dist2 = filled(Floor::ZERO, if_any(differ_in_radius(lights)));
    let out = Out {
        pairs: &mut pairs[1..],
        cones: below(&mut cones),
        profiles: below(&mut profiles),
        directional: below(&mut directional),
        least_dist2: below(&mut least_dist2),
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
    if let Some(d) = least_dist2.first_mut() {
        *d = Floor::of(root.least_dist2);
    }
    Some(LightTree {
        pairs,
        cones: cones.into_flattened(),
        profiles: profiles.into_flattened(),
        directional: directional.into_flattened(),
        lights: n,
        depth: root.depth,
        diagonal2: if positional > 0 {
            (root.node.hi - root.node.lo).length_squared()
        } else {
            0.0
        },
        least_dist2: root.least_dist2,
        least_dist2_below: least_dist2
            .par_chunks(Floor::PAIRS)
            .map(|pairs| pairs.iter().copied().min().unwrap_or(Floor::ZERO))
            .collect(),
        greatest_dist2: 1.5 * lights.greatest_radius() * lights.greatest_radius(),
    })
}

/// Whether there are lights with a least distance and lights with another one.
fn differ_in_radius(lights: &LightSet) -> bool {
    let only_virtual = lights.virtual_count() == lights.len();
    lights.has_radii() || (!only_virtual && lights.greatest_radius() > 0.0)
}

/// As `vec!`, with its pages first touched by all threads.
pub(crate) fn filled<T: Copy + Send + Sync>(value: T, n: usize) -> Vec<T> {
    rayon::iter::repeat_n(value, n).collect()
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
    if let [item] = items {
        return leaf(lights, item);
    }
    let is_mixed = groups.len() > 1;
    if !is_mixed && context.is_joined(n, depth) {
        for item in &*items {
            lights.prefetch(LightId(item.id));
        }
        let joined = few::join(items, context.c2);
        return joined_subtree(context, lights, items, out, &joined, 2 * n - 2);
    }
    let (left, groups) = match groups {
        [others @ .., last] if is_mixed => (n - last, others),
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
    parent(context, own, l, r)
}

/// Lays out cluster `number` of those that `items` were joined to.
fn joined_subtree(
    context: &Context,
    lights: &LightSet,
    items: &[Item],
    out: Out<'_>,
    joined: &Joined,
    number: usize,
) -> Top {
    let Some(made) = number.checked_sub(items.len()) else {
        return leaf(lights, &items[number]);
    };
    let [l, r] = joined.children[made].map(usize::from);
    let (own, out_l, out_r) = out.split(joined.sizes[l].into());
    let l = joined_subtree(context, lights, items, out_l, joined, l);
    let r = joined_subtree(context, lights, items, out_r, joined, r);
    parent(context, own, l, r)
}

/// The node above the finished subtrees `l` and `r`.
fn parent(context: &Context, own: Out<'_>, l: Top, r: Top) -> Top {
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
    let least_dist2 = l.least_dist2.min(r.least_dist2);
    if let Some(d) = own.least_dist2.first_mut() {
        *d = Floor::of(least_dist2);
    }
    Top {
        node: Node::inner(
            l.node.lo.min(r.node.lo),
            l.node.hi.max(r.node.hi),
            l.node.intensity + r.node.intensity,
            2 * own.first,
        ),
        emission: if context.keeps_directions {
            l.emission.union(r.emission)
        } else {
            Emission::ANY
        },
        directional: l.directional + r.directional,
        least_dist2,
        depth: 1 + l.depth.max(r.depth),
    }
}

fn leaf(lights: &LightSet, item: &Item) -> Top {
    let id = LightId(item.id);
    if lights.is_source(id) {
        let is_distant = lights.kind(id).is_distant();
        return Top {
            node: lights.leaf(id),
            emission: lights.emission(id),
            directional: if is_distant { item.intensity } else { 0.0 },
            least_dist2: 0.0,
            depth: 0,
        };
    }
    // Of a virtual light the item says all but the radius, and nothing else need be fetched from memory.
    let radius = lights.radius(id);
    Top {
        node: Node::leaf(item.position, item.position, item.intensity, id),
        emission: Emission {
            cone: Cone::of(item.axis),
            profile: Profile::Cosine,
        },
        directional: 0.0,
        least_dist2: 1.5 * radius * radius,
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
        // No branch: it would be foreseen half of the time.
        let is_left = left(&items[i]);
        items.swap(front, i);
        front += usize::from(is_left);
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
