//! The two steps of a traversal that depend on what the processor can do.
//!
//! Both forms do the same arithmetic in the same order, without fused multiplication: answers are the same to the bit.

use glam::{Vec3, Vec4};

use super::bvh8::{FAR_SLACK, Lanes, Node8, NodeRay, OrderedRay, Stack, WIDTH};

/// How wide the processor's vectors are. A traversal is compiled once for each.
pub(crate) trait Width: Copy {
    /// The children that the ray meets before `t_max`, which is finite, bit by bit, and how far away; what `near` holds
    /// for others means nothing.
    fn meet(self, node: Node8<'_>, ray: &NodeRay, t_max: f32, near: &mut Lanes) -> u32;

    /// The same with fewer steps one after another, and some work once a ray: for a ray that waits for the answer.
    fn meet_ordered(self, node: Node8<'_>, ray: &OrderedRay, t_max: f32, near: &mut Lanes) -> u32;

    /// Puts the links of the children in `mask` on the stack, in their order, and returns its new height.
    fn push(self, node: Node8<'_>, mask: u32, stack: &mut Stack, top: usize) -> usize;
}

/// For each mask the numbers of its bits, the lowest first.
static BITS: [[u8; WIDTH]; 256] = {
    let mut bits = [[0; WIDTH]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut k, mut n) = (0, 0);
        while k < WIDTH {
            if mask >> k & 1 == 1 {
                bits[mask][n] = k as u8;
                n += 1;
            }
            k += 1;
        }
        mask += 1;
    }
    bits
};

/// Vectors of four: what every x86-64 and AArch64 processor has.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Four;

impl Width for Four {
    #[inline(always)]
    fn meet(self, node: Node8<'_>, ray: &NodeRay, t_max: f32, near: &mut Lanes) -> u32 {
        let mut mask = 0;
        for half in 0..2 {
            let row = |r: usize| Vec4::from_slice(&node.bounds(r)[4 * half..]);
            let (mut from, mut to) = (Vec4::ZERO, Vec4::INFINITY);
            for axis in 0..3 {
                let origin = Vec4::splat(ray.origin[axis]);
                let inverse = Vec4::splat(ray.inverse[axis]);
                let one = (row(axis) - origin) * inverse;
                let other = (row(axis + 3) - origin) * inverse;
                from = one.min(other).max(from);
                to = one.max(other).min(to);
            }
            let to = (to * FAR_SLACK).min(Vec4::splat(t_max));
            from.write_to_slice(&mut near[4 * half..]);
            mask |= from.cmple(to).bitmask() << (4 * half);
        }
        mask
    }

    #[inline(always)]
    fn meet_ordered(self, node: Node8<'_>, ray: &OrderedRay, t_max: f32, near: &mut Lanes) -> u32 {
        let mut mask = 0;
        for half in 0..2 {
            let plane = |axis: usize, side: usize, inverse: Vec3| {
                let row = node.bounds(ray.rows[axis][side] as usize);
                let row = Vec4::from_slice(&row[4 * half..]);
                (row - Vec4::splat(ray.ray.origin[axis])) * Vec4::splat(inverse[axis])
            };
            let near_plane = |axis| plane(axis, 0, ray.ray.inverse);
            let far_plane = |axis| plane(axis, 1, ray.inverse_far);
            let from = near_plane(0).max(near_plane(1));
            let from = from.max(near_plane(2).max(Vec4::ZERO));
            let to = far_plane(0).min(far_plane(1));
            let to = to.min(far_plane(2).min(Vec4::splat(t_max)));
            from.write_to_slice(&mut near[4 * half..]);
            mask |= from.cmple(to).bitmask() << (4 * half);
        }
        mask
    }

    #[inline(always)]
    fn push(self, node: Node8<'_>, mask: u32, stack: &mut Stack, top: usize) -> usize {
        let order = &BITS[mask as usize & 255];
        // All eight are written, whatever the mask: no branch to mispredict.
        for (to, &k) in stack[top..top + WIDTH].iter_mut().zip(order) {
            *to = node.link(k as usize & (WIDTH - 1));
        }
        top + mask.count_ones() as usize
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use eight::Eight;

#[cfg(target_arch = "x86_64")]
mod eight {
    #![allow(
        unsafe_code,
        reason = "the only way to use instructions of a processor found at run time"
    )]

    use std::arch::x86_64::*;

    use glam::Vec3;

    use super::{BITS, FAR_SLACK, Lanes, Node8, NodeRay, OrderedRay, Stack, WIDTH, Width};

    /// AVX2: vectors of eight. A value of it is the proof that the processor has it.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Eight(());

    impl Eight {
        /// `None` where the processor lacks any of `avx2`, `bmi1`, `bmi2` and `popcnt`.
        #[inline(always)]
        pub(crate) fn detect() -> Option<Self> {
            (is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("popcnt"))
            .then_some(Self(()))
        }
    }

    impl Width for Eight {
        #[inline(always)]
        fn meet(self, node: Node8<'_>, ray: &NodeRay, t_max: f32, near: &mut Lanes) -> u32 {
            // SAFETY: `self` proves AVX2; rows are 32 bytes at multiples of 32 in a node aligned to 64, and `near` holds
            // eight numbers.
            unsafe {
                let row = |r: usize| _mm256_load_ps(node.bounds(r).as_ptr());
                let (mut from, mut to) = (_mm256_setzero_ps(), _mm256_set1_ps(f32::INFINITY));
                for axis in 0..3 {
                    let origin = _mm256_set1_ps(ray.origin[axis]);
                    let inverse = _mm256_set1_ps(ray.inverse[axis]);
                    let one = _mm256_mul_ps(_mm256_sub_ps(row(axis), origin), inverse);
                    let other = _mm256_mul_ps(_mm256_sub_ps(row(axis + 3), origin), inverse);
                    from = _mm256_max_ps(_mm256_min_ps(one, other), from);
                    to = _mm256_min_ps(_mm256_max_ps(one, other), to);
                }
                let to = _mm256_mul_ps(to, _mm256_set1_ps(FAR_SLACK));
                let to = _mm256_min_ps(to, _mm256_set1_ps(t_max));
                _mm256_storeu_ps(near.as_mut_ptr(), from);
                _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(from, to)) as u32
            }
        }

        #[inline(always)]
        fn meet_ordered(
            self,
            node: Node8<'_>,
            ray: &OrderedRay,
            t_max: f32,
            near: &mut Lanes,
        ) -> u32 {
            // SAFETY: as in `meet`.
            unsafe {
                let plane = |axis: usize, side: usize, inverse: Vec3| {
                    let row = node.bounds(ray.rows[axis][side] as usize);
                    let origin = _mm256_set1_ps(ray.ray.origin[axis]);
                    let way = _mm256_sub_ps(_mm256_load_ps(row.as_ptr()), origin);
                    _mm256_mul_ps(way, _mm256_set1_ps(inverse[axis]))
                };
                let near_plane = |axis| plane(axis, 0, ray.ray.inverse);
                let far_plane = |axis| plane(axis, 1, ray.inverse_far);
                let from = _mm256_max_ps(near_plane(0), near_plane(1));
                let from = _mm256_max_ps(from, _mm256_max_ps(near_plane(2), _mm256_setzero_ps()));
                let to = _mm256_min_ps(far_plane(0), far_plane(1));
                let to = _mm256_min_ps(to, _mm256_min_ps(far_plane(2), _mm256_set1_ps(t_max)));
                _mm256_storeu_ps(near.as_mut_ptr(), from);
                _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(from, to)) as u32
            }
        }

        #[inline(always)]
        fn push(self, node: Node8<'_>, mask: u32, stack: &mut Stack, top: usize) -> usize {
            let order = &BITS[mask as usize & 255];
            let to = &mut stack[top..top + WIDTH];
            // SAFETY: `self` proves AVX2; `order` has eight bytes, `links` 32, and `to` room for eight numbers.
            unsafe {
                let order = _mm256_cvtepu8_epi32(_mm_loadl_epi64(order.as_ptr().cast()));
                let links = _mm256_loadu_si256(node.links().as_ptr().cast());
                let packed = _mm256_permutevar8x32_epi32(links, order);
                _mm256_storeu_si256(to.as_mut_ptr().cast(), packed);
            }
            top + mask.count_ones() as usize
        }
    }
}
