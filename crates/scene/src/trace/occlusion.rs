//! Shadow rays, many in flight.
//!
//! A shadow ray visits about a dozen nodes and waits for memory at most of them. Sixteen rays take turns,
//! one node each, and each asks for its next node before it yields: by the time its turn comes the
//! node has arrived. Answers do not depend on the order, so neither do bits.

use super::bvh8::{self, Bvh8, NodeBox};
use super::triangle::WatertightRay;
use super::{Ray, Tracer};

/// Rays that take turns.
const LANES: usize = 16;

/// A ray under way.
#[derive(Debug, Clone)]
struct Lane {
    query: NodeBox,
    watertight: WatertightRay,
    t_max: f32,
    /// Position in the batch.
    index: usize,
    stack: Box<[u32; bvh8::STACK]>,
    top: usize,
}

/// Memory for [`Tracer::occluded`], kept between calls.
#[derive(Debug, Clone, Default)]
pub struct OcclusionScratch {
    lanes: Vec<Lane>,
}

impl Tracer {
    /// For each ray whether anything lies on it.
    ///
    /// # Panics
    /// When `answers` is not as long as `rays`.
    pub fn occluded(&self, rays: &[Ray], answers: &mut [bool], scratch: &mut OcclusionScratch) {
        assert_eq!(rays.len(), answers.len(), "one answer a ray");
        answers.fill(false);
        if self.bvh.nodes.is_empty() {
            return;
        }
        while scratch.lanes.len() < LANES.min(rays.len()) {
            scratch.lanes.push(Lane::idle());
        }
        let mut next = 0;
        let mut live = 0;
        while live < LANES && next < rays.len() {
            scratch.lanes[live].start(&rays[next], next);
            live += 1;
            next += 1;
        }
        while live > 0 {
            let mut l = 0;
            while l < live {
                let lane = &mut scratch.lanes[l];
                let hit = self.step(lane);
                if hit || lane.top == 0 {
                    answers[lane.index] = hit;
                    if next < rays.len() {
                        lane.start(&rays[next], next);
                        next += 1;
                    } else {
                        live -= 1;
                        scratch.lanes.swap(l, live);
                        continue;
                    }
                }
                l += 1;
            }
        }
    }

    /// Visits one node or leaf; returns whether it stops the ray.
    #[inline(always)]
    fn step(&self, lane: &mut Lane) -> bool {
        lane.top -= 1;
        let link = lane.stack[lane.top];
        if let Some(range) = bvh8::leaf_range(link) {
            return self.leaf_stops(range, &lane.watertight, lane.t_max);
        }
        let node = &self.bvh.nodes[link as usize];
        let near = node.intersect(&lane.query, lane.t_max);
        for (link, near) in node.links.iter().zip(near) {
            // Written whether met or not: no branch to mispredict.
            lane.stack[lane.top] = *link;
            lane.top += usize::from(near != f32::INFINITY);
        }
        if lane.top > 0 {
            prefetch(&self.bvh, lane.stack[lane.top - 1]);
        }
        false
    }
}

impl Lane {
    fn idle() -> Self {
        let nowhere = glam::Vec3::ONE;
        Self {
            query: NodeBox::of(nowhere, nowhere),
            watertight: WatertightRay::new(nowhere, nowhere),
            t_max: 0.0,
            index: 0,
            stack: Box::new([0; bvh8::STACK]),
            top: 0,
        }
    }

    fn start(&mut self, ray: &Ray, index: usize) {
        self.query = NodeBox::of(ray.origin, ray.direction);
        self.watertight = WatertightRay::new(ray.origin, ray.direction);
        self.t_max = ray.t_max;
        self.index = index;
        self.stack[0] = 0;
        self.top = 1;
    }
}

/// Asks for the memory that `link` will read; nothing where the processor offers no way to.
#[inline(always)]
fn prefetch(bvh: &Bvh8, link: u32) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let (address, lines) = match bvh8::leaf_range(link) {
            Some(range) => (bvh.triangles[range.start..].as_ptr().cast::<i8>(), 2),
            None => (bvh.nodes[link as usize..].as_ptr().cast::<i8>(), 4),
        };
        for line in 0..lines {
            #[allow(unsafe_code, reason = "the only way to prefetch")]
            // SAFETY: a prefetch reads nothing the program can see and never faults, whatever the address.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(64 * line));
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (bvh, link);
}
