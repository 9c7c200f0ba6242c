//! Which part of an error is noise and which is not, judged by the pictures' own variances.

use glam::{DVec3, Vec3};

use crate::{
    FilmError, Image, Picture, metrics::check, metrics::ratio_or_zero, metrics::relative_scales,
};

/// An estimate with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The estimate.
    pub estimate: f64,
    /// Half the interval's width, ≥ 0: the truth lies within `estimate ± half_width` in 95 cases of 100.
    pub half_width: f64,
}

/// Standard errors to either side of the mean that hold 95 % of a normal distribution.
const NORMAL_95: f64 = 1.959_964;

impl Interval {
    /// The interval of an estimate with a standard error, both finite.
    pub fn normal(estimate: f64, standard_error: f64) -> Self {
        Self {
            estimate,
            half_width: NORMAL_95 * standard_error,
        }
    }

    /// Whether 0 is not among the values that the estimate allows.
    pub fn excludes_zero(&self) -> bool {
        self.estimate.abs() > self.half_width
    }
}

/// How far a picture's expected value is from the reference's.
///
/// Both figures take the pixels' errors as independent of one another and the pictures' variances as those of
/// their means. Where samples of a pixel depend on one another (multidimensional lightcuts, stratified
/// choices), the variances are too large or too small, and the intervals are a guide only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bias {
    /// Mean of the picture over mean of the reference, less 1: energy gained or lost.
    pub mean: Interval,
    /// Mean of ((x − r)² − Var x − Var r) / (r² + 0.01·m²): `relmse` without its noise. It sees errors that
    /// cancel in the mean, such as stripes. The estimate may fall below 0 by chance.
    pub local: Interval,
}

impl Bias {
    /// The bias of `picture`; `None` when some pixel of either has fewer than two samples, so that nothing is
    /// known of its variance, or the reference's mean is not above 0.
    ///
    /// # Errors
    ///
    /// The sizes differ, there is no pixel, or a pixel is not finite.
    pub fn of(picture: &Picture, reference: &Picture) -> Result<Option<Self>, FilmError> {
        let (x, r) = (picture.image(), reference.image());
        check(&x, &r)?;
        let known = |picture: &Picture| picture.samples.iter().all(|&n| n >= 2);
        let pixels = r.pixels.len() as f64;
        let total = |image: &Image| {
            let sum: DVec3 = image.pixels_f64().iter().sum();
            sum.element_sum() / (3.0 * pixels)
        };
        let mean = total(&r);
        if !known(picture) || !known(reference) || mean <= 0.0 {
            return Ok(None);
        }
        let scales = relative_scales(&r.pixels_f64());
        let (mut variance, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for (i, &scale) in scales.iter().enumerate() {
            let of = |picture: &Picture| picture.variance[i].as_dvec3();
            // The channels of a pixel share their samples: taken as one, their deviations add up.
            let deviation = |variance: DVec3| {
                let root = DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt());
                root.element_sum() / 3.0
            };
            variance += deviation(of(picture)).powi(2) + deviation(of(reference)).powi(2);
            let difference = x.pixels[i].as_dvec3() - r.pixels[i].as_dvec3();
            let excess = difference * difference - of(picture) - of(reference);
            // The mean is above 0, and so are the scales.
            let local = (excess / scale).element_sum() / 3.0;
            sum += local;
            squares += local * local;
        }
        let local = sum / pixels;
        let spread = (squares / pixels - local * local).max(0.0);
        Ok(Some(Self {
            mean: Interval::normal(total(&x) / mean - 1.0, variance.sqrt() / pixels / mean),
            local: Interval::normal(local, (spread / pixels).sqrt()),
        }))
    }
}

/// The `relmse` that noise alone gives a picture: the mean of Var r / (r² + 0.01·m²), from its own variances.
///
/// Its square root is a relative standard error. `None` when some pixel has fewer than two samples; 0 for a
/// black picture.
pub fn relative_variance(picture: &Picture) -> Option<f64> {
    if picture.samples.iter().any(|&n| n < 2) {
        return None;
    }
    let scales = relative_scales(&picture.image().pixels_f64());
    let ratio = |(variance, scale): (&Vec3, &DVec3)| {
        let variance = variance.as_dvec3();
        (0..3)
            .map(|c| ratio_or_zero(variance[c], scale[c]))
            .sum::<f64>()
    };
    let sum: f64 = picture.variance.iter().zip(&scales).map(ratio).sum();
    Some(sum / (3.0 * scales.len().max(1) as f64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PixelStats;

    /// Noise of zero mean, uniform in ±1: a small multiplicative generator is enough for a test.
    fn noise(state: &mut u64) -> f32 {
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*state >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }

    /// 64 × 64 pixels of mean 1 and noise, plus what `error` says of each column.
    fn picture(seed: u64, samples: u32, error: fn(usize) -> f32) -> Picture {
        let mut picture = Picture::new(64, 64);
        let mut state = seed;
        for i in 0..picture.radiance.len() {
            let mut stats = PixelStats::default();
            for _ in 0..samples {
                let value = 1.0 + error(i % 64) + noise(&mut state);
                assert!(stats.add(Vec3::splat(value)), "finite");
            }
            picture.radiance[i] = stats.mean();
            picture.variance[i] = stats.variance_of_mean();
            picture.samples[i] = samples;
        }
        picture
    }

    fn bias(picture: &Picture, reference: &Picture) -> Bias {
        let found = Bias::of(picture, reference).expect("comparable");
        found.expect("enough samples")
    }

    #[test]
    fn noise_alone_is_no_bias() {
        // Two figures of 20 pairs at 95 %: more than 8 of 40 outside has a probability below 10⁻⁴ by
        // chance; the seeds are fixed.
        let reference = picture(1, 64, |_| 0.0);
        let outside = |pick: fn(&Bias) -> Interval| {
            let seeds = 2..22;
            seeds
                .filter(|&seed| pick(&bias(&picture(seed, 4, |_| 0.0), &reference)).excludes_zero())
                .count()
        };
        assert!(
            outside(|b| b.mean) + outside(|b| b.local) <= 8,
            "bias in noise"
        );
    }

    #[test]
    fn lost_energy_is_seen_and_measured() {
        let found = bias(&picture(2, 16, |_| -0.1), &picture(1, 64, |_| 0.0)).mean;
        assert!(found.excludes_zero(), "{found:?}");
        let error = (found.estimate + 0.1).abs();
        assert!(error < 2.0 * found.half_width, "{found:?} is not -0.1");
    }

    #[test]
    fn stripes_that_cancel_are_local_bias_only() {
        let stripes = |column: usize| [0.2, -0.2][column % 2];
        let found = bias(&picture(3, 16, stripes), &picture(1, 64, |_| 0.0));
        assert!(!found.mean.excludes_zero(), "{found:?}");
        // 0.2² over 1.01.
        let error = (found.local.estimate - 0.04 / 1.01).abs();
        assert!(
            found.local.excludes_zero() && error < 2.0 * found.local.half_width,
            "{found:?}"
        );
    }

    #[test]
    fn relative_variance_is_the_relmse_that_noise_gives() {
        let (one, other) = (picture(4, 16, |_| 0.0), picture(5, 16, |_| 0.0));
        let expected = 2.0 * relative_variance(&one).expect("samples");
        let found = crate::compare_without_flip(&one.image(), &other.image());
        let found = found.expect("comparable").relmse;
        assert!((found / expected - 1.0).abs() < 0.1, "{found} {expected}");
    }

    #[test]
    fn one_sample_says_nothing_of_variance_and_black_has_no_relative_bias() {
        let reference = picture(1, 4, |_| 0.0);
        let found = Bias::of(&picture(2, 1, |_| 0.0), &reference);
        assert_eq!(found.expect("comparable"), None, "one sample");
        assert_eq!(relative_variance(&picture(2, 1, |_| 0.0)), None, "one");
        let mut black = Picture::new(64, 64);
        black.samples.fill(2);
        let found = Bias::of(&black, &black).expect("comparable");
        assert_eq!(found, None, "black");
        assert_eq!(relative_variance(&black), Some(0.0), "black");
        assert!(Bias::of(&Picture::new(1, 1), &reference).is_err(), "sizes");
    }
}
