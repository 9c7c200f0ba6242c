//! Shadow rays, many in flight.
//!
//! A shadow ray visits about a dozen nodes and waits for memory at most of them. Sixteen rays take turns,
//! one node each, and each asks for its next node before it yields: by the time its turn comes the
//! node has arrived. Answers do not depend on the order, so neither do bits.

use super::bvh8::{self, Bvh8, NodeRay, Stack};
use super::triangle::WatertightRay;
use super::width::{Four, Width};
use super::{Ray, Tracer};

/// Rays that take turns.
const LANES: usize = 16;

/// A ray under way.
#[derive(Debug, Clone)]
struct Lane {
    query: NodeRay,
    watertight: WatertightRay,
    t_max: f32,
    /// Position in the batch.
    index: usize,
    stack: Stack,
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
        #[cfg(target_arch = "x86_64")]
        if let Some(eight) = super::width::Eight::detect() {
            #[allow(
                unsafe_code,
                reason = "the only way to call code for a processor found at run time"
            )]
            // SAFETY: the processor has what the function is compiled for, as was just asked.
            unsafe {
                self.occluded_eight(eight, rays, answers, scratch);
            }
            return;
        }
        self.occluded_with(Four, rays, answers, scratch);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,bmi1,popcnt")]
    fn occluded_eight(
        &self,
        eight: super::width::Eight,
        rays: &[Ray],
        answers: &mut [bool],
        scratch: &mut OcclusionScratch,
    ) {
        self.occluded_with(eight, rays, answers, scratch);
    }

    #[inline(always)]
    pub(super) fn occluded_with<W: Width>(
        &self,
        width: W,
        rays: &[Ray],
        answers: &mut [bool],
        scratch: &mut OcclusionScratch,
    ) {
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
                let hit = self.step(width, lane);
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
    fn step<W: Width>(&self, width: W, lane: &mut Lane) -> bool {
        lane.top -= 1;
        let link = lane.stack[lane.top];
        if let Some(block) = bvh8::block_of(link) {
            return self.block_stops(block, &lane.watertight, lane.t_max);
        }
        let node = &self.bvh.nodes[link as usize];
        let mask = width.meet(node, &lane.query, lane.t_max, &mut [0.0; bvh8::WIDTH]);
        lane.top = width.push(node, mask, &mut lane.stack, lane.top);
        if lane.top > 0 {
            prefetch(&self.bvh, lane.stack[lane.top - 1]);
        }
        false
    }
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
            index: 0,
            stack: [0; bvh8::STACK],
            top: 0,
        }
    }

    #[inline(always)]
    fn start(&mut self, ray: &Ray, index: usize) {
        self.query = NodeRay::of(ray.origin, ray.direction);
        self.watertight = WatertightRay::of(ray);
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
        let (address, lines) = match bvh8::block_of(link) {
            Some(block) => (bvh.blocks.as_ptr().wrapping_add(block).cast::<i8>(), 3),
            None => (
                bvh.nodes.as_ptr().wrapping_add(link as usize).cast::<i8>(),
                4,
            ),
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
