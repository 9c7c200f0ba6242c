//! Pairs of siblings, coordinate by coordinate.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;
#[cfg(target_arch = "x86_64")]
use std::mem::transmute;

use crate::bounds::BoxLanes;
#[cfg(target_arch = "x86_64")]
use crate::tree::Node;
use crate::tree::Pair;

/// `PAIRS` pairs of siblings: first the first of each, then the second of each, `NODES` in all.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct PairLanes<const PAIRS: usize, const NODES: usize> {
    pub(crate) boxes: BoxLanes<NODES>,
    pub(crate) intensity: [f32; NODES],
    /// [`Node::link`](crate::tree::Node::link).
    pub(crate) links: [u32; NODES],
}

impl<const PAIRS: usize, const NODES: usize> PairLanes<PAIRS, NODES> {
    /// The pairs, one number after the other.
    #[inline(always)]
    pub(crate) fn of(pairs: [&Pair; PAIRS]) -> Self {
        const { assert!(NODES == 2 * PAIRS, "two nodes a pair") };
        let mut lanes = Self {
            boxes: BoxLanes {
                lo: [[0.0; NODES]; 3],
                hi: [[0.0; NODES]; 3],
            },
            intensity: [0.0; NODES],
            links: [0; NODES],
        };
        for (k, pair) in pairs.iter().enumerate() {
            for (c, node) in pair.0.iter().enumerate() {
                let lane = c * PAIRS + k;
                for axis in 0..3 {
                    lanes.boxes.lo[axis][lane] = node.lo[axis];
                    lanes.boxes.hi[axis][lane] = node.hi[axis];
                }
                lanes.intensity[lane] = node.intensity;
                lanes.links[lane] = node.link();
            }
        }
        lanes
    }

    /// From what lies first to last in nodes: `lo` and the intensity, `hi` and the link.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn of_numbers(lo: [[f32; NODES]; 4], hi: [[f32; NODES]; 4]) -> Self {
        let mut links = [0; NODES];
        // No `map`: it would not be compiled for the wider instructions.
        for k in 0..NODES {
            links[k] = hi[3][k].to_bits();
        }
        Self {
            boxes: BoxLanes {
                lo: [lo[0], lo[1], lo[2]],
                hi: [hi[0], hi[1], hi[2]],
            },
            intensity: lo[3],
            links,
        }
    }
}

#[cfg(target_arch = "x86_64")]
impl PairLanes<8, 16> {
    /// [`of`](Self::of) by two dozen shuffles.
    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    pub(crate) fn of_avx512(pairs: [&Pair; 8]) -> Self {
        // A node's corners lie in 128 bits each, and its sibling's behind them.
        let lo = _mm512_set_epi64(13, 12, 5, 4, 9, 8, 1, 0);
        let hi = _mm512_set_epi64(15, 14, 7, 6, 11, 10, 3, 2);
        let [a, b, c, d, e, f, g, h] = pairs;
        let (front, back) = (columns_avx512([a, b, c, d]), columns_avx512([e, f, g, h]));
        let join = |at: usize, halves| numbers(_mm512_permutex2var_pd(front[at], halves, back[at]));
        Self::of_numbers(
            [join(0, lo), join(1, lo), join(2, lo), join(3, lo)],
            [join(0, hi), join(1, hi), join(2, hi), join(3, hi)],
        )
    }
}

#[cfg(target_arch = "x86_64")]
impl PairLanes<4, 8> {
    /// [`of`](Self::of) by two dozen shuffles.
    #[inline]
    #[target_feature(enable = "avx2")]
    pub(crate) fn of_avx2(pairs: [&Pair; 4]) -> Self {
        let [Pair(a), Pair(b), Pair(c), Pair(d)] = pairs;
        let first = columns_avx2([&a[0], &b[0], &c[0], &d[0]]);
        let second = columns_avx2([&a[1], &b[1], &c[1], &d[1]]);
        let lo = |at: usize| numbers(_mm256_permute2f128_pd::<0x20>(first[at], second[at]));
        let hi = |at: usize| numbers(_mm256_permute2f128_pd::<0x31>(first[at], second[at]));
        Self::of_numbers([lo(0), lo(1), lo(2), lo(3)], [hi(0), hi(1), hi(2), hi(3)])
    }
}

/// What lies at each of four places in each 128 bits of four pairs, pair after pair.
#[cfg(target_arch = "x86_64")]
#[inline]
#[target_feature(enable = "avx512f")]
fn columns_avx512(pairs: [&Pair; 4]) -> [__m512d; 4] {
    #[allow(unsafe_code, reason = "the same bits as a vector")]
    // SAFETY: a pair is sixteen numbers of 32 bits, any of which are a vector of them.
    let row = |k: usize| unsafe { transmute::<Pair, __m512>(*pairs[k]) };
    let of = |a, b| {
        let (lo, hi) = (_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
        (_mm512_castps_pd(lo), _mm512_castps_pd(hi))
    };
    let ((lo_a, hi_a), (lo_b, hi_b)) = (of(row(0), row(1)), of(row(2), row(3)));
    [
        _mm512_unpacklo_pd(lo_a, lo_b),
        _mm512_unpackhi_pd(lo_a, lo_b),
        _mm512_unpacklo_pd(hi_a, hi_b),
        _mm512_unpackhi_pd(hi_a, hi_b),
    ]
}

/// The same of four nodes.
#[cfg(target_arch = "x86_64")]
#[inline]
#[target_feature(enable = "avx2")]
fn columns_avx2(nodes: [&Node; 4]) -> [__m256d; 4] {
    #[allow(unsafe_code, reason = "the same bits as a vector")]
    // SAFETY: a node is eight numbers of 32 bits, any of which are a vector of them.
    let row = |k: usize| unsafe { transmute::<Node, __m256>(*nodes[k]) };
    let of = |a, b| {
        let (lo, hi) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
        (_mm256_castps_pd(lo), _mm256_castps_pd(hi))
    };
    let ((lo_a, hi_a), (lo_b, hi_b)) = (of(row(0), row(1)), of(row(2), row(3)));
    [
        _mm256_unpacklo_pd(lo_a, lo_b),
        _mm256_unpackhi_pd(lo_a, lo_b),
        _mm256_unpacklo_pd(hi_a, hi_b),
        _mm256_unpackhi_pd(hi_a, hi_b),
    ]
}

/// The numbers of a vector.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn numbers<V, const N: usize>(vector: V) -> [f32; N] {
    const { assert!(size_of::<V>() == size_of::<[f32; N]>(), "all of them") };
    #[allow(unsafe_code, reason = "the same bits as numbers")]
    // SAFETY: as many bits, any of which are numbers; only ever called with vectors.
    unsafe {
        std::mem::transmute_copy(&vector)
    }
}
