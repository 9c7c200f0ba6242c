//! Pearson's chi-square test.

use statrs::function::gamma::gamma_ur;

/// Bins with fewer expected hits than this are pooled: the statistic is not chi-square distributed with them.
const LEAST_EXPECTED: f64 = 5.0;

/// What a [`chi_square`] test found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChiSquare {
    /// Sum of (observed − expected)² / expected over the bins, after pooling; infinite after an impossible hit.
    pub statistic: f64,
    /// Bins after pooling, less one.
    pub degrees: usize,
    /// Probability of a statistic this large or larger when the expectation is true.
    pub p_value: f64,
}

/// Tests whether hits counted in `observed` fit `expected_probability`, bin for bin.
///
/// Bins with an expectation below five hits are pooled into one (and that, if it is still below five, with the
/// least of the others). A hit in a bin of probability zero gives p = 0. When fewer than two bins remain,
/// or there are no hits at all, there is nothing to test: zero degrees and p = 1. So mind that there are
/// enough hits: a test of few is one that always passes.
///
/// Failing when `p_value < alpha` has a false-alarm rate of about `alpha`. The distribution is a limit for many
/// hits: with bins that expect hardly more than five, far tails are heavier than stated, so give tests that
/// use a tiny `alpha` some tens of hits a bin.
///
/// # Panics
///
/// When the lengths differ, a probability is negative or not finite, or their sum is not 1 within 1e-3. (A
/// smaller difference, rounding of an f32 pmf, is scaled away.)
///
/// Source: Pearson 1900; the rule of five: Cochran 1954.
pub fn chi_square(observed: &[u64], expected_probability: &[f64]) -> ChiSquare {
    assert_eq!(
        observed.len(),
        expected_probability.len(),
        "bins observed, and expected"
    );
    let sound = |p: &f64| p.is_finite() && *p >= 0.0;
    assert!(
        expected_probability.iter().all(sound),
        "probabilities are {expected_probability:?}; expected ≥ 0"
    );
    let total: f64 = expected_probability.iter().sum();
    assert!(
        (total - 1.0).abs() < 1e-3,
        "probabilities add up to {total}; expected 1"
    );

    let hits: u64 = observed.iter().sum();
    let mut bins: Vec<Bin> = Vec::new();
    let mut pooled = Bin::default();
    for (&count, &probability) in observed.iter().zip(expected_probability) {
        if probability == 0.0 {
            if count > 0 {
                return ChiSquare {
                    statistic: f64::INFINITY,
                    degrees: bins.len(),
                    p_value: 0.0,
                };
            }
            continue;
        }
        let bin = Bin {
            observed: count as f64,
            expected: hits as f64 * probability / total,
        };
        if bin.expected < LEAST_EXPECTED {
            pooled.add(bin)
        } else {
            bins.push(bin)
        }
    }
    if pooled.expected >= LEAST_EXPECTED {
        bins.push(pooled);
    } else if let Some(least) = bins
        .iter_mut()
        .min_by(|a, b| a.expected.total_cmp(&b.expected))
    {
        least.add(pooled);
    }
    if bins.len() < 2 {
        return ChiSquare {
            statistic: 0.0,
            degrees: 0,
            p_value: 1.0,
        };
    }
    let statistic: f64 = bins
        .iter()
        .map(|bin| (bin.observed - bin.expected).powi(2) / bin.expected)
        .sum();
    let degrees = bins.len() - 1;
    ChiSquare {
        statistic,
        degrees,
        p_value: survival(statistic, degrees),
    }
}

#[derive(Clone, Copy, Default)]
struct Bin {
    observed: f64,
    expected: f64,
}

impl Bin {
    fn add(&mut self, other: Bin) {
        self.observed += other.observed;
        self.expected += other.expected;
    }
}

/// Probability that a chi-square variable exceeds `statistic`.
fn survival(statistic: f64, degrees: usize) -> f64 {
    // The upper incomplete gamma function wants a positive argument.
    if statistic > 0.0 {
        gamma_ur(degrees as f64 / 2.0, statistic / 2.0)
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SplitMix;

    /// Counts `draws` draws from weights that need not be normalised.
    fn draw(rng: &mut SplitMix, weights: &[f64], draws: usize) -> Vec<u64> {
        let total: f64 = weights.iter().sum();
        let mut counts = vec![0; weights.len()];
        for _ in 0..draws {
            let mut u = rng.uniform() * total;
            let bin = weights.iter().position(|weight| {
                u -= weight;
                u < 0.0
            });
            counts[bin.unwrap_or(weights.len() - 1)] += 1;
        }
        counts
    }

    #[test]
    fn figures_agree_with_a_table() {
        // By hand: 5²/10 + 5²/10 = 5. Critical values: 3.841 (1 degree), 18.307 (10 degrees) at 5 %.
        let found = chi_square(&[15, 5], &[0.5, 0.5]);
        assert_eq!((found.statistic, found.degrees), (5.0, 1), "by hand");
        assert!(
            (found.p_value - 0.025_347).abs() < 1e-6,
            "{}",
            found.p_value
        );
        assert!((survival(3.841_459, 1) - 0.05).abs() < 1e-6, "1 degree");
        assert!((survival(18.307_038, 10) - 0.05).abs() < 1e-6, "10 degrees");
        assert_eq!(chi_square(&[10, 10], &[0.5, 0.5]).p_value, 1.0, "perfect");
    }

    #[test]
    fn bins_that_expect_little_are_pooled() {
        // 100 hits: 90, 4, 4, 2 expected; the last three become one bin of 10.
        let found = chi_square(&[90, 0, 9, 1], &[0.9, 0.04, 0.04, 0.02]);
        assert_eq!((found.statistic, found.degrees), (0.0, 1), "pooled");
        // What is pooled still expects 2 only and joins the least of the others.
        let found = chi_square(&[60, 39, 1], &[0.6, 0.38, 0.02]);
        assert_eq!((found.statistic, found.degrees), (0.0, 1), "pooled twice");
    }

    #[test]
    fn an_impossible_hit_is_damning_and_an_impossible_miss_is_not() {
        assert_eq!(
            chi_square(&[500, 500, 1], &[0.5, 0.5, 0.0]).p_value,
            0.0,
            "hit"
        );
        assert_eq!(
            chi_square(&[500, 500, 0], &[0.5, 0.5, 0.0]).p_value,
            1.0,
            "miss"
        );
    }

    #[test]
    fn without_anything_to_test_p_is_one() {
        for (observed, expected) in [
            (&[0, 0][..], &[0.5, 0.5][..]),
            (&[70], &[1.0]),
            (&[2, 1], &[0.5, 0.5]),
        ] {
            let found = chi_square(observed, expected);
            assert_eq!((found.degrees, found.p_value), (0, 1.0), "{observed:?}");
        }
    }

    #[test]
    fn a_true_distribution_raises_alarms_at_the_stated_rate() {
        // 4000 tests at α = 0.05: 200 ± 14 alarms (1 σ); five σ have a false-alarm rate of 6e-7.
        let probabilities = [0.4, 0.3, 0.2, 0.08, 0.02];
        let mut rng = SplitMix(1);
        let alarms = (0..4000)
            .filter(|_| {
                chi_square(&draw(&mut rng, &probabilities, 1000), &probabilities).p_value < 0.05
            })
            .count();
        assert!(
            (130..=270).contains(&alarms),
            "{alarms} alarms of 200 expected"
        );
    }

    #[test]
    fn a_distribution_off_by_two_per_cent_is_found() {
        let probabilities = [0.25; 4];
        let counts = draw(&mut SplitMix(2), &[0.25, 0.25, 0.25, 0.255], 1_000_000);
        let found = chi_square(&counts, &probabilities);
        assert!(found.p_value < 1e-9, "{found:?}");
        let counts = draw(&mut SplitMix(2), &probabilities, 1_000_000);
        assert!(
            chi_square(&counts, &probabilities).p_value > 1e-6,
            "the true one passes"
        );
    }
}
