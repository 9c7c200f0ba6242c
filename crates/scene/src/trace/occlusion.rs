//! Shadow rays, many in flight.
//!
//! A shadow ray visits about a dozen nodes and waits for memory at most of them. Thirty-two rays take turns,
//! one node each, and each asks for its next node before it yields: by the time its turn comes the
//! node has arrived. Answers do not depend on the order, so neither do bits.
//!
//! Rays at an inner node, rays at a block of triangles and rays that are done have turns of their own, so that no branch
//! depends on where a ray is. Whose turn it is stands in the bits of a register: read from memory it would wait for all that
//! the turns before have written, and the processor could not work on several rays at once.

use super::bvh8::{self, NOWHERE, NodeRay, Stack};
use super::single::bits;
use super::triangle::WatertightRay;
use super::width::{Width, by_width};
use super::{Ray, Tracer};

/// Rays that take turns, one for each bit of a [`LaneSet`].
pub(super) const LANES: usize = 32;

/// Lane l is in it when bit l is set.
pub(super) type LaneSet = u32;

/// A ray under way.
#[derive(Debug, Clone)]
struct Lane {
    query: NodeRay,
    watertight: WatertightRay,
    t_max: f32,
    /// Position in the batch.
    index: usize,
    /// Where it goes next.
    link: u32,
    /// What it has yet to follow then, above a link to nowhere.
    stack: Stack,
    top: usize,
}

/// The lanes by what they do next: those in neither set are at an inner node.
pub(super) struct Turns {
    pub(super) idle: LaneSet,
    pub(super) blocks: LaneSet,
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
        if self.bvh.rows.is_empty() {
            return;
        }
        self.occluded_by_width(rays, answers, scratch);
    }

    by_width!(occluded_by_width = occluded_with(
        rays: &[Ray],
        answers: &mut [bool],
        scratch: &mut OcclusionScratch
    ));

    #[inline(always)]
    fn occluded_with<W: Width>(
        &self,
        width: W,
        rays: &[Ray],
        answers: &mut [bool],
        scratch: &mut OcclusionScratch,
    ) {
        scratch.lanes.resize(LANES, Lane::idle());
        let lanes = &mut scratch.lanes[..];
        let mut waiting = rays.iter().enumerate();
        let mut turns = Turns::all_idle();
        loop {
            for (l, (index, ray)) in bits(turns.idle).zip(&mut waiting) {
                lanes[l].start(ray, index);
                turns.start(l);
            }
            if turns.idle == LaneSet::MAX {
                break;
            }
            for l in bits(turns.inner()) {
                let lane = &mut lanes[l];
                let node = self.bvh.node(lane.link);
                let mask = width.meet(node, &lane.query, lane.t_max, &mut [0.0; bvh8::WIDTH]);
                lane.top = width.push(node, mask, &mut lane.stack, lane.top);
                lane.pop();
                self.bvh.prefetch(lane.link);
                turns.file(l, lane.link);
            }
            for l in bits(std::mem::take(&mut turns.blocks)) {
                let lane = &mut lanes[l];
                let is_stopped = self.block_stops(width, lane.link, &lane.watertight, lane.t_max);
                answers[lane.index] = is_stopped;
                lane.pop();
                lane.link = if is_stopped { NOWHERE } else { lane.link };
                self.bvh.prefetch(lane.link);
                turns.file(l, lane.link);
            }
        }
    }
}

impl Turns {
    pub(super) fn all_idle() -> Self {
        Self {
            idle: LaneSet::MAX,
            blocks: 0,
        }
    }

    #[inline(always)]
    pub(super) fn inner(&self) -> LaneSet {
        !(self.idle | self.blocks)
    }

    /// Lane `l` begins at the root.
    #[inline(always)]
    pub(super) fn start(&mut self, l: usize) {
        self.idle &= !(1 << l);
    }

    /// Gives lane `l`, which is in no set, the turn that `link` asks for, without a branch.
    #[inline(always)]
    pub(super) fn file(&mut self, l: usize, link: u32) {
        self.idle |= bvh8::nowhere_bit(link) << l;
        self.blocks |= bvh8::block_bit(link) << l;
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
            link: NOWHERE,
            stack: [NOWHERE; bvh8::STACK],
            top: 0,
        }
    }

    #[inline(always)]
    fn start(&mut self, ray: &Ray, index: usize) {
        self.query = NodeRay::of(ray.origin, ray.direction);
        self.watertight = WatertightRay::of(ray);
        self.t_max = ray.t_max.min(f32::MAX);
        self.index = index;
        self.link = 0;
        self.stack[0] = NOWHERE;
        self.top = 1;
    }

    #[inline(always)]
    fn pop(&mut self) {
        self.top -= 1;
        self.link = self.stack[self.top];
    }
}
