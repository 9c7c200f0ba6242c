//! z-tests, many at once, and whether z-scores are normal.

use std::f64::consts::SQRT_2;

use statrs::function::erf::{erfc, erfc_inv};

/// Relative difference that rounding alone explains: four ulps of f32, in which radiance is computed.
const ROUNDING: f64 = 4.0 * f32::EPSILON as f64;

/// How many standard errors `mean` lies above `truth`: (mean − truth) / √variance_of_mean.
///
/// `variance_of_mean` is the sample variance over the number of samples. With many samples the score of an
/// unbiased estimate is standard normal: |z| > [`critical_z`]`(alpha)` is a false alarm with
/// probability `alpha`. With few samples, or where rare samples carry much of the sum, it has heavier tails.
///
/// With a variance of zero (every sample alike) the score is 0 when both agree to within a few ulps of f32, and
/// otherwise an infinity with the sign of the difference. NaN in gives NaN out, which fails every `abs() < limit`.
///
/// # Panics
///
/// When the variance is negative.
pub fn z_test(mean: f64, variance_of_mean: f64, truth: f64) -> f64 {
    assert!(
        variance_of_mean >= 0.0 || variance_of_mean.is_nan(),
        "variance is {variance_of_mean}; expected ≥ 0"
    );
    let difference = mean - truth;
    if variance_of_mean != 0.0 || difference.is_nan() {
        return difference / variance_of_mean.sqrt();
    }
    if difference.abs() <= ROUNDING * mean.abs().max(truth.abs()) {
        0.0
    } else {
        f64::INFINITY.copysign(difference)
    }
}

/// Two-sided p-value of a z-score: the probability of one as far from 0, either way. NaN gives 0.
pub fn p_value(z: f64) -> f64 {
    if z.is_nan() {
        0.0
    } else {
        erfc(z.abs() / SQRT_2)
    }
}

/// The |z| that a sound estimate exceeds with probability `alpha`, either way.
///
/// # Panics
///
/// When `alpha` is outside (0, 1].
pub fn critical_z(alpha: f64) -> f64 {
    assert!(
        alpha > 0.0 && alpha <= 1.0,
        "alpha is {alpha}; expected in (0, 1]"
    );
    SQRT_2 * erfc_inv(alpha)
}

/// The false-alarm rate for each of `tests` independent tests that gives all of them together the rate `alpha`:
/// 1 − (1 − alpha)^(1/tests). Dependent tests together have a lower rate in most cases that matter here.
///
/// # Panics
///
/// When `alpha` is outside [0, 1) or there are no tests.
///
/// Source: Šidák 1967.
pub fn sidak(alpha: f64, tests: usize) -> f64 {
    assert!(
        (0.0..1.0).contains(&alpha),
        "alpha is {alpha}; expected in [0, 1)"
    );
    assert!(tests > 0, "expected at least one test");
    // For small alpha, 1 − alpha and its root would round to 1.
    -((-alpha).ln_1p() / tests as f64).exp_m1()
}

/// p-value of the hypothesis that the scores `z` are independent and standard normal (Anderson–Darling).
///
/// Low when the scores are shifted (bias), too wide (a variance that is estimated too low) or too narrow
/// (too high), also where no single score is suspicious. It weighs tails more than Kolmogorov–Smirnov does. Scores that come from
/// few samples each are Student-distributed and will fail by right when there are many of them.
///
/// Failing when it is below `alpha` has a false-alarm rate of `alpha`, to about 1e-4 absolute in the middle;
/// the tail is approximate below 1e-6 and ends in 0. No scores give 1; NaN or an infinity gives 0.
///
/// Source: Anderson, Darling 1954, all parameters known; Marsaglia, Marsaglia 2004, Evaluating the
/// Anderson-Darling distribution.
pub fn normal_fit(z: &[f64]) -> f64 {
    if z.is_empty() {
        return 1.0;
    }
    if !z.iter().all(|score| score.is_finite()) {
        return 0.0;
    }
    let mut sorted = z.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let n = sorted.len() as f64;
    // Both logarithms from the tail that they lie in, so that 1 − Φ never cancels.
    let ln_below = |score: f64| (0.5 * erfc(-score / SQRT_2)).ln();
    let pairs = sorted.iter().zip(sorted.iter().rev()).enumerate();
    let sum: f64 = pairs
        .map(|(i, (&low, &high))| (2 * i + 1) as f64 * (ln_below(low) + ln_below(-high)))
        .sum();
    let statistic = -n - sum / n;
    anderson_darling_survival(statistic, n)
}

/// Probability that the Anderson–Darling statistic of `n` values exceeds `a`. Constants: Marsaglia 2004.
fn anderson_darling_survival(a: f64, n: f64) -> f64 {
    if a <= 0.0 {
        return 1.0;
    }
    let a = a.min(100.0); // p is 0 long before, and infinity would give ∞ − ∞ below
    /// c₀ + c₁x + c₂x² + …
    fn polynomial(x: f64, coefficients: &[f64]) -> f64 {
        coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
    }
    // Limit for many values, as a survival function so that small ones keep their digits.
    let limit = if a < 2.0 {
        let series = polynomial(
            a,
            &[
                2.000_12,
                0.247_105,
                -0.064_982_1,
                0.034_796_2,
                -0.011_672,
                0.001_686_91,
            ],
        );
        1.0 - (-1.233_714_1 / a).exp() / a.sqrt() * series
    } else {
        let series = polynomial(
            a,
            &[
                1.0776,
                -2.306_95,
                0.434_24,
                -0.082_433,
                0.008_056,
                -0.000_314_6,
            ],
        );
        -(-series.exp()).exp_m1()
    };
    // Correction for n values.
    let x = 1.0 - limit;
    let corner = 0.012_65 + 0.1757 / n;
    let correction = if x > 0.8 {
        polynomial(
            x,
            &[
                -130.2137, 745.2337, -1705.091, 1950.646, -1116.360, 255.7844,
            ],
        ) / n
    } else if x < corner {
        let t = x / corner;
        t.sqrt() * (1.0 - t) * (49.0 * t - 102.0) * (0.0037 / (n * n) + 0.000_78 / n + 0.000_06) / n
    } else {
        let t = (x - corner) / (0.8 - corner);
        let series = polynomial(
            t,
            &[-0.000_226_33, 6.540_34, -14.6538, 14.458, -8.259, 1.918_64],
        );
        series * (0.042_13 + 0.013_65 / n) / n
    };
    // Beyond the last digit of the correction's fit it is noise that could hide, or make, a tiny p.
    if limit < 1e-3 {
        limit
    } else {
        (limit - correction).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Running, SplitMix};

    #[test]
    fn scores_are_differences_in_standard_errors() {
        assert_eq!(z_test(3.0, 0.25, 2.0), 2.0, "above");
        assert_eq!(z_test(1.0, 0.25, 2.0), -2.0, "below");
        assert!(
            z_test(f64::NAN, 0.25, 2.0).is_nan() && z_test(f64::NAN, 0.0, 2.0).is_nan(),
            "NaN"
        );
    }

    #[test]
    fn without_variance_only_rounding_is_forgiven() {
        assert_eq!(z_test(0.0, 0.0, 0.0), 0.0, "black");
        assert_eq!(z_test(f64::from(0.1_f32), 0.0, 0.1), 0.0, "an ulp of f32");
        assert_eq!(z_test(0.100_001, 0.0, 0.1), f64::INFINITY, "above");
        assert_eq!(z_test(0.0, 0.0, 1e-30), f64::NEG_INFINITY, "below");
    }

    #[test]
    fn p_values_and_critical_scores_are_those_of_the_tables() {
        assert!((p_value(1.959_963_985) - 0.05).abs() < 1e-9, "5 %");
        assert!((p_value(-5.0) / 5.733e-7 - 1.0).abs() < 1e-3, "five sigma");
        assert_eq!(
            (p_value(f64::INFINITY), p_value(f64::NAN), p_value(0.0)),
            (0.0, 0.0, 1.0),
            "ends"
        );
        for alpha in [0.5, 0.05, 1e-3, 1e-9, 1e-15] {
            assert!(
                (p_value(critical_z(alpha)) / alpha - 1.0).abs() < 1e-6,
                "{alpha}"
            );
        }
    }

    #[test]
    fn sidak_gives_each_test_its_share() {
        assert_eq!(sidak(0.05, 1), 0.05, "one test");
        assert!(
            (1.0 - (1.0 - sidak(0.05, 20)).powi(20) - 0.05).abs() < 1e-12,
            "twenty tests"
        );
        assert!(
            (sidak(1e-12, 1_000_000) / 1e-18 - 1.0).abs() < 1e-9,
            "tiny rates keep their digits"
        );
    }

    /// z-scores of means of 256 uniform samples (of variance 1/12) against `truth`.
    fn scores(rng: &mut SplitMix, count: usize, truth: f64) -> Vec<f64> {
        let score = |_| {
            let running: Running = (0..256).map(|_| rng.uniform()).collect();
            z_test(running.mean(), running.variance_of_mean(), truth)
        };
        (0..count).map(score).collect()
    }

    #[test]
    fn a_mean_off_by_one_per_cent_is_found() {
        let running: Running = (0..200_000)
            .scan(SplitMix(3), |rng, _| Some(rng.uniform()))
            .collect();
        let limit = critical_z(1e-6);
        assert!(
            z_test(running.mean(), running.variance_of_mean(), 0.5).abs() < limit,
            "the true mean passes"
        );
        assert!(
            z_test(running.mean(), running.variance_of_mean(), 0.505) < -limit,
            "the other does not"
        );
    }

    #[test]
    fn true_normals_raise_alarms_at_the_stated_rate() {
        // 4000 tests at α = 0.05: 200 ± 14 alarms; five σ have a false-alarm rate of 6e-7. Likewise 4 ± 2 at 0.001.
        for n in [1, 5, 100] {
            let mut rng = SplitMix(n);
            let p: Vec<f64> = (0..4000)
                .map(|_| normal_fit(&(0..n).map(|_| rng.normal()).collect::<Vec<_>>()))
                .collect();
            let below = |alpha: f64| p.iter().filter(|&&p| p < alpha).count();
            assert!(
                (130..=270).contains(&below(0.05)),
                "{n} values: {} alarms of 200 expected",
                below(0.05)
            );
            assert!(
                (1840..=2160).contains(&below(0.5)),
                "{n} values: {} of 2000 expected",
                below(0.5)
            );
            assert!(
                below(0.001) <= 15,
                "{n} values: {} of 4 expected",
                below(0.001)
            );
        }
    }

    #[test]
    fn scores_of_a_sound_estimator_pass() {
        assert!(
            normal_fit(&scores(&mut SplitMix(4), 2000, 0.5)) > 1e-4,
            "sound"
        );
    }

    #[test]
    fn wrong_scores_are_found() {
        // A bias of a fifth of a standard error: no single score shows it.
        let standard_error = (1.0_f64 / 12.0 / 256.0).sqrt();
        let biased = scores(&mut SplitMix(5), 2000, 0.5 + 0.2 * standard_error);
        assert!(
            biased
                .iter()
                .all(|z| z.abs() < critical_z(sidak(1e-3, 2000))),
            "none stands out"
        );
        assert!(normal_fit(&biased) < 1e-9, "biased");
        let sound = scores(&mut SplitMix(6), 2000, 0.5);
        for scale in [0.85, 1.2] {
            let scaled: Vec<f64> = sound.iter().map(|z| z * scale).collect();
            assert!(
                normal_fit(&scaled) < 1e-6,
                "variance off, {scale}: {}",
                normal_fit(&scaled)
            );
        }
        let constant = [0.0; 50];
        assert!(normal_fit(&constant) < 1e-6, "all the same");
    }

    #[test]
    fn no_scores_pass_and_broken_ones_fail() {
        assert_eq!(normal_fit(&[]), 1.0, "none");
        assert_eq!(normal_fit(&[0.1, f64::NAN]), 0.0, "NaN");
        assert_eq!(normal_fit(&[0.1, f64::INFINITY]), 0.0, "infinity");
        assert_eq!(normal_fit(&[50.0; 3]), 0.0, "far out");
    }
}
