//! Mean and variance on the fly.

/// Running mean and variance in f64; starts empty.
///
/// Source: Welford 1962, Note on a method for calculating corrected sums of squares and products.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Running {
    count: u64,
    mean: f64,
    /// Sum of squared deviations from the mean.
    m2: f64,
}

impl Running {
    /// Takes a value. One that is not finite spoils mean and variance for good, as it should in a test.
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        let before = value - self.mean;
        self.mean += before / self.count as f64;
        self.m2 += before * (value - self.mean);
    }

    /// Values taken.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Their mean; 0 when there are none.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Unbiased estimate of the variance of one value; 0 for fewer than two.
    pub fn variance(&self) -> f64 {
        if self.count < 2 {
            0.0
        } else {
            self.m2 / (self.count - 1) as f64
        }
    }

    /// Estimated variance of the mean, as [`crate::z_test`] wants it; 0 for fewer than two values.
    pub fn variance_of_mean(&self) -> f64 {
        if self.count < 2 {
            0.0
        } else {
            self.variance() / self.count as f64
        }
    }
}

impl Extend<f64> for Running {
    fn extend<T: IntoIterator<Item = f64>>(&mut self, values: T) {
        values.into_iter().for_each(|value| self.add(value));
    }
}

impl FromIterator<f64> for Running {
    fn from_iter<T: IntoIterator<Item = f64>>(values: T) -> Self {
        let mut running = Running::default();
        running.extend(values);
        running
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_samples_give_the_textbook_figures() {
        let running: Running = [2.0, 4.0, 4.0, 6.0].into_iter().collect();
        assert_eq!(running.count(), 4, "count");
        assert_eq!(running.mean(), 4.0, "mean");
        assert_eq!(running.variance(), 8.0 / 3.0, "variance");
        assert_eq!(
            running.variance_of_mean(),
            2.0 / 3.0,
            "variance of the mean"
        );
        assert_eq!(Running::default().variance_of_mean(), 0.0, "nothing");
    }

    #[test]
    fn a_large_offset_does_not_swallow_the_variance() {
        let running: Running = (0..1000).map(|i| 1e9 + f64::from(i % 2)).collect();
        assert!(
            (running.variance() - 0.25 * 1000.0 / 999.0).abs() < 1e-6,
            "{}",
            running.variance()
        );
    }
}
