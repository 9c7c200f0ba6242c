//! Statistics over repeated runs and along convergence curves.

use serde::Serialize;

/// The middle of some values and how far they spread.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Half of the values are above, half below; the mean of the middle two of an even number.
    pub median: f64,
    /// The least.
    pub low: f64,
    /// The greatest.
    pub high: f64,
}

impl Spread {
    /// Of the finite values among `values`; `None` when there is none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let (low, high) = (*sorted.first()?, *sorted.last()?);
        let n = sorted.len();
        let median = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
        Some(Self { median, low, high })
    }
}

/// The exponent k of the power law y = c·xᵏ that fits `points` best: least squares of the logarithms.
///
/// For the squared error of an unbiased Monte Carlo method against time or rays it is −1. Points that are not
/// finite and above 0 are left out; `None` when fewer than two different x remain.
pub fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let usable = |v: f64| v.is_finite() && v > 0.0;
    let logs: Vec<(f64, f64)> = points
        .iter()
        .filter(|(x, y)| usable(*x) && usable(*y))
        .map(|(x, y)| (x.ln(), y.ln()))
        .collect();
    let n = logs.len() as f64;
    let (mean_x, mean_y) = (
        logs.iter().map(|p| p.0).sum::<f64>() / n,
        logs.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let covariance: f64 = logs.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum();
    let variance: f64 = logs.iter().map(|p| (p.0 - mean_x).powi(2)).sum();
    // No points give 0/0 in the means, and one point no variance.
    (variance > 1e-12).then(|| covariance / variance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_an_even_number_is_between_the_middle_two() {
        let spread = Spread::of([4.0, 1.0, 2.0, 10.0]).expect("values");
        assert_eq!((spread.low, spread.median, spread.high), (1.0, 3.0, 10.0));
        assert_eq!(Spread::of([7.0]).expect("one").median, 7.0, "one");
        assert_eq!(Spread::of([f64::NAN, f64::INFINITY]), None, "none");
    }

    #[test]
    fn a_power_law_gives_its_exponent() {
        let points: Vec<_> = (1..9).map(|i| (f64::from(i), 3.0 / f64::from(i))).collect();
        let found = slope(&points).expect("points");
        assert!((found + 1.0).abs() < 1e-12, "{found}");
    }

    #[test]
    fn no_slope_without_two_different_usable_points() {
        for points in [
            &[][..],
            &[(1.0, 1.0)],
            &[(2.0, 1.0), (2.0, 3.0)],
            &[(1.0, 1.0), (0.0, 2.0), (3.0, f64::NAN)],
        ] {
            assert_eq!(slope(points), None, "{points:?}");
        }
    }
}
