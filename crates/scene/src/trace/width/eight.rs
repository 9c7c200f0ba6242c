//! AVX2: vectors of eight.

#![allow(
    unsafe_code,
    reason = "the only way to use instructions of a processor found at run time"
)]

use std::arch::x86_64::*;
use std::ops::{Add, Mul, Sub};

use glam::{Vec3, Vec4};

use super::super::triangle::{Numbers, Products, cross, dot, minus, plus};
use super::{
    AHEAD, BITS, BlockHits, CHILD, FAR_SLACK, Lanes, NOT_MET, Node8, NodeRay, OrderedRay, Stack,
    TriangleBlock, WIDTH, WatertightRay, Width,
};

/// A number for each child. A value of it is the proof that the processor has what [`by_width`](super::by_width) compiles
/// for it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Eight(());

impl Eight {
    /// `None` where the processor lacks anything.
    pub(crate) fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("popcnt"))
        .then_some(Self(()))
    }
}

/// Bit by bit where a positive distance is not greater than another one.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn in_order(from: __m256, to: __m256) -> u32 {
    // SAFETY: as the caller promises.
    unsafe {
        let is_beyond = _mm256_cmpgt_epi32(_mm256_castps_si256(from), _mm256_castps_si256(to));
        !_mm256_movemask_ps(_mm256_castsi256_ps(is_beyond)) as u32 & 0xff
    }
}

/// The greater of each two distances, and whichever is negative of two that are: an order of bits takes one step, that of
/// numbers four. Boxes behind the ray are not told apart.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn greater(a: __m256, b: __m256) -> __m256 {
    // SAFETY: as the caller promises.
    unsafe {
        let greater = _mm256_max_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b));
        _mm256_castsi256_ps(greater)
    }
}

/// The lesser of each two distances, in the same way.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn lesser(a: __m256, b: __m256) -> __m256 {
    // SAFETY: as the caller promises.
    unsafe {
        let lesser = _mm256_min_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b));
        _mm256_castsi256_ps(lesser)
    }
}

impl Width for Eight {
    #[inline(always)]
    fn meet(self, node: Node8<'_>, ray: &NodeRay, t_max: f32, near: &mut Lanes) -> u32 {
        // SAFETY: `self` proves AVX2; rows and `near` hold eight numbers.
        unsafe {
            let row = |r: usize| _mm256_loadu_ps(node.bounds(r).as_ptr());
            let (mut from, mut to) = (_mm256_set1_ps(AHEAD), _mm256_set1_ps(f32::INFINITY));
            for axis in 0..3 {
                let origin = _mm256_set1_ps(ray.origin[axis]);
                let inverse = _mm256_set1_ps(ray.inverse[axis]);
                let one = _mm256_mul_ps(_mm256_sub_ps(row(axis), origin), inverse);
                let other = _mm256_mul_ps(_mm256_sub_ps(row(axis + 3), origin), inverse);
                from = greater(lesser(one, other), from);
                to = lesser(greater(one, other), to);
            }
            let to = _mm256_mul_ps(to, _mm256_set1_ps(FAR_SLACK));
            let to = lesser(to, _mm256_set1_ps(t_max));
            _mm256_storeu_ps(near.as_mut_ptr(), from);
            in_order(from, to)
        }
    }

    #[inline(always)]
    fn meet_ordered(self, node: Node8<'_>, ray: &OrderedRay, t_max: f32, near: &mut Lanes) -> u32 {
        // SAFETY: as in `meet`.
        unsafe {
            let plane = |axis: usize, side: usize, inverse: Vec3| {
                let row = node.bounds(ray.rows[axis][side]);
                let origin = _mm256_set1_ps(ray.ray.origin[axis]);
                let way = _mm256_sub_ps(_mm256_loadu_ps(row.as_ptr()), origin);
                _mm256_mul_ps(way, _mm256_set1_ps(inverse[axis]))
            };
            let near_plane = |axis| plane(axis, 0, ray.ray.inverse);
            let far_plane = |axis| plane(axis, 1, ray.inverse_far);
            let from = greater(near_plane(0), near_plane(1));
            let from = greater(from, greater(near_plane(2), _mm256_set1_ps(AHEAD)));
            let to = lesser(far_plane(0), far_plane(1));
            let to = lesser(to, lesser(far_plane(2), _mm256_set1_ps(t_max)));
            _mm256_storeu_ps(near.as_mut_ptr(), from);
            in_order(from, to)
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

    /// Two edges at once, each in a half of the vectors, and the third beside the normal.
    #[inline(always)]
    fn intersect(self, block: TriangleBlock<'_>, ray: &WatertightRay, t_max: f32) -> BlockHits {
        // SAFETY: `self` proves AVX2.
        unsafe {
            let splat = |x: f32| Numbers8(_mm256_set1_ps(x));
            let (o, d) = (ray.origin, ray.direction);
            let origin = [splat(o.x), splat(o.y), splat(o.z)];
            let direction = [splat(d.x), splat(d.y), splat(d.z)];
            // Ways to two corners, the names of which stand side by side.
            let corners = |lower: usize, upper: usize| {
                let [x, y, z] = block.corner(lower);
                let [upper_x, upper_y, upper_z] = block.corner(upper);
                let joined = [
                    Numbers8::join(x, upper_x),
                    Numbers8::join(y, upper_y),
                    Numbers8::join(z, upper_z),
                ];
                minus(joined, origin)
            };
            let (a_b, b_c, c_a) = (corners(0, 1), corners(1, 2), corners(2, 0));
            // Edges opposite b and c, and their corners' sums.
            let ca_ab = minus(c_a, a_b);
            let v_w = dot(cross(ca_ab, plus(c_a, a_b)), direction);
            // The edge opposite a and its corners' sum, and beside them two edges, whose product is the normal.
            let bc_ca = minus(b_c, c_a);
            let sums = plus(b_c, c_a);
            let sum_ab = [
                sums[0].with_upper(ca_ab[0]),
                sums[1].with_upper(ca_ab[1]),
                sums[2].with_upper(ca_ab[2]),
            ];
            let along_normal = cross(bc_ca, sum_ab);
            let u_descent = dot(along_normal, direction);
            let normal = [
                along_normal[0].upper(),
                along_normal[1].upper(),
                along_normal[2].upper(),
            ];
            let a = [a_b[0].lower(), a_b[1].lower(), a_b[2].lower()];
            let products = Products {
                edges: [u_descent.lower(), v_w.lower(), v_w.upper()],
                height: dot(normal, a),
                descent: u_descent.upper(),
            };
            products.hits(t_max)
        }
    }
}

/// Two times four numbers. One of these is made only where the processor has AVX2.
#[derive(Debug, Clone, Copy)]
struct Numbers8(__m256);

impl Numbers8 {
    #[inline(always)]
    fn join(lower: Vec4, upper: Vec4) -> Self {
        // SAFETY: only `Eight` calls this.
        Self(unsafe { _mm256_set_m128(upper.into(), lower.into()) })
    }

    /// The lower half of these beside the upper one of `other`.
    #[inline(always)]
    fn with_upper(self, other: Self) -> Self {
        // SAFETY: as for all of `Numbers8`.
        Self(unsafe { _mm256_blend_ps::<0b1111_0000>(self.0, other.0) })
    }

    #[inline(always)]
    fn lower(self) -> Vec4 {
        // SAFETY: as for all of `Numbers8`.
        unsafe { _mm256_castps256_ps128(self.0) }.into()
    }

    #[inline(always)]
    fn upper(self) -> Vec4 {
        // SAFETY: as for all of `Numbers8`.
        unsafe { _mm256_extractf128_ps::<1>(self.0) }.into()
    }
}

impl Numbers for Numbers8 {}

impl Add for Numbers8 {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: as for all of `Numbers8`.
        Self(unsafe { _mm256_add_ps(self.0, other.0) })
    }
}

impl Sub for Numbers8 {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: as for all of `Numbers8`.
        Self(unsafe { _mm256_sub_ps(self.0, other.0) })
    }
}

impl Mul for Numbers8 {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        // SAFETY: as for all of `Numbers8`.
        Self(unsafe { _mm256_mul_ps(self.0, other.0) })
    }
}
