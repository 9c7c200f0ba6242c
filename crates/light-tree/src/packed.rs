//! Eight clusters in half the memory: most of a tree is read once and far away.

use crate::block::{Block, Cluster, Lanes, WIDTH};
use crate::wide::by_width;

/// A [`Block`] in four lines of the cache. What it unpacks to holds what was packed: boxes and cones are as wide or wider,
/// radii and least distances as large or larger.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(crate) struct PackedBlock {
    /// As [`Block::intensity`], and with the next all that is read of a block that is far off.
    pub(crate) intensity: Lanes,
    pub(crate) clusters: [Cluster; WIDTH],
    /// In steps from the block's least corner.
    lo: [[u16; WIDTH]; 3],
    hi: [[u16; WIDTH]; 3],
    /// In parts of [`AXIS`].
    axis: [[i16; WIDTH]; 3],
    /// The upper halves of floating-point numbers.
    near2: [u16; WIDTH],
    /// In 255 parts, from −1 to 1.
    cos: [u8; WIDTH],
    /// Six bits of exponent and two of mantissa, and 0 for 0.
    radius: [u8; WIDTH],
    corner: [f32; 3],
    /// Powers of two that the steps are.
    exponents: [i8; 3],
}

/// So many parts are a length of 1.
const AXIS: f32 = 32767.0;
/// By how much the cosine of an angle changes where its axis turns by what rounding to these parts does, and more.
const TURNED: f32 = 5e-5;

/// What a short float of 0 would be: 2⁻⁴².
const SHORTEST: u32 = (127 - 42) << 23;
/// Bits of the mantissa that a short float lacks.
const SHORTENED: u32 = 21;

impl PackedBlock {
    pub(crate) fn of(block: &Block) -> Self {
        by_width!(Self::of_avx2(block), Self::of_any(block))
    }

    /// The same code and the same bits, with an instruction that rounds.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn of_avx2(block: &Block) -> Self {
        Self::of_any(block)
    }

    #[inline(always)]
    fn of_any(block: &Block) -> Self {
        let used = 0..block.len();
        let mut packed = Self {
            intensity: block.intensity,
            clusters: block.clusters,
            lo: [[0; WIDTH]; 3],
            hi: [[0; WIDTH]; 3],
            axis: [[0; WIDTH]; 3],
            near2: [0; WIDTH],
            cos: [0; WIDTH],
            radius: [0; WIDTH],
            corner: [0.0; 3],
            exponents: [0; 3],
        };
        for k in 0..WIDTH {
            packed.near2[k] = upper_half(block.near2[k]);
            packed.cos[k] = parts_of_cosine(block.cos[k]);
            packed.radius[k] = short_float(block.radius[k]);
        }
        for axis in 0..3 {
            let (lo, hi) = (&block.lo[axis], &block.hi[axis]);
            let least = used
                .clone()
                .fold(f32::INFINITY, |least, k| lo[k].min(least));
            let most = used
                .clone()
                .fold(f32::NEG_INFINITY, |most, k| hi[k].max(most));
            if least <= most {
                packed.corner[axis] = least;
                packed.exponents[axis] = exponent(least, most);
            }
            for k in used.clone() {
                (packed.lo[axis][k], packed.hi[axis][k]) = packed.span(axis, lo[k], hi[k]);
                packed.axis[axis][k] = (block.axis[axis][k] * AXIS).round() as i16;
            }
        }
        packed
    }

    /// The steps between which `lo` to `hi` lies.
    #[inline(always)]
    fn span(&self, axis: usize, lo: f32, hi: f32) -> (u16, u16) {
        // The reciprocal of a power of two is exact.
        let (corner, per_unit) = (
            f64::from(self.corner[axis]),
            1.0 / f64::from(self.step(axis)),
        );
        let steps = |x: f32| (f64::from(x) - corner) * per_unit;
        let (mut from, mut to) = (steps(lo) as u16, steps(hi) as u16);
        // Rounded towards the corner, and unpacking rounds as well.
        while from > 0 && self.coordinate(axis, from) > lo {
            from -= 1;
        }
        while to < u16::MAX && self.coordinate(axis, to) < hi {
            to += 1;
        }
        (from, to)
    }

    #[inline(always)]
    fn step(&self, axis: usize) -> f32 {
        f32::from_bits(((i32::from(self.exponents[axis]) + 127) as u32) << 23)
    }

    #[inline(always)]
    fn coordinate(&self, axis: usize, steps: u16) -> f32 {
        self.corner[axis] + f32::from(steps) * self.step(axis)
    }

    /// Numbers the blocks of clusters that are no lights anew.
    pub(crate) fn move_children(&mut self, moved: impl Fn(usize) -> usize) {
        for cluster in &mut self.clusters {
            if let Some(child) = cluster.block() {
                *cluster = Cluster(moved(child) as u32);
            }
        }
    }

    /// Number of clusters.
    pub(crate) fn len(&self) -> usize {
        self.clusters.iter().filter(|c| !c.is_unused()).count()
    }

    /// All of it, for who is not compiled for wider instructions.
    pub(crate) fn unpack(&self) -> Block {
        by_width!(self.block_avx2(), self.block())
    }

    /// The same code and the same bits, eight lanes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn block_avx2(&self) -> Block {
        self.block()
    }

    /// All of it.
    #[inline(always)]
    pub(crate) fn block(&self) -> Block {
        let mut block = Block::EMPTY;
        self.unpack_to(&mut block, 0);
        block
    }

    /// Puts all of it into the eight lanes from `first` on.
    #[inline(always)]
    pub(crate) fn unpack_to<const N: usize>(&self, block: &mut Block<N>, first: usize) {
        for axis in 0..3 {
            let (corner, step) = (self.corner[axis], self.step(axis));
            for k in 0..WIDTH {
                block.lo[axis][first + k] = corner + f32::from(self.lo[axis][k]) * step;
                block.hi[axis][first + k] = corner + f32::from(self.hi[axis][k]) * step;
                block.axis[axis][first + k] = f32::from(self.axis[axis][k]) * (1.0 / AXIS);
            }
        }
        for k in 0..WIDTH {
            block.intensity[first + k] = self.intensity[k];
            block.clusters[first + k] = self.clusters[k];
            block.near2[first + k] = f32::from_bits(u32::from(self.near2[k]) << 16);
            block.cos[first + k] = cosine(self.cos[k]);
            block.radius[first + k] = from_short_float(self.radius[k]);
        }
    }
}

/// The least power of two by whose multiples from `least` on, of 16 bits, `most` is reached, and that is not lost in rounding.
#[inline(always)]
fn exponent(least: f32, most: f32) -> i8 {
    let extent = f64::from(most) - f64::from(least);
    let steps = f64::from(u16::MAX - 1);
    let magnitude = f64::from(least.abs().max(most.abs()));
    let step = (extent / steps).max(magnitude * f64::from(f32::EPSILON));
    // Its logarithm, rounded up, is what the number's own exponent says: of 0 the least.
    let bits = step.to_bits();
    let below = (bits >> 52) as i32 - 1023;
    let is_power = bits << 12 == 0;
    (below + i32::from(!is_power)).clamp(-126, 127) as i8
}

/// The upper half of a number ≥ 0, rounded up.
#[inline(always)]
fn upper_half(x: f32) -> u16 {
    (x.to_bits().saturating_add(0xFFFF) >> 16) as u16
}

/// A number ≥ 0, rounded up; beyond three million times the extent of all lights rounded down.
#[inline(always)]
fn short_float(x: f32) -> u8 {
    if x <= 0.0 {
        return 0;
    }
    let above = x.to_bits().saturating_sub(SHORTEST);
    above.div_ceil(1 << SHORTENED).clamp(1, u8::MAX.into()) as u8
}

#[inline(always)]
fn from_short_float(short: u8) -> f32 {
    let float = f32::from_bits(SHORTEST + (u32::from(short) << SHORTENED));
    if short == 0 { 0.0 } else { float }
}

#[inline(always)]
fn cosine(parts: u8) -> f32 {
    (f32::from(parts) * 2.0 - 255.0) * (1.0 / 255.0)
}

/// Rounded down; a cone that is one direction stays one, as its users leave room for rounding.
#[inline(always)]
fn parts_of_cosine(cos: f32) -> u8 {
    if cos >= 1.0 {
        return u8::MAX;
    }
    let cos = cos - TURNED;
    let mut parts = ((cos + 1.0) * 127.5).floor() as u8;
    while parts > 0 && cosine(parts) > cos {
        parts -= 1;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::{LightId, LightKind};
    use crate::test_lights::{any_lights, wide};

    #[test]
    fn a_block_is_four_lines_of_the_cache() {
        assert_eq!(size_of::<PackedBlock>(), 256);
    }

    #[test]
    fn what_is_unpacked_holds_what_was_packed() {
        verify::property(2000, |u| {
            let lights = any_lights(u)?;
            let Some(tree) = wide(&lights) else {
                return Ok(());
            };
            for packed in &tree.blocks {
                let block = packed.block();
                for lane in 0..packed.len() {
                    let below = tree.lights_below(packed.clusters[lane]);
                    // The middle of a triangle is rounded.
                    let has_place = |l: &LightId| {
                        let kind = lights.kind(*l);
                        !kind.is_distant() && kind != LightKind::Triangle
                    };
                    for light in below.into_iter().filter(has_place) {
                        let at = lights.position(light) * tree.scale;
                        for axis in 0..3 {
                            let (lo, hi) = (block.lo[axis][lane], block.hi[axis][lane]);
                            assert!(lo <= at[axis] && at[axis] <= hi, "{at} not in {lo} to {hi}");
                        }
                    }
                }
            }
            Ok(())
        });
    }

    #[test]
    fn cosines_are_rounded_down_and_the_ends_are_kept() {
        assert_eq!([cosine(0), cosine(u8::MAX)], [-1.0, 1.0], "ends");
        assert_eq!(
            [parts_of_cosine(-1.0), parts_of_cosine(1.0)],
            [0, u8::MAX],
            "ends"
        );
        for i in -1000..1000 {
            let cos = i as f32 / 1000.0;
            let unpacked = cosine(parts_of_cosine(cos));
            assert!(
                unpacked <= cos - 0.5 * TURNED || unpacked == -1.0,
                "{unpacked} of {cos}"
            );
            assert!(unpacked > cos - 0.009, "{unpacked} of {cos}");
        }
    }

    #[test]
    fn radii_are_rounded_up_by_a_quarter_at_most() {
        assert_eq!(from_short_float(short_float(0.0)), 0.0, "none");
        for i in 0..600 {
            let radius = 1e-12 * 1.1f32.powi(i);
            let unpacked = from_short_float(short_float(radius));
            if radius < 3e6 {
                assert!(
                    radius <= unpacked && unpacked <= 1.25 * radius,
                    "{unpacked} of {radius}"
                );
            } else {
                assert!(unpacked >= 3e6, "{unpacked} of {radius}");
            }
        }
    }

    #[test]
    fn boxes_of_a_few_ulp_far_from_the_origin_are_packed() {
        let mut block = Block::<WIDTH>::EMPTY;
        let places = [1.0f32, 1.0f32.next_up(), 1.0f32.next_up().next_up(), -1.0];
        for (k, x) in places.into_iter().enumerate() {
            block.clusters[k] = Cluster::of_light(LightId(k as u32));
            for axis in 0..3 {
                (block.lo[axis][k], block.hi[axis][k]) = (x, x.next_up());
            }
        }
        for used in [3, 4] {
            let mut block = block.clone();
            for k in used..4 {
                block.clusters[k] = Block::<WIDTH>::EMPTY.clusters[k];
            }
            let unpacked = PackedBlock::of(&block).block();
            for (k, place) in places.iter().enumerate().take(used) {
                let (lo, hi) = (unpacked.lo[0][k], unpacked.hi[0][k]);
                assert!(lo <= *place && place.next_up() <= hi, "{k} of {used}");
                let wide = if used == 3 { 1e-6 } else { 1e-4 };
                assert!(hi - lo < wide, "{} of {used}", hi - lo);
            }
        }
    }
}
