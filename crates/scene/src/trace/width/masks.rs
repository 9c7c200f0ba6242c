//! AVX-512 on vectors of eight: masks pack links in one step, and there are twice as many registers.
//!
//! Vectors of sixteen slow the clock, and close one of the ports that vectors of eight use. With blocks tested three edges at a
//! time, single rays lost a tenth and rays in a queue gained no more than they do so.

#![allow(
    unsafe_code,
    reason = "the only way to use instructions of a processor found at run time"
)]

use std::arch::x86_64::*;

use super::{
    BlockHits, Eight, Lanes, Node8, NodeRay, OrderedRay, Stack, TriangleBlock, WIDTH,
    WatertightRay, Width,
};

/// A value of it is the proof that the processor has what [`by_width`](super::by_width) compiles for it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Masks {
    eight: Eight,
}

impl Masks {
    /// `None` where the processor lacks anything.
    pub(crate) fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vl"))
            .then(Eight::detect)?
            .map(|eight| Self { eight })
    }
}

impl Width for Masks {
    #[inline(always)]
    fn meet(self, node: Node8<'_>, ray: &NodeRay, t_max: f32, near: &mut Lanes) -> u32 {
        self.eight.meet(node, ray, t_max, near)
    }

    #[inline(always)]
    fn meet_ordered(self, node: Node8<'_>, ray: &OrderedRay, t_max: f32, near: &mut Lanes) -> u32 {
        self.eight.meet_ordered(node, ray, t_max, near)
    }

    #[inline(always)]
    fn push(self, node: Node8<'_>, mask: u32, stack: &mut Stack, top: usize) -> usize {
        let to = &mut stack[top..top + WIDTH];
        // SAFETY: `self` proves AVX-512; links are 32 bytes, and `to` has room for eight numbers.
        unsafe {
            let links = _mm256_loadu_si256(node.links().as_ptr().cast());
            let packed = _mm256_maskz_compress_epi32(mask as __mmask8, links);
            _mm256_storeu_si256(to.as_mut_ptr().cast(), packed);
        }
        top + mask.count_ones() as usize
    }

    #[inline(always)]
    fn sort(
        self,
        node: Node8<'_>,
        mask: u32,
        near: &Lanes,
        links: &mut [u32; WIDTH],
        entries: &mut Lanes,
    ) {
        self.eight.sort(node, mask, near, links, entries);
    }

    #[inline(always)]
    fn intersect(self, block: TriangleBlock<'_>, ray: &WatertightRay, t_max: f32) -> BlockHits {
        self.eight.intersect(block, ray, t_max)
    }
}
