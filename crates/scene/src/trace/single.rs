//! One ray at a time.

use super::bvh8::{self, OrderedRay};
use super::triangle::{TriangleBlock, TriangleHit, WatertightRay};
use super::width::{Four, Width};
use super::{Hit, Ray, Tracer};

impl Tracer {
    /// Nearest hit, or `None`.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        if self.bvh.nodes.is_empty() {
            return None;
        }
        #[cfg(target_arch = "x86_64")]
        if let Some(eight) = super::width::Eight::detect() {
            #[allow(
                unsafe_code,
                reason = "the only way to call code for a processor found at run time"
            )]
            // SAFETY: the processor has what the function is compiled for, as was just asked.
            return unsafe { self.closest_eight(eight, ray) };
        }
        self.closest_with(Four, ray)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,bmi1,popcnt")]
    fn closest_eight(&self, eight: super::width::Eight, ray: &Ray) -> Option<Hit> {
        self.closest_with(eight, ray)
    }

    #[inline(always)]
    pub(super) fn closest_with<W: Width>(&self, width: W, ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let mut t_max = ray.t_max.min(f32::MAX);
        let query = OrderedRay::of(ray.origin, ray.direction);
        let watertight = WatertightRay::of(ray);
        // Links that were left aside, and the distances at which they are entered; the nearest is on top.
        let mut stack = [0u32; bvh8::STACK];
        let mut entries = [0.0f32; bvh8::STACK];
        let (mut top, mut link) = (0, 0);
        loop {
            if bvh8::is_inner(link) {
                let node = &self.bvh.nodes[link as usize];
                let mut near = [0.0; bvh8::WIDTH];
                let mask = width.meet_ordered(node, &query, t_max, &mut near);
                let mut children = bits(mask);
                if let Some(first) = children.next() {
                    link = node.links[first];
                    let Some(second) = children.next() else {
                        continue;
                    };
                    if children.next().is_none() {
                        let (mut aside, mut entry) = (node.links[second], near[second]);
                        if near[second] < near[first] {
                            (link, aside) = (aside, link);
                            entry = near[first];
                        }
                        (stack[top], entries[top]) = (aside, entry);
                        top += 1;
                        continue;
                    }
                    let bottom = top;
                    for k in bits(mask) {
                        let mut at = top;
                        while at > bottom && entries[at - 1] < near[k] {
                            (stack[at], entries[at]) = (stack[at - 1], entries[at - 1]);
                            at -= 1;
                        }
                        (stack[at], entries[at]) = (node.links[k], near[k]);
                        top += 1;
                    }
                    top -= 1;
                    link = stack[top];
                    continue;
                }
            } else {
                let block = &self.bvh.blocks[bvh8::index_of(link)];
                let hits = block.intersect(&watertight, t_max);
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
                if entries[top] <= t_max {
                    break;
                }
            }
            link = stack[top];
        }
    }

    /// Whether anything lies on the ray. [`occluded`](Self::occluded) answers many rays sooner.
    pub fn is_occluded(&self, ray: &Ray) -> bool {
        if self.bvh.nodes.is_empty() {
            return false;
        }
        #[cfg(target_arch = "x86_64")]
        if let Some(eight) = super::width::Eight::detect() {
            #[allow(
                unsafe_code,
                reason = "the only way to call code for a processor found at run time"
            )]
            // SAFETY: the processor has what the function is compiled for, as was just asked.
            return unsafe { self.is_occluded_eight(eight, ray) };
        }
        self.is_occluded_with(Four, ray)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,bmi1,popcnt")]
    fn is_occluded_eight(&self, eight: super::width::Eight, ray: &Ray) -> bool {
        self.is_occluded_with(eight, ray)
    }

    #[inline(always)]
    pub(super) fn is_occluded_with<W: Width>(&self, width: W, ray: &Ray) -> bool {
        let query = OrderedRay::of(ray.origin, ray.direction);
        let watertight = WatertightRay::of(ray);
        let t_max = ray.t_max.min(f32::MAX);
        let mut stack = [0u32; bvh8::STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let link = stack[top];
            if !bvh8::is_inner(link) {
                if self.block_stops(bvh8::index_of(link), &watertight, t_max) {
                    return true;
                }
                continue;
            }
            let node = &self.bvh.nodes[link as usize];
            let mask = width.meet_ordered(node, &query, t_max, &mut [0.0; bvh8::WIDTH]);
            top = width.push(node, mask, &mut stack, top);
        }
        false
    }

    /// Whether any triangle of a block stops the ray.
    #[inline(always)]
    pub(super) fn block_stops(&self, block: usize, ray: &WatertightRay, t_max: f32) -> bool {
        let block = &self.bvh.blocks[block];
        let hits = block.intersect(ray, t_max);
        if self.cutouts.any() {
            bits(hits.mask).any(|k| self.is_solid(block, k, || hits.hit(k)))
        } else {
            hits.mask != 0
        }
    }

    /// Whether a hit on triangle `k` of `block` is on a part of it that is there; `hit` is asked for where that depends on it.
    #[inline(always)]
    fn is_solid(&self, block: &TriangleBlock, k: usize, hit: impl Fn() -> TriangleHit) -> bool {
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
