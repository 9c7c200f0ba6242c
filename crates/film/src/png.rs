//! From radiance to something to look at: exposure, tone curve, sRGB, PNG.

use std::{io, path::Path};

use ::image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use glam::Vec3;

use crate::{FilmError, Image, write_atomically};

/// How bright a tone-mapped picture becomes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// What [`auto_exposure`] says of the picture.
    #[default]
    Auto,
    /// Radiance is multiplied by this factor before the tone curve. Expected finite and > 0.
    Fixed(f32),
}

/// The typical luminance of a picture is exposed to this: photography's middle grey.
const KEY: f64 = 0.18;
/// Exposed radiance that becomes pure white, about seven stops above middle grey.
const WHITE: f32 = 16.0;
/// Share of the darkest, and of the brightest, lit pixels that have no say in the exposure.
const TRIM: f64 = 0.05;

/// Luminance of linear sRGB (Rec. 709 weights), in the unit of the colour.
pub(crate) fn luminance(rgb: Vec3) -> f64 {
    0.2126 * f64::from(rgb.x) + 0.7152 * f64::from(rgb.y) + 0.0722 * f64::from(rgb.z)
}

/// The factor that brings a picture's typical luminance to middle grey (0.18).
///
/// Typical is the geometric mean of the luminances after the lowest and highest 5 % are put aside, which
/// keeps fireflies and nearly black corners from having a say. Pixels that are black, negative or non-finite
/// do not count at all; where no other is, the factor is 1. Always finite and > 0.
///
/// After the log-average luminance of Reinhard et al. 2002, Photographic tone reproduction for digital images.
pub fn auto_exposure(pixels: &[Vec3]) -> f32 {
    let mut logs: Vec<f64> = pixels
        .iter()
        .map(|&rgb| luminance(rgb))
        .filter(|&luminance| luminance.is_finite() && luminance > 0.0)
        .map(f64::log2)
        .collect();
    if logs.is_empty() {
        return 1.0;
    }
    logs.sort_unstable_by(f64::total_cmp);
    let aside = (logs.len() as f64 * TRIM) as usize;
    let kept = &logs[aside..logs.len() - aside];
    let typical = (kept.iter().sum::<f64>() / kept.len() as f64).exp2();
    (KEY / typical).clamp(f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX)) as f32
}

/// Display values, 0 to 255, sRGB-encoded, of linear RGB `pixels` times `exposure`.
///
/// The curve, for each channel c after exposure, is Reinhard's with a white point, c·(1 + c/w²)/(1 + c), w = 16:
/// close to linear in the shadows of an interior, with lamps and windows rolled off towards white. Negative
/// values and NaN become 0, positive infinity 255.
///
/// Source: Reinhard et al. 2002, equation 4; IEC 61966-2-1 for sRGB.
pub fn tone_map(pixels: &[Vec3], exposure: f32) -> Vec<u8> {
    pixels
        .iter()
        .flat_map(|rgb| rgb.to_array())
        .map(|value| display(value * exposure))
        .collect()
}

/// One channel, exposed, as a display value.
fn display(c: f32) -> u8 {
    if c.is_nan() {
        return 0;
    }
    (srgb_encode(curve(c)) * 255.0 + 0.5) as u8
}

/// The tone curve of [`tone_map`]: exposed radiance, not NaN, → linear display value, 0 to 1.
pub(crate) fn curve(c: f32) -> f32 {
    let c = c.clamp(0.0, WHITE); // beyond the white point the curve leaves [0, 1]
    c * (1.0 + c / (WHITE * WHITE)) / (1.0 + c)
}

/// sRGB's transfer function: linear 0 to 1 → encoded 0 to 1.
fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

pub(crate) fn write_pixels(
    path: &Path,
    width: u32,
    height: u32,
    pixels: &[Vec3],
    exposure: Exposure,
) -> Result<(), FilmError> {
    let exposure = match exposure {
        Exposure::Auto => auto_exposure(pixels),
        Exposure::Fixed(factor) => factor,
    };
    write_rgb8(path, width, height, &tone_map(pixels, exposure))
}

impl Image {
    /// Writes the pixels, tone-mapped, as an 8-bit sRGB PNG, atomically; see [`tone_map`].
    ///
    /// # Errors
    ///
    /// Names the file when it cannot be written or the picture has no pixel.
    pub fn write_png(&self, path: &Path, exposure: Exposure) -> Result<(), FilmError> {
        write_pixels(path, self.width, self.height, &self.pixels, exposure)
    }
}

/// Writes display values (three bytes a pixel, row 0 at the top) as a PNG, atomically.
///
/// # Errors
///
/// Names the file when it cannot be written or there is no pixel.
///
/// # Panics
///
/// When there are not `3 · width · height` values.
pub fn write_rgb8(path: &Path, width: u32, height: u32, values: &[u8]) -> Result<(), FilmError> {
    assert_eq!(
        values.len(),
        3 * width as usize * height as usize,
        "values of a picture of {width}x{height}"
    );
    if values.is_empty() {
        return Err(FilmError::Empty {
            name: path.display().to_string(),
            width,
            height,
        });
    }
    write_atomically(path, |file| {
        PngEncoder::new(file)
            .write_image(values, width, height, ExtendedColorType::Rgb8)
            .map_err(|error| match error {
                ::image::ImageError::IoError(error) => error,
                other => io::Error::other(other),
            })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grey_picture_is_exposed_to_middle_grey() {
        for grey in [1e-6, 0.18, 3.0, 1e9] {
            let exposure = auto_exposure(&[Vec3::splat(grey); 9]);
            assert!(
                (exposure * grey / 0.18 - 1.0).abs() < 1e-5,
                "{grey}: {exposure}"
            );
        }
    }

    #[test]
    fn fireflies_black_and_nan_do_not_change_the_exposure() {
        let plain = vec![Vec3::splat(2.0); 1000];
        let mut odd = plain.clone();
        for i in 0..10 {
            odd[i] = Vec3::splat(1e20);
            odd[100 + i] = Vec3::splat(1e-20);
            odd[200 + i] = Vec3::NAN;
            odd[300 + i] = Vec3::INFINITY;
            odd[400 + i] = Vec3::NEG_ONE;
            odd[500 + i] = Vec3::ZERO;
        }
        assert_eq!(auto_exposure(&plain), auto_exposure(&odd), "exposure");
    }

    #[test]
    fn pictures_without_light_have_exposure_one() {
        assert_eq!(auto_exposure(&[]), 1.0, "nothing");
        assert_eq!(auto_exposure(&[Vec3::ZERO; 4]), 1.0, "black");
        assert_eq!(auto_exposure(&[Vec3::NAN; 4]), 1.0, "NaN");
        for extreme in [f32::MIN_POSITIVE / 1e6, f32::MAX] {
            let exposure = auto_exposure(&[Vec3::splat(extreme)]);
            assert!(
                exposure.is_finite() && exposure > 0.0,
                "{extreme}: {exposure}"
            );
        }
    }

    #[test]
    fn the_curve_rises_from_black_to_white() {
        assert_eq!(
            tone_map(&[Vec3::new(f32::NAN, -1.0, 0.0)], 1.0),
            [0, 0, 0],
            "black"
        );
        assert_eq!(
            tone_map(&[Vec3::new(f32::INFINITY, f32::MAX, WHITE)], 1.0),
            [255, 255, 255],
            "white"
        );
        // 0.18 → 0.18·(1 + 0.18/256)/1.18 = 0.15265, whose sRGB encoding is 0.42794: 109.
        assert_eq!(
            tone_map(&[Vec3::splat(0.18)], 1.0),
            [109, 109, 109],
            "middle grey"
        );
        let values: Vec<u8> = (0..2000_u16)
            .map(|i| display(f32::from(i) * 0.01))
            .collect();
        assert!(values.is_sorted(), "{values:?}");
    }

    #[test]
    fn a_png_reads_back_as_the_tone_mapped_values() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a.png");
        let pixels: Vec<Vec3> = (0..6_u8)
            .map(|i| Vec3::new(f32::from(i), 0.1, 1.0 / f32::from(i + 1)))
            .collect();
        let image = Image {
            width: 3,
            height: 2,
            pixels,
        };
        image
            .write_png(&path, Exposure::Fixed(0.5))
            .expect("writes");
        let read = ::image::open(&path).expect("reads").into_rgb8();
        assert_eq!(read.dimensions(), (3, 2), "size");
        assert_eq!(read.into_raw(), tone_map(&image.pixels, 0.5), "values");
    }
}
