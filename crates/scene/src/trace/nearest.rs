//! Nearest hits, many rays in flight.
//!
//! Thirty-two rays take turns, as shadow rays do (`occlusion.rs`). The children that a ray meets are sorted by distance without
//! a branch, since their number and order are not to be foretold.

use super::bvh8::{self, NOWHERE, NodeRay, Stack, WIDTH};
use super::occlusion::{LANES, LaneSet, Turns};
use super::single::bits;
use super::triangle::WatertightRay;
use super::width::{Width, by_width};
use super::{Hit, Ray, Tracer};

/// A ray under way.
#[derive(Debug, Clone)]
struct Lane {
    query: NodeRay,
    watertight: WatertightRay,
    /// That of the nearest hit so far.
    t_max: f32,
    hit: Option<Hit>,
    /// Position in the batch.
    index: usize,
    /// Where it goes next.
    link: u32,
    /// What it has yet to follow then, above a link to nowhere at distance 0, and the distances at which it comes to those,
    /// rounded down.
    links: Stack,
    entries: [f32; bvh8::STACK],
    top: usize,
}

/// Memory for [`Tracer::nearest`], kept between calls.
#[derive(Debug, Clone, Default)]
pub struct NearestScratch {
    lanes: Vec<Lane>,
}

impl Tracer {
    /// The nearest hit of each ray: what [`closest`](Self::closest) finds one by one.
    ///
    /// # Panics
    /// When `hits` is not as long as `rays`.
    pub fn nearest(&self, rays: &[Ray], hits: &mut [Option<Hit>], scratch: &mut NearestScratch) {
        assert_eq!(rays.len(), hits.len(), "one hit a ray");
        if self.bvh.rows.is_empty() {
            hits.fill(None);
            return;
        }
        self.nearest_by_width(rays, hits, scratch);
    }

    by_width!(nearest_by_width = nearest_with(
        rays: &[Ray],
        hits: &mut [Option<Hit>],
        scratch: &mut NearestScratch
    ));

    #[inline(always)]
    fn nearest_with<W: Width>(
        &self,
        width: W,
        rays: &[Ray],
        hits: &mut [Option<Hit>],
        scratch: &mut NearestScratch,
    ) {
        scratch.lanes.resize(LANES, Lane::idle());
        let lanes = &mut scratch.lanes[..];
        let mut waiting = rays.iter().enumerate();
        let mut turns = Turns::all_idle();
        let mut started: LaneSet = 0;
        loop {
            for (l, (index, ray)) in bits(turns.idle).zip(&mut waiting) {
                if started >> l & 1 == 1 {
                    hits[lanes[l].index] = lanes[l].hit;
                }
                started |= 1 << l;
                lanes[l].start(ray, index);
                turns.start(l);
            }
            if turns.idle == LaneSet::MAX {
                break;
            }
            for l in bits(turns.inner()) {
                let lane = &mut lanes[l];
                let node = self.bvh.node(lane.link);
                let mut near = [0.0; WIDTH];
                let mask = width.meet(node, &lane.query, lane.t_max, &mut near);
                let links = room(&mut lane.links, lane.top);
                let entries = room(&mut lane.entries, lane.top);
                width.sort(node, mask, &near, links, entries);
                lane.top += mask.count_ones() as usize;
                lane.pop();
                self.bvh.prefetch(lane.link);
                turns.file(l, lane.link);
            }
            for l in bits(std::mem::take(&mut turns.blocks)) {
                let lane = &mut lanes[l];
                let block = self.bvh.block(lane.link);
                let found = width.intersect(block, &lane.watertight, lane.t_max);
                for k in bits(found.mask) {
                    let hit = found.hit(k);
                    if hit.t < lane.t_max && self.is_solid(block, k, || hit) {
                        lane.t_max = hit.t;
                        lane.hit = Some(Hit {
                            t: hit.t,
                            triangle: block.id(k),
                            u: hit.u,
                            v: hit.v,
                        });
                    }
                }
                lane.pop();
                self.bvh.prefetch(lane.link);
                turns.file(l, lane.link);
            }
        }
        for l in bits(started) {
            hits[lanes[l].index] = lanes[l].hit;
        }
    }
}

/// Where eight more go on a stack of height `top`.
#[inline(always)]
fn room<T>(stack: &mut [T], top: usize) -> &mut [T; WIDTH] {
    stack[top..].first_chunk_mut().expect("room for eight more")
}

impl Lane {
    fn idle() -> Self {
        let nothing = Ray {
            origin: glam::Vec3::ZERO,
            direction: glam::Vec3::ONE,
            t_max: 0.0,
        };
        Self {
            query: NodeRay::of(nothing.origin, nothing.direction),
            watertight: WatertightRay::of(&nothing),
            t_max: nothing.t_max,
            hit: None,
            index: 0,
            link: NOWHERE,
            links: [NOWHERE; bvh8::STACK],
            entries: [0.0; bvh8::STACK],
            top: 0,
        }
    }

    #[inline(always)]
    fn start(&mut self, ray: &Ray, index: usize) {
        self.query = NodeRay::of(ray.origin, ray.direction);
        self.watertight = WatertightRay::of(ray);
        self.t_max = ray.t_max.min(f32::MAX);
        self.hit = None;
        self.index = index;
        self.link = 0;
        self.links[0] = NOWHERE;
        self.entries[0] = 0.0;
        self.top = 1;
    }

    /// Goes on to the next link that is entered before the nearest hit.
    #[inline(always)]
    fn pop(&mut self) {
        loop {
            self.top -= 1;
            if self.entries[self.top] <= self.t_max {
                break;
            }
        }
        self.link = self.links[self.top];
    }
}
