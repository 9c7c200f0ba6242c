//! Low-discrepancy sequences.

use crate::Rng;

/// A scrambled Sobol sequence: the same few dimensions for every seed, each shuffled and scrambled on its own, so that
/// sequences of different seeds are independent and every point of one is uniform.
///
/// Source: Burley, "Practical Hash-based Owen Scrambling", 2020.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sequence(pub u32);

/// The generator's points repeat after so many.
const PERIOD: u32 = 1 << 16;
/// Coordinates are multiples of this.
const STEP: f64 = 1.0 / 8_388_608.0;

impl Sequence {
    /// Coordinate `dimension`, below 256, of point `i`: uniform in [0, 1) over seeds, a multiple of 2⁻²³; never 1.
    ///
    /// Points beyond the first 65,536 are those of other sequences.
    #[inline]
    pub fn f32(self, i: u32, dimension: u32) -> f32 {
        let seed = self.0 ^ (i / PERIOD).wrapping_mul(0x9e37_79b9);
        sobol_burley::sample(i % PERIOD, dimension, seed)
    }

    /// [`f32`](Self::f32) with random digits behind those that the sequence has: uniform in [0, 1), never 1. What chooses
    /// among millions needs them.
    #[inline]
    pub fn f64(self, i: u32, dimension: u32, rng: &mut Rng) -> f64 {
        let u = f64::from(self.f32(i, dimension)) + rng.f64() * STEP;
        // The sum may round up to 1.
        u.min(1.0 - f64::EPSILON / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Purpose;

    #[test]
    fn any_aligned_run_of_64_points_has_one_in_each_of_64_intervals() {
        for (seed, first) in [
            (1, 0),
            (2, 64),
            (3, 960),
            (4, PERIOD),
            (5, 3 * PERIOD + 128),
        ] {
            for dimension in 0..3 {
                let mut seen = [false; 64];
                for i in first..first + 64 {
                    let x = Sequence(seed).f32(i, dimension);
                    assert!((0.0..1.0).contains(&x), "{x}");
                    let interval = (x * 64.0) as usize;
                    assert!(!seen[interval], "seed {seed}, point {i}: {x} comes second");
                    seen[interval] = true;
                }
            }
        }
    }

    #[test]
    fn random_digits_fill_all_between_neighbouring_coordinates() {
        let mut rng = Rng::new(1, 0, 0, Purpose::Lights);
        let (mut quarters, mut odd) = ([0; 4], 0);
        for seed in 0..4000 {
            let coordinate = f64::from(Sequence(seed).f32(5, 2)) / STEP;
            assert_eq!(coordinate.fract(), 0.0, "a multiple of the step");
            odd += u32::from(coordinate % 2.0 == 1.0);
            let u = Sequence(seed).f64(5, 2, &mut rng) / STEP;
            assert_eq!(u.floor(), coordinate, "the sequence's digits");
            quarters[(u.fract() * 4.0) as usize] += 1;
        }
        // Expected 1000 ± 27 each, and 2000 ± 32 odd; 5 sigma, false alarm 3e-6.
        assert!(
            quarters.iter().all(|&n: &i32| (n - 1000).abs() < 137),
            "{quarters:?}"
        );
        assert!(
            (1842..2158).contains(&odd),
            "the step is too small: {odd} are odd"
        );
    }

    #[test]
    fn points_are_uniform_over_seeds() {
        let n = 20_000;
        for i in [0, 1, 77, PERIOD + 5] {
            let mean = (0..n)
                .map(|seed| f64::from(Sequence(seed).f32(i, 2)))
                .sum::<f64>()
                / f64::from(n);
            // Standard deviation 1/√12 a point; 5 sigma, false alarm 2e-6 in all.
            let z = (mean - 0.5) * (12.0 * f64::from(n)).sqrt();
            assert!(z.abs() < 5.0, "point {i}: z = {z}");
        }
    }
}
