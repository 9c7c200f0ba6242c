//! One random stream per (seed, index, sample, purpose).

use rand::rngs::Xoshiro128PlusPlus;
use rand::{Rng as _, SeedableRng};

/// What a stream is used for. Streams of different purpose never share numbers, so adding a decision
/// to one stage leaves the others as they were.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// Camera rays and eye paths.
    Eye = 1,
    /// Choice of lights at gather points.
    Lights = 2,
    /// Points on a light, such as inside a virtual light's cone.
    LightSurface = 3,
    /// Particle paths that leave virtual lights.
    Particles = 4,
    /// Particle paths that only estimate how many virtual lights a path leaves.
    Pilot = 5,
    /// Choices made once while building a structure.
    Build = 6,
    /// Choice of a pixel's low-discrepancy sequence.
    Sequence = 8,
    /// Choice of the gather point that a block of pixels takes its cut from.
    Pivot = 7,
    /// What is found out about a tile before lights are chosen.
    Probe = 9,
}

/// A stream of random numbers: rand's portable xoshiro128++, the same on every platform.
#[derive(Debug, Clone)]
pub struct Rng(Source);

/// Where a stream's bits come from.
#[derive(Debug, Clone)]
enum Source {
    Random(Xoshiro128PlusPlus),
    #[cfg(feature = "extreme")]
    Extreme(Extreme),
}

/// The least and the greatest of random numbers, for tests of what they lead to.
#[cfg(feature = "extreme")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extreme {
    /// 0.
    Zero,
    /// The greatest number below 1 of its type.
    BelowOne,
}

/// What SplitMix64 counts by.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// What SplitMix64 gives after the state `z`: a bijection of 64-bit words without visible structure.
fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(STEP);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Rng {
    /// The stream of `sample` of item `index` (a pixel, a particle path) for `purpose`.
    #[inline]
    pub fn new(seed: u64, index: u64, sample: u64, purpose: Purpose) -> Self {
        let a = mix(seed ^ mix(purpose as u64));
        let b = mix(a ^ index);
        let lo = mix(b ^ sample);
        let hi = mix(lo ^ 0x6a09_e667_f3bc_c909);
        let mut state = [0; 16];
        state[..8].copy_from_slice(&lo.to_le_bytes());
        state[8..].copy_from_slice(&hi.to_le_bytes());
        Self(Source::Random(Xoshiro128PlusPlus::from_seed(state)))
    }

    /// A stream that gives the same number for ever.
    #[cfg(feature = "extreme")]
    pub fn extreme(number: Extreme) -> Self {
        Self(Source::Extreme(number))
    }

    /// Any 64 bits, each pattern alike.
    #[inline]
    fn u64(&mut self) -> u64 {
        match &mut self.0 {
            Source::Random(random) => random.next_u64(),
            #[cfg(feature = "extreme")]
            Source::Extreme(Extreme::Zero) => 0,
            #[cfg(feature = "extreme")]
            Source::Extreme(Extreme::BelowOne) => u64::MAX,
        }
    }

    /// Any 32 bits, each pattern alike.
    #[inline]
    pub fn u32(&mut self) -> u32 {
        match &mut self.0 {
            Source::Random(random) => random.next_u32(),
            #[cfg(feature = "extreme")]
            Source::Extreme(_) => self.u64() as u32,
        }
    }

    /// Uniform in [0, 1), a multiple of 2⁻²⁴; never 1.
    #[inline]
    pub fn f32(&mut self) -> f32 {
        (self.u32() >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// Uniform in [0, 1), a multiple of 2⁻⁵³; never 1. Deep trees use up the bits of an `f32`.
    #[inline]
    pub fn f64(&mut self) -> f64 {
        unit(self.u64())
    }

    /// A stream of numbers like those of [`f64`](Self::f64), of which none waits for the one before it: for who draws many at a
    /// time. The next of its kind is another.
    #[inline]
    pub fn numbers(&mut self) -> Numbers {
        Numbers {
            state: self.u64(),
            #[cfg(feature = "extreme")]
            extreme: match self.0 {
                Source::Random(_) => None,
                Source::Extreme(extreme) => Some(extreme),
            },
        }
    }
}

/// Endless numbers, uniform in [0, 1), by SplitMix64: see [`Rng::numbers`].
///
/// Source: Steele, Lea and Flood 2014, "Fast splittable pseudorandom number generators".
#[derive(Debug, Clone)]
pub struct Numbers {
    state: u64,
    #[cfg(feature = "extreme")]
    extreme: Option<Extreme>,
}

impl Iterator for Numbers {
    type Item = f64;

    #[inline]
    fn next(&mut self) -> Option<f64> {
        let bits = mix(self.state);
        self.state = self.state.wrapping_add(STEP);
        #[cfg(feature = "extreme")]
        let bits = match self.extreme {
            None => bits,
            Some(Extreme::Zero) => 0,
            Some(Extreme::BelowOne) => u64::MAX,
        };
        Some(unit(bits))
    }
}

/// A multiple of 2⁻⁵³ in [0, 1) from any 64 bits.
#[inline]
fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_of_neighbours_are_uncorrelated() {
        let n = 20_000;
        let mut sum = 0.0;
        for i in 0..n {
            let a = Rng::new(1, i, 0, Purpose::Eye).f64() - 0.5;
            let b = Rng::new(1, i + 1, 0, Purpose::Eye).f64() - 0.5;
            let c = Rng::new(1, i, 1, Purpose::Eye).f64() - 0.5;
            let d = Rng::new(1, i, 0, Purpose::Lights).f64() - 0.5;
            sum += a * b + a * c + a * d;
        }
        // Each product has standard deviation 1/12; 5 sigma, false alarm 6e-7.
        let z = sum / (3.0 * n as f64).sqrt() * 12.0;
        assert!(z.abs() < 5.0, "correlation z = {z}");
    }

    #[test]
    fn many_numbers_are_uniform_and_uncorrelated() {
        let (streams, each) = (2_000, 10);
        let mut observed = [0.0; 64];
        let mut sum = 0.0;
        for i in 0..streams {
            let mut rng = Rng::new(1, i, 0, Purpose::Lights);
            let numbers: Vec<f64> = rng.numbers().take(each).collect();
            let again: Vec<f64> = rng.numbers().take(each).collect();
            for k in 0..each {
                observed[(numbers[k] * 64.0) as usize] += 1.0;
                sum += (numbers[k] - 0.5) * (numbers[(k + 1) % each] - 0.5);
                sum += (numbers[k] - 0.5) * (again[k] - 0.5);
            }
        }
        // 64 bins at 5 sigma, false alarm 4e-5.
        let expected = streams as f64 * each as f64 / 64.0;
        for (bin, count) in observed.into_iter().enumerate() {
            let z = (count - expected) / f64::sqrt(expected);
            assert!(z.abs() < 5.0, "{count} in bin {bin}: z = {z}");
        }
        // Each product has standard deviation 1/12; 5 sigma, false alarm 6e-7.
        let z = sum / (2.0 * streams as f64 * each as f64).sqrt() * 12.0;
        assert!(z.abs() < 5.0, "correlation z = {z}");
    }

    #[test]
    fn outputs_are_stable_at_a_pinned_seed() {
        let mut rng = Rng::new(1, 2, 3, Purpose::Lights);
        let first: Vec<u32> = (0..8).map(|_| (rng.f32() * 1e6) as u32).collect();
        assert_eq!(
            first, STABLE,
            "changing the stream changes every picture: note it in CHANGELOG.md"
        );
    }

    #[cfg(feature = "extreme")]
    #[test]
    fn extreme_streams_give_the_least_and_the_greatest_numbers() {
        let mut zero = Rng::extreme(Extreme::Zero);
        let mut below = Rng::extreme(Extreme::BelowOne);
        for _ in 0..3 {
            assert_eq!((zero.u32(), zero.f32(), zero.f64()), (0, 0.0, 0.0));
            let greatest = (u32::MAX, 1.0f32.next_down(), 1.0f64.next_down());
            assert_eq!((below.u32(), below.f32(), below.f64()), greatest);
            assert_eq!(zero.numbers().next(), Some(0.0));
            assert_eq!(below.numbers().nth(1), Some(greatest.2));
        }
    }

    const STABLE: [u32; 8] = [
        672193, 751837, 857452, 648757, 401636, 730162, 978133, 25668,
    ];
}
