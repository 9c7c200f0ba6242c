//! Mean and variance of one pixel.

use glam::{DVec3, Vec3};

/// Running mean and variance of one pixel's samples (Welford), RGB, in f64.
///
/// Starts empty. Samples are radiance in W·sr⁻¹·m⁻² and may be negative or of any finite size. The
/// state depends on the order of the samples in the last bits only, and is the same for the same order.
///
/// Source: Welford 1962, Note on a method for calculating corrected sums of squares and products.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelStats {
    count: u32,
    mean: DVec3,
    /// Sum of squared deviations from the mean.
    m2: DVec3,
}

impl PixelStats {
    /// Length of [`PixelStats::to_bytes`].
    pub const BYTES: usize = 4 + 6 * 8;

    /// Takes a sample. One that is not finite in every channel counts for nothing: the return value is
    /// then `false`, and the caller counts refusals.
    #[must_use = "a refused sample has to be counted"]
    pub fn add(&mut self, sample: Vec3) -> bool {
        if !sample.is_finite() {
            return false;
        }
        debug_assert!(self.count < u32::MAX, "too many samples for one pixel");
        self.count += 1;
        let sample = sample.as_dvec3();
        let before = sample - self.mean;
        self.mean += before / f64::from(self.count);
        self.m2 += before * (sample - self.mean);
        true
    }

    /// Samples taken, refused ones not among them.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Mean of the samples; zero when there are none.
    pub fn mean(&self) -> Vec3 {
        self.mean.as_vec3()
    }

    /// The mean before it is rounded to f32.
    pub fn mean_f64(&self) -> DVec3 {
        self.mean
    }

    /// Estimated variance of the mean: the unbiased sample variance over the number of samples, ≥ 0.
    ///
    /// Zero for fewer than two samples, which is no estimate. A value beyond f32 becomes `f32::MAX`.
    pub fn variance_of_mean(&self) -> Vec3 {
        if self.count < 2 {
            return Vec3::ZERO;
        }
        let n = f64::from(self.count);
        (self.m2 / (n * (n - 1.0)))
            .min(DVec3::splat(f64::from(f32::MAX)))
            .as_vec3()
    }

    /// The whole state, to go on from later with [`PixelStats::from_bytes`] as if nothing had happened.
    pub fn to_bytes(&self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        bytes[..4].copy_from_slice(&self.count.to_le_bytes());
        let values = self.mean.to_array().into_iter().chain(self.m2.to_array());
        for (target, value) in bytes[4..].chunks_exact_mut(8).zip(values) {
            target.copy_from_slice(&value.to_le_bytes());
        }
        bytes
    }

    /// The state that [`PixelStats::to_bytes`] gave; `None` for bytes that cannot be one (non-finite
    /// values, negative squares).
    pub fn from_bytes(bytes: &[u8; Self::BYTES]) -> Option<Self> {
        let (count, values) = bytes.split_first_chunk()?;
        let (values, _) = values.as_chunks();
        let value = |i: usize| f64::from_le_bytes(values[i]);
        let stats = PixelStats {
            count: u32::from_le_bytes(*count),
            mean: DVec3::new(value(0), value(1), value(2)),
            m2: DVec3::new(value(3), value(4), value(5)),
        };
        let sound = stats.mean.is_finite()
            && stats.m2.is_finite()
            && stats.m2.min_element() >= 0.0
            && (stats.count > 0 || stats == PixelStats::default());
        sound.then_some(stats)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(samples: &[Vec3]) -> PixelStats {
        let mut stats = PixelStats::default();
        for &sample in samples {
            assert!(stats.add(sample), "{sample} is finite");
        }
        stats
    }

    /// Mean and variance of the mean, in two passes.
    fn two_pass(samples: &[Vec3]) -> (DVec3, DVec3) {
        let n = samples.len() as f64;
        let mean = samples.iter().map(|s| s.as_dvec3()).sum::<DVec3>() / n;
        let squares = samples
            .iter()
            .map(|s| (s.as_dvec3() - mean) * (s.as_dvec3() - mean))
            .sum::<DVec3>();
        (mean, squares / (n * (n - 1.0)))
    }

    #[test]
    fn small_samples_give_the_textbook_mean_and_variance() {
        let stats = of(&[Vec3::new(1.0, 0.0, 4.0), Vec3::new(3.0, 0.0, -4.0)]);
        assert_eq!(stats.count(), 2, "count");
        assert_eq!(stats.mean(), Vec3::new(2.0, 0.0, 0.0), "mean");
        assert_eq!(
            stats.variance_of_mean(),
            Vec3::new(1.0, 0.0, 16.0),
            "variance of the mean"
        );
    }

    #[test]
    fn few_samples_have_no_variance() {
        assert_eq!(of(&[]).mean(), Vec3::ZERO, "mean of nothing");
        assert_eq!(
            of(&[]).variance_of_mean(),
            Vec3::ZERO,
            "variance of nothing"
        );
        assert_eq!(
            of(&[Vec3::ONE]).variance_of_mean(),
            Vec3::ZERO,
            "variance of one"
        );
    }

    #[test]
    fn a_large_offset_does_not_swallow_the_variance() {
        // A textbook sum of squares in f32, and even in f64 at a larger offset, loses these.
        let samples: Vec<Vec3> = (0..4096_u16)
            .map(|i| Vec3::new(1e8 + 8.0 * f32::from(i % 7), 3.0, f32::from(i % 2)))
            .collect();
        let stats = of(&samples);
        let (mean, variance) = two_pass(&samples);
        assert!(
            (stats.mean.x / mean.x - 1.0).abs() < 1e-14,
            "{} against {}",
            stats.mean.x,
            mean.x
        );
        let got = stats.variance_of_mean().as_dvec3();
        assert!(
            (got.x / variance.x - 1.0).abs() < 1e-6,
            "{} against {}",
            got.x,
            variance.x
        );
        assert_eq!(got.y, 0.0, "equal samples have no variance");
    }

    #[test]
    fn any_samples_agree_with_two_passes() {
        verify::property(1000, |u| {
            let count = u.int_in_range(2..=40)?;
            let offset = [0.0, 1.0, 1e8, -1e8][u.int_in_range(0..=3)?];
            let mut samples = Vec::new();
            for _ in 0..count {
                let mut one = || -> verify::arbitrary::Result<f32> {
                    Ok(offset + f32::from(u.arbitrary::<i16>()?))
                };
                samples.push(Vec3::new(one()?, one()?, one()?));
            }
            let stats = of(&samples);
            let (mean, variance) = two_pass(&samples);
            let error = (stats.mean - mean).abs().max_element();
            assert!(
                error <= 1e-12 * mean.abs().max_element().max(1.0),
                "mean: {error}"
            );
            let error = (stats.variance_of_mean().as_dvec3() - variance)
                .abs()
                .max_element();
            assert!(
                error <= 1e-6 * variance.max_element().max(1e-3),
                "variance: {error}"
            );
            Ok(())
        });
    }

    #[test]
    fn samples_that_are_not_finite_are_refused_and_change_nothing() {
        let mut stats = of(&[Vec3::ONE, Vec3::new(2.0, 3.0, 4.0)]);
        let before = stats;
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for channel in 0..3 {
                let mut sample = Vec3::ONE;
                sample[channel] = bad;
                assert!(!stats.add(sample), "{sample} is refused");
            }
        }
        assert_eq!(stats, before, "nothing changed");
    }

    #[test]
    fn the_largest_samples_stay_finite() {
        let stats = of(&[Vec3::MAX, Vec3::MIN, Vec3::MAX, Vec3::MIN]);
        assert!(
            stats.mean().is_finite() && stats.variance_of_mean().is_finite(),
            "{stats:?}"
        );
    }

    #[test]
    fn the_state_survives_its_bytes_and_goes_on_alike() {
        let mut one = of(&[Vec3::new(0.1, 0.2, 0.3), Vec3::new(1e8, 2.0, -3.0)]);
        let mut other = PixelStats::from_bytes(&one.to_bytes()).expect("sound bytes");
        assert!(one.add(Vec3::ONE) && other.add(Vec3::ONE), "finite");
        assert_eq!(one.to_bytes(), other.to_bytes(), "same bits");
    }

    #[test]
    fn bytes_that_are_no_state_are_refused() {
        let mut bytes = of(&[Vec3::ONE]).to_bytes();
        bytes[4..12].copy_from_slice(&f64::NAN.to_le_bytes());
        assert!(PixelStats::from_bytes(&bytes).is_none(), "NaN mean");
        let mut bytes = of(&[Vec3::ONE]).to_bytes();
        bytes[28..36].copy_from_slice(&(-1.0_f64).to_le_bytes());
        assert!(PixelStats::from_bytes(&bytes).is_none(), "negative squares");
    }
}
