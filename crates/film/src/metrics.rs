//! How far an image is from its reference, in single figures.

use glam::{DVec3, Vec3};

use crate::{FilmError, Image, PIXELS_PER_DEGREE, flip_map};

/// Share of the reference's squared mean (or of its mean, for `mape`) that keeps relative errors of dark
/// pixels finite.
const DARK: f64 = 0.01;

/// Errors of an image x against a reference r. Means are over all pixels and channels, sums in f64;
/// m is the mean of the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metrics {
    /// Mean of (x − r)².
    pub mse: f64,
    /// Square root of `mse`.
    pub rmse: f64,
    /// Mean of (x − r)² / (r² + 0.01·m²). Terms 0/0 are 0, so that black matches black; any other image
    /// against a black reference gives infinity.
    pub relmse: f64,
    /// Mean of |x − r| / (|r| + 0.01·|m|), a fraction (0.1 is ten per cent). 0/0 is 0 here as well.
    pub mape: f64,
    /// 10·log₁₀(p² / mse) in dB, the peak p being the largest channel value of the reference. Infinity for
    /// equal images, minus infinity for a reference without positive values.
    pub psnr: f64,
    /// Mean HDR-FLIP, 0 (no difference can be seen) to 1; see [`flip_map`]. `None` where it was not asked for.
    pub flip: Option<f64>,
    /// Mean of the image over m: 1 when no energy is lost or gained. Two means of zero give 1, a zero m
    /// alone an infinity.
    pub mean_ratio: f64,
}

impl Metrics {
    /// Names and values in the order in which they are reported; `flip` only where there is one.
    ///
    /// Values may be infinite (see the fields), never NaN. JSON has no infinity.
    pub fn fields(&self) -> Vec<(&'static str, f64)> {
        let mut fields = vec![
            ("mse", self.mse),
            ("rmse", self.rmse),
            ("relmse", self.relmse),
            ("mape", self.mape),
            ("psnr", self.psnr),
        ];
        fields.extend(self.flip.map(|flip| ("flip", flip)));
        fields.push(("mean_ratio", self.mean_ratio));
        fields
    }
}

/// All error figures of `image` against `reference`.
///
/// # Errors
///
/// The sizes differ, there is no pixel, or a pixel of either is not finite.
pub fn compare(image: &Image, reference: &Image) -> Result<Metrics, FilmError> {
    let metrics = compare_without_flip(image, reference)?;
    let map = flip_map(image, reference, PIXELS_PER_DEGREE)?;
    let flip = map.iter().map(|&value| f64::from(value)).sum::<f64>() / map.len() as f64;
    Ok(Metrics {
        flip: Some(flip),
        ..metrics
    })
}

/// What [`compare`] gives, without FLIP, which costs some hundred times more than all others together.
///
/// # Errors
///
/// Those of [`compare`].
pub fn compare_without_flip(image: &Image, reference: &Image) -> Result<Metrics, FilmError> {
    check(image, reference)?;
    let values = 3.0 * image.pixels.len() as f64;
    let mean = |image: &Image| {
        image
            .pixels
            .iter()
            .map(|rgb| rgb.as_dvec3())
            .sum::<DVec3>()
            .element_sum()
            / values
    };
    let (image_mean, reference_mean) = (mean(image), mean(reference));
    let dark2 = DARK * reference_mean * reference_mean;
    let dark = DARK * reference_mean.abs();

    let (mut squares, mut relative_squares, mut relative) = (0.0, 0.0, 0.0);
    let mut peak = f64::NEG_INFINITY;
    for (x, r) in image.pixels.iter().zip(&reference.pixels) {
        for (x, r) in x.to_array().into_iter().zip(r.to_array()) {
            let (x, r) = (f64::from(x), f64::from(r));
            let error2 = (x - r) * (x - r);
            squares += error2;
            relative_squares += ratio_or_zero(error2, r * r + dark2);
            relative += ratio_or_zero((x - r).abs(), r.abs() + dark);
            peak = peak.max(r);
        }
    }
    let mse = squares / values;
    Ok(Metrics {
        mse,
        rmse: mse.sqrt(),
        relmse: relative_squares / values,
        mape: relative / values,
        psnr: if mse == 0.0 {
            f64::INFINITY
        } else {
            10.0 * (peak.max(0.0).powi(2) / mse).log10()
        },
        flip: None,
        mean_ratio: if image_mean == reference_mean {
            1.0
        } else {
            image_mean / reference_mean
        },
    })
}

/// What `relmse` divides by: r² + 0.01·m² of each pixel and channel, m being the mean over both.
pub(crate) fn relative_scales(reference: &[DVec3]) -> Vec<DVec3> {
    let values = 3.0 * reference.len().max(1) as f64;
    let mean = reference.iter().sum::<DVec3>().element_sum() / values;
    let dark2 = DVec3::splat(DARK * mean * mean);
    reference.iter().map(|r| r * r + dark2).collect()
}

/// `error / scale`, with 0/0 = 0. Both are ≥ 0.
pub(crate) fn ratio_or_zero(error: f64, scale: f64) -> f64 {
    if error == 0.0 { 0.0 } else { error / scale }
}

/// Refuses what cannot be compared.
pub(crate) fn check(image: &Image, reference: &Image) -> Result<(), FilmError> {
    if (image.width, image.height) != (reference.width, reference.height) {
        return Err(FilmError::Size {
            name: "the image".into(),
            width: image.width,
            height: image.height,
            other: "the reference".into(),
            expected_width: reference.width,
            expected_height: reference.height,
        });
    }
    if image.pixels.is_empty() {
        return Err(FilmError::Empty {
            name: "the image".into(),
            width: image.width,
            height: image.height,
        });
    }
    for (which, image) in [("image", image), ("reference", reference)] {
        assert_eq!(
            image.pixels.len(),
            image.width as usize * image.height as usize,
            "pixels of the {which} of {}x{}",
            image.width,
            image.height
        );
        let bad = |(_, rgb): &(usize, &Vec3)| !rgb.is_finite();
        let mut found = image.pixels.iter().enumerate().filter(bad);
        if let Some((i, &value)) = found.next() {
            return Err(FilmError::NonFinite {
                which,
                count: 1 + found.count(),
                x: (i % image.width as usize) as u32,
                y: (i / image.width as usize) as u32,
                value,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, height: u32, pixels: Vec<Vec3>) -> Image {
        Image {
            width,
            height,
            pixels,
        }
    }

    fn near(got: f64, expected: f64) -> bool {
        (got - expected).abs() <= 1e-12 * expected.abs()
    }

    #[test]
    fn four_pixels_give_the_figures_done_by_hand() {
        // Greys, so that channels do not matter: r = 1, 2, 0, 1 (m = 1), x = 1.5, 2, 0.1, 0.
        let grey = |values: [f32; 4]| image(2, 2, values.map(Vec3::splat).into());
        let metrics = compare(&grey([1.5, 2.0, 0.125, 0.0]), &grey([1.0, 2.0, 0.0, 1.0]))
            .expect("comparable");
        let mse = (0.25 + 0.015625 + 1.0) / 4.0;
        assert!(near(metrics.mse, mse), "mse {}", metrics.mse);
        assert!(near(metrics.rmse, mse.sqrt()), "rmse {}", metrics.rmse);
        let relmse = (0.25 / 1.01 + 0.015625 / 0.01 + 1.0 / 1.01) / 4.0;
        assert!(near(metrics.relmse, relmse), "relmse {}", metrics.relmse);
        let mape = (0.5 / 1.01 + 0.125 / 0.01 + 1.0 / 1.01) / 4.0;
        assert!(near(metrics.mape, mape), "mape {}", metrics.mape);
        assert!(
            near(metrics.psnr, 10.0 * (4.0 / mse).log10()),
            "psnr {}",
            metrics.psnr
        );
        assert!(
            near(metrics.mean_ratio, 3.625 / 4.0),
            "mean_ratio {}",
            metrics.mean_ratio
        );
        let flip = metrics.flip.expect("asked for");
        assert!((0.0..=1.0).contains(&flip) && flip > 0.1, "flip {flip}");
        let names: Vec<&str> = metrics.fields().iter().map(|field| field.0).collect();
        assert_eq!(
            names,
            [
                "mse",
                "rmse",
                "relmse",
                "mape",
                "psnr",
                "flip",
                "mean_ratio"
            ],
            "names"
        );
    }

    #[test]
    fn channels_are_averaged_like_pixels() {
        let one = image(1, 1, vec![Vec3::new(1.0, 2.0, 3.0)]);
        let reference = image(1, 1, vec![Vec3::new(0.0, 2.0, 4.0)]);
        let metrics = compare_without_flip(&one, &reference).expect("comparable");
        assert!(near(metrics.mse, 2.0 / 3.0), "mse {}", metrics.mse);
        assert!(
            near(metrics.relmse, (1.0 / 0.04 + 1.0 / 16.04) / 3.0),
            "relmse {}",
            metrics.relmse
        );
        assert!(
            metrics.flip.is_none() && metrics.fields().len() == 6,
            "no flip"
        );
    }

    #[test]
    fn equal_images_have_no_error() {
        let one = image(
            3,
            1,
            vec![Vec3::new(0.0, 5.0, -1.0), Vec3::ZERO, Vec3::splat(1e30)],
        );
        let metrics = compare(&one, &one).expect("comparable");
        assert_eq!(
            (metrics.mse, metrics.relmse, metrics.mape, metrics.flip),
            (0.0, 0.0, 0.0, Some(0.0)),
            "errors"
        );
        assert_eq!(
            (metrics.psnr, metrics.mean_ratio),
            (f64::INFINITY, 1.0),
            "psnr, mean_ratio"
        );
    }

    #[test]
    fn a_black_reference_gives_zeros_or_infinities_but_no_nan() {
        let black = image(2, 1, vec![Vec3::ZERO; 2]);
        let metrics = compare(&black, &black).expect("comparable");
        assert_eq!(
            (
                metrics.relmse,
                metrics.mape,
                metrics.mean_ratio,
                metrics.flip
            ),
            (0.0, 0.0, 1.0, Some(0.0)),
            "black"
        );
        let lit = image(2, 1, vec![Vec3::ONE, Vec3::ZERO]);
        let metrics = compare(&lit, &black).expect("comparable");
        assert_eq!(
            (metrics.relmse, metrics.mean_ratio),
            (f64::INFINITY, f64::INFINITY),
            "lit"
        );
        assert_eq!(metrics.psnr, f64::NEG_INFINITY, "psnr");
        assert!(
            metrics.fields().iter().all(|(_, value)| !value.is_nan()),
            "{metrics:?}"
        );
    }

    #[test]
    fn what_cannot_be_compared_is_refused_and_says_where() {
        let good = image(2, 2, vec![Vec3::ONE; 4]);
        let error = compare(&image(4, 1, vec![Vec3::ONE; 4]), &good).expect_err("sizes differ");
        assert_eq!(
            error.to_string(),
            "the image is 4x1; expected 2x2 as the reference",
            "message"
        );
        let mut bad = good.clone();
        bad.pixels[3].y = f32::NAN;
        bad.pixels[1].x = f32::INFINITY;
        let error = compare(&bad, &good).expect_err("not finite").to_string();
        assert!(
            error.starts_with(
                "the image has 2 non-finite pixels, the first at x=1, y=0: [inf, 1, 1]"
            ),
            "{error}"
        );
        let error = compare(&good, &bad).expect_err("not finite").to_string();
        assert!(error.starts_with("the reference has"), "{error}");
        let none = image(0, 0, vec![]);
        assert!(compare(&none, &none).is_err(), "no pixel");
    }

    #[test]
    fn scaling_both_images_changes_only_absolute_errors() {
        verify::property(1000, |u| {
            let mut value =
                || -> verify::arbitrary::Result<f32> { Ok(f32::from(u.arbitrary::<u8>()?) / 16.0) };
            let mut pixels = || -> verify::arbitrary::Result<Vec<Vec3>> {
                (0..4)
                    .map(|_| Ok(Vec3::new(value()?, value()?, value()?)))
                    .collect()
            };
            let (one, reference) = (image(2, 2, pixels()?), image(2, 2, pixels()?));
            let scaled = |image: &Image| Image {
                pixels: image.pixels.iter().map(|&p| p * 64.0).collect(),
                ..image.clone()
            };
            let a = compare_without_flip(&one, &reference).expect("comparable");
            let b = compare_without_flip(&scaled(&one), &scaled(&reference)).expect("comparable");
            assert_eq!(a.mse * 4096.0, b.mse, "mse");
            assert!(
                (a.relmse, a.mape, a.mean_ratio) == (b.relmse, b.mape, b.mean_ratio),
                "{a:?} against {b:?}"
            );
            Ok(())
        });
    }
}
