//! Weighted choice among many.

/// A discrete distribution with probabilities proportional to given weights.
///
/// Sums are kept in f64: an f32 prefix sum over a million weights stops growing.
#[derive(Debug, Clone)]
pub struct Discrete {
    /// `cumulative[i]` = sum of weights 0..=i.
    cumulative: Vec<f64>,
}

impl Discrete {
    /// Distribution over the indices of `weights`, each finite and not negative.
    ///
    /// `None` when nothing can be chosen: no weights, or all zero.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sum = 0.0;
        let cumulative: Vec<f64> = weights
            .into_iter()
            .map(|w| {
                assert!(
                    w >= 0.0 && w.is_finite(),
                    "weight {w} is not finite and >= 0"
                );
                sum += w;
                sum
            })
            .collect();
        (sum > 0.0).then_some(Self { cumulative })
    }

    /// Sum of all weights.
    pub fn total(&self) -> f64 {
        *self
            .cumulative
            .last()
            .expect("a distribution has at least one weight")
    }

    /// Probability of index `i`.
    pub fn pmf(&self, i: usize) -> f64 {
        let before = if i == 0 { 0.0 } else { self.cumulative[i - 1] };
        (self.cumulative[i] - before) / self.total()
    }

    /// The index that `u` in [0, 1) falls on; never one of zero weight.
    pub fn sample(&self, u: f64) -> usize {
        let target = u * self.total();
        let i = self.cumulative.partition_point(|&c| c <= target);
        if i < self.cumulative.len() {
            return i;
        }
        // u * total rounded up to total: the last index with weight.
        self.cumulative.partition_point(|&c| c < self.total())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_weights_are_never_chosen() {
        let d = Discrete::new([0.0, 1.0, 0.0, 3.0, 0.0]).expect("has weight");
        for u in [0.0, 0.1, 0.25, 0.5, 1.0 - f64::EPSILON / 2.0] {
            assert!(d.pmf(d.sample(u)) > 0.0, "u = {u} chose a zero weight");
        }
        assert_eq!(d.sample(0.2499), 1, "first quarter");
        assert_eq!(d.sample(0.25), 3, "rest");
    }

    #[test]
    fn nothing_to_choose_is_none() {
        assert!(Discrete::new([]).is_none(), "no weights");
        assert!(Discrete::new([0.0, 0.0]).is_none(), "all zero");
    }

    #[test]
    fn tiny_weights_beside_a_huge_sum_keep_their_probability() {
        let n = 1_000_000;
        let d = Discrete::new((0..n).map(|i| if i == 0 { 1e9 } else { 1e-3 })).expect("has weight");
        let expected = 1e-3 / d.total();
        assert!(
            (d.pmf(n - 1) / expected - 1.0).abs() < 1e-3,
            "pmf {} vs {expected}",
            d.pmf(n - 1)
        );
    }
}
