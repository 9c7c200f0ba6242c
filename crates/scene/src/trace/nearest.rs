//! Nearest hits, many rays in flight.
//!
//! Thirty-two rays take turns, as shadow rays do (`occlusion.rs`). The children that a ray meets are sorted by distance without
//! a branch, since their number and order are not to be foretold.

use super::bvh8::{self, Lanes, NOWHERE, Node8, NodeRay, Stack, WIDTH};
use super::occlusion::{LANES, LaneSet, Turns};
use super::single::bits;
use super::triangle::WatertightRay;
use super::width::{Four, Width};
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

/// What children are sorted by: those that are met first, the farthest before the nearest. The distance, rounded down, is
/// turned over, and its lowest bits are the child's number.
type Key = i32;

const CHILD: Key = WIDTH as Key - 1;
const NOT_MET: Key = Key::MAX;

/// [`Width`] for rays whose nearest hit is wanted.
pub(super) trait Sort: Width {
    /// Writes links and distances of the children in `mask`, which are `near`, the farthest first. What is written behind
    /// them means nothing.
    fn sort(
        self,
        node: Node8<'_>,
        mask: u32,
        near: &Lanes,
        links: &mut [u32; WIDTH],
        entries: &mut Lanes,
    );
}

impl Sort for Four {
    #[inline(always)]
    fn sort(
        self,
        node: Node8<'_>,
        mask: u32,
        near: &Lanes,
        links: &mut [u32; WIDTH],
        entries: &mut Lanes,
    ) {
        let mut keys: [Key; WIDTH] = std::array::from_fn(|k| match mask >> k & 1 {
            0 => NOT_MET,
            _ => NOT_MET ^ (near[k].to_bits() as Key & !CHILD | k as Key),
        });
        keys.sort_unstable();
        for (i, key) in keys.into_iter().enumerate() {
            let key = NOT_MET ^ key;
            links[i] = node.link((key & CHILD) as usize);
            entries[i] = f32::from_bits((key & !CHILD) as u32);
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod eight {
    #![allow(
        unsafe_code,
        reason = "the only way to use instructions of a processor found at run time"
    )]

    use std::arch::x86_64::*;

    use super::super::width::Eight;
    use super::{CHILD, Lanes, NOT_MET, Node8, Sort, WIDTH};

    impl Sort for Eight {
        #[inline(always)]
        fn sort(
            self,
            node: Node8<'_>,
            mask: u32,
            near: &Lanes,
            links: &mut [u32; WIDTH],
            entries: &mut Lanes,
        ) {
            // SAFETY: `self` proves AVX2, and all arrays have eight numbers.
            unsafe {
                let (child, not_met) = (_mm256_set1_epi32(CHILD), _mm256_set1_epi32(NOT_MET));
                let near = _mm256_loadu_si256(near.as_ptr().cast());
                let numbers = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
                let key = _mm256_or_si256(_mm256_andnot_si256(child, near), numbers);
                let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let is_met = _mm256_and_si256(_mm256_set1_epi32(mask as i32), bits);
                let is_met = _mm256_cmpeq_epi32(is_met, bits);
                let mut keys = _mm256_xor_si256(not_met, _mm256_and_si256(is_met, key));
                // A bitonic network: each step compares with the places that a permutation names, and those that the mask
                // names keep the greater.
                macro_rules! step {
                    ($others:expr, $greater:literal) => {
                        let others = $others;
                        let (lesser, greater) = (
                            _mm256_min_epi32(keys, others),
                            _mm256_max_epi32(keys, others),
                        );
                        keys = _mm256_blend_epi32::<$greater>(lesser, greater);
                    };
                }
                let reversed = _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0);
                step!(_mm256_shuffle_epi32::<0b10_11_00_01>(keys), 0b1010_1010);
                step!(_mm256_shuffle_epi32::<0b00_01_10_11>(keys), 0b1100_1100);
                step!(_mm256_shuffle_epi32::<0b10_11_00_01>(keys), 0b1010_1010);
                step!(_mm256_permutevar8x32_epi32(keys, reversed), 0b1111_0000);
                step!(_mm256_shuffle_epi32::<0b01_00_11_10>(keys), 0b1100_1100);
                step!(_mm256_shuffle_epi32::<0b10_11_00_01>(keys), 0b1010_1010);
                let keys = _mm256_xor_si256(not_met, keys);
                let all = _mm256_loadu_si256(node.links().as_ptr().cast());
                let sorted = _mm256_permutevar8x32_epi32(all, _mm256_and_si256(keys, child));
                _mm256_storeu_si256(links.as_mut_ptr().cast(), sorted);
                let entry = _mm256_andnot_si256(child, keys);
                _mm256_storeu_si256(entries.as_mut_ptr().cast(), entry);
            }
        }
    }
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
        #[cfg(target_arch = "x86_64")]
        if let Some(eight) = super::width::Eight::detect() {
            #[allow(
                unsafe_code,
                reason = "the only way to call code for a processor found at run time"
            )]
            // SAFETY: the processor has what the function is compiled for, as was just asked.
            unsafe {
                self.nearest_eight(eight, rays, hits, scratch);
            }
            return;
        }
        self.nearest_with(Four, rays, hits, scratch);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    fn nearest_eight(
        &self,
        eight: super::width::Eight,
        rays: &[Ray],
        hits: &mut [Option<Hit>],
        scratch: &mut NearestScratch,
    ) {
        self.nearest_with(eight, rays, hits, scratch);
    }

    #[inline(always)]
    pub(super) fn nearest_with<W: Sort>(
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
            for (l, (index, ray)) in bits(std::mem::take(&mut turns.idle)).zip(&mut waiting) {
                if started >> l & 1 == 1 {
                    hits[lanes[l].index] = lanes[l].hit;
                }
                started |= 1 << l;
                lanes[l].start(ray, index);
                turns.inner |= 1 << l;
            }
            if turns.inner | turns.blocks == 0 {
                break;
            }
            for l in bits(std::mem::take(&mut turns.inner)) {
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
                let found = block.intersect(&lane.watertight, lane.t_max);
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
