//! The steps of a traversal that depend on what the processor can do.
//!
//! All forms do the same arithmetic in the same order, without fused multiplication: answers are the same to the bit.

#[cfg(target_arch = "x86_64")]
mod eight;
mod four;
#[cfg(target_arch = "x86_64")]
mod masks;

use super::bvh8::{FAR_SLACK, Lanes, Node8, NodeRay, OrderedRay, Stack, WIDTH};
use super::triangle::{BlockHits, TriangleBlock, WatertightRay};

#[cfg(target_arch = "x86_64")]
pub(crate) use eight::Eight;
pub(crate) use four::Four;
#[cfg(target_arch = "x86_64")]
pub(crate) use masks::Masks;

/// How wide the processor's vectors are. A traversal is compiled once for each.
pub(crate) trait Width: Copy {
    /// The children that the ray meets before `t_max`, which is finite, bit by bit, and how far away; what `near` holds
    /// for others means nothing.
    fn meet(self, node: Node8<'_>, ray: &NodeRay, t_max: f32, near: &mut Lanes) -> u32;

    /// The same with fewer steps one after another, and some work once a ray: for a ray that waits for the answer.
    fn meet_ordered(self, node: Node8<'_>, ray: &OrderedRay, t_max: f32, near: &mut Lanes) -> u32;

    /// Puts the links of the children in `mask` on the stack, in their order, and returns its new height.
    fn push(self, node: Node8<'_>, mask: u32, stack: &mut Stack, top: usize) -> usize;

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

    /// What [`TriangleBlock::intersect`] finds.
    #[inline(always)]
    fn intersect(self, block: TriangleBlock<'_>, ray: &WatertightRay, t_max: f32) -> BlockHits {
        block.intersect(ray, t_max)
    }
}

/// The widest that the processor has.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Widest {
    Four(Four),
    #[cfg(target_arch = "x86_64")]
    Eight(Eight),
    #[cfg(target_arch = "x86_64")]
    Masks(Masks),
}

impl Widest {
    pub(crate) fn detect() -> Self {
        let last = Self::all().last();
        last.expect("the narrowest is always there")
    }

    /// What the processor has, the narrowest first.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        let four = std::iter::once(Self::Four(Four));
        #[cfg(target_arch = "x86_64")]
        let wider = Eight::detect()
            .map(Self::Eight)
            .into_iter()
            .chain(Masks::detect().map(Self::Masks));
        #[cfg(not(target_arch = "x86_64"))]
        let wider = None;
        four.chain(wider)
    }
}

/// A method of [`Tracer`](super::Tracer) that calls another one, which is compiled once for each width, with the widest.
macro_rules! by_width {
    ($name:ident = $with:ident($($argument:ident: $type:ty),*) $(-> $answer:ty)?) => {
        #[inline]
        fn $name(&self, $($argument: $type),*) $(-> $answer)? {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
            fn eight(
                tracer: &Tracer,
                width: $crate::trace::width::Eight,
                $($argument: $type),*
            ) $(-> $answer)? {
                tracer.$with(width, $($argument),*)
            }

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,avx512f,avx512vl,bmi1,bmi2,popcnt")]
            fn masks(
                tracer: &Tracer,
                width: $crate::trace::width::Masks,
                $($argument: $type),*
            ) $(-> $answer)? {
                tracer.$with(width, $($argument),*)
            }

            #[allow(
                unsafe_code,
                reason = "the only way to call code for a processor found at run time"
            )]
            match self.widest {
                $crate::trace::width::Widest::Four(four) => self.$with(four, $($argument),*),
                #[cfg(target_arch = "x86_64")]
                // SAFETY: the width is the proof that the processor has what the function is compiled for.
                $crate::trace::width::Widest::Eight(width) => unsafe {
                    eight(self, width, $($argument),*)
                },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: as above.
                $crate::trace::width::Widest::Masks(width) => unsafe {
                    masks(self, width, $($argument),*)
                },
            }
        }
    };
}
pub(super) use by_width;

/// Distances that count as near begin here, at the least that is positive: hits lie ahead of a ray's origin, and whichever of
/// both zeros a box ends at, it is not met.
const AHEAD: f32 = f32::from_bits(1);

/// What children are sorted by: those that are met first, the farthest before the nearest. The distance, rounded down, is
/// turned over, and its lowest bits are the child's number.
type Key = i32;

const CHILD: Key = WIDTH as Key - 1;
const NOT_MET: Key = Key::MAX;

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
