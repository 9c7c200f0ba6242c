//! Low-discrepancy sequences.

/// A scrambled Sobol sequence: the same few dimensions for every seed, each shuffled and scrambled on its own, so that
/// sequences of different seeds are independent and every point of one is uniform.
///
/// Source: Burley, "Practical Hash-based Owen Scrambling", 2020.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sequence(pub u32);

/// The generator's points repeat after so many.
const PERIOD: u32 = 1 << 16;

impl Sequence {
    /// Coordinate `dimension`, below 256, of point `i`: uniform in [0, 1) over seeds, a multiple of 2⁻²⁴; never 1.
    ///
    /// Points beyond the first 65,536 are those of other sequences.
    #[inline]
    pub fn f32(self, i: u32, dimension: u32) -> f32 {
        let seed = self.0 ^ (i / PERIOD).wrapping_mul(0x9e37_79b9);
        sobol_burley::sample(i % PERIOD, dimension, seed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
