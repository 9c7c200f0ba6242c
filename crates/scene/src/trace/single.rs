//! One ray at a time.

use std::cell::RefCell;

use super::bvh8::{self, OrderedRay};
use super::triangle::{TriangleBlock, TriangleHit, WatertightRay};
use super::width::{Width, by_width};
use super::{Hit, Ray, Tracer};

/// A child that a ray has yet to visit.
///
/// Above its link stands the distance at which the ray enters it: that is not negative, so the order of the bits is that of
/// distances.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Entry(u64);

impl Entry {
    #[inline(always)]
    fn new(near: f32, link: u32) -> Self {
        Self(u64::from(near.to_bits()) << 32 | u64::from(link))
    }

    #[inline(always)]
    fn near(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    #[inline(always)]
    fn link(self) -> u32 {
        self.0 as u32
    }
}

/// The nearer and the farther of two.
#[inline(always)]
fn sorted(a: Entry, b: Entry) -> (Entry, Entry) {
    (a.min(b), a.max(b))
}

/// Children that were left aside; the nearest of each node is on top.
pub(super) type Aside = [Entry; bvh8::STACK];

/// None yet.
const NONE_ASIDE: Aside = [Entry(0); bvh8::STACK];

thread_local! {
    /// Kept, since clearing it for each ray takes as long as three nodes.
    static ASIDE: RefCell<Aside> = const { RefCell::new(NONE_ASIDE) };
}

impl Tracer {
    /// Nearest hit, or `None`.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        if self.bvh.rows.is_empty() {
            return None;
        }
        ASIDE.with_borrow_mut(|aside| self.closest_by_width(ray, aside))
    }

    by_width!(closest_by_width = closest_with(ray: &Ray, aside: &mut Aside) -> Option<Hit>);

    #[inline(always)]
    fn closest_with<W: Width>(&self, width: W, ray: &Ray, aside: &mut Aside) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let mut t_max = ray.t_max.min(f32::MAX);
        let query = OrderedRay::of(ray.origin, ray.direction);
        let watertight = WatertightRay::of(ray);
        let (mut top, mut link) = (0, 0);
        loop {
            while bvh8::is_inner(link) {
                let node = self.bvh.node(link);
                let mut near = [0.0; bvh8::WIDTH];
                let mask = width.meet_ordered(node, &query, t_max, &mut near);
                let mut children = bits(mask).map(|k| {
                    let link = node.link(k);
                    self.bvh.prefetch(link);
                    (k, link)
                });
                // Most nodes have but few children in the way: they are sorted without memory and without branches.
                let Some(first) = children.next() else {
                    break;
                };
                link = first.1;
                let Some(second) = children.next() else {
                    continue;
                };
                let entry = |(k, link): (usize, u32)| Entry::new(near[k], link);
                let (first, second) = sorted(entry(first), entry(second));
                let Some(third) = children.next() else {
                    aside[top] = second;
                    top += 1;
                    link = first.link();
                    continue;
                };
                let (first, third) = sorted(first, entry(third));
                let (second, third) = sorted(second, third);
                let bottom = top;
                aside[top] = third;
                aside[top + 1] = second;
                aside[top + 2] = first;
                top += 3;
                for child in children {
                    let child = entry(child);
                    let mut at = top;
                    while at > bottom && aside[at - 1] < child {
                        aside[at] = aside[at - 1];
                        at -= 1;
                    }
                    aside[at] = child;
                    top += 1;
                }
                top -= 1;
                link = aside[top].link();
            }
            if !bvh8::is_inner(link) {
                let block = self.bvh.block(link);
                let hits = width.intersect(block, &watertight, t_max);
                for k in bits(hits.mask) {
                    let hit = hits.hit(k);
                    if hit.t < t_max && self.is_solid(block, k, || hit) {
                        t_max = hit.t;
                        best = Some(Hit {
                            t: hit.t,
                            triangle: block.id(k),
                            u: hit.u,
                            v: hit.v,
                        });
                    }
                }
            }
            loop {
                if top == 0 {
                    return best;
                }
                top -= 1;
                if aside[top].near() <= t_max {
                    break;
                }
            }
            link = aside[top].link();
        }
    }

    /// Whether anything lies on the ray. [`occluded`](Self::occluded) answers many rays sooner.
    pub fn is_occluded(&self, ray: &Ray) -> bool {
        if self.bvh.rows.is_empty() {
            return false;
        }
        ASIDE.with_borrow_mut(|aside| self.is_occluded_by_width(ray, aside))
    }

    by_width!(is_occluded_by_width = is_occluded_with(ray: &Ray, aside: &mut Aside) -> bool);

    #[inline(always)]
    fn is_occluded_with<W: Width>(&self, width: W, ray: &Ray, aside: &mut Aside) -> bool {
        let query = OrderedRay::of(ray.origin, ray.direction);
        let watertight = WatertightRay::of(ray);
        let t_max = ray.t_max.min(f32::MAX);
        let (mut top, mut link) = (0, 0);
        loop {
            while bvh8::is_inner(link) {
                let node = self.bvh.node(link);
                let mask = width.meet_ordered(node, &query, t_max, &mut [0.0; bvh8::WIDTH]);
                let mut children = bits(mask).map(|k| {
                    let link = node.link(k);
                    self.bvh.prefetch(link);
                    link
                });
                let Some(first) = children.next() else {
                    break;
                };
                link = first;
                for other in children {
                    aside[top] = Entry::new(0.0, link);
                    top += 1;
                    link = other;
                }
            }
            if !bvh8::is_inner(link) && self.block_stops(width, link, &watertight, t_max) {
                return true;
            }
            if top == 0 {
                return false;
            }
            top -= 1;
            link = aside[top].link();
        }
    }

    /// Whether any triangle of a block stops the ray.
    #[inline(always)]
    pub(super) fn block_stops<W: Width>(
        &self,
        width: W,
        link: u32,
        ray: &WatertightRay,
        t_max: f32,
    ) -> bool {
        let block = self.bvh.block(link);
        let hits = width.intersect(block, ray, t_max);
        if self.cutouts.any() {
            bits(hits.mask).any(|k| self.is_solid(block, k, || hits.hit(k)))
        } else {
            hits.mask != 0
        }
    }

    /// Whether a hit on triangle `k` of `block` is on a part of it that is there; `hit` is asked for where that depends on it.
    #[inline(always)]
    pub(super) fn is_solid(
        &self,
        block: TriangleBlock<'_>,
        k: usize,
        hit: impl Fn() -> TriangleHit,
    ) -> bool {
        !block.is_cutout(k) || {
            let TriangleHit { u, v, .. } = hit();
            self.cutouts.is_solid(block.id(k), u, v)
        }
    }
}

/// Numbers of the bits that are set, the lowest first.
#[inline(always)]
pub(super) fn bits(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let k = (mask != 0).then(|| mask.trailing_zeros() as usize)?;
        mask &= mask - 1;
        Some(k)
    })
}
