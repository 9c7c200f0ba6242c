//! How radiance gets into a browser: half floats, and the style and scripts that pages with pictures share.

use film::Image;
use half::f16;

/// The style of such pages.
pub const STYLE: &str = include_str!("page/page.css");

/// A script that brings radiance to display values, in the browser.
pub const COLOURS: &str = include_str!("page/colours.js");

/// A picture's radiance in half the bytes.
pub struct HalfFloats {
    /// What the numbers are to be multiplied by.
    pub scale: f32,
    /// Half floats: red, green, blue, pixel by pixel, little-endian.
    pub bytes: Vec<u8>,
}

impl HalfFloats {
    /// The radiance of `image`, to three digits.
    pub fn of(image: &Image) -> Self {
        let scale = Self::scale(image);
        let values = image.pixels.iter().flat_map(|rgb| rgb.to_array());
        let bytes = values
            .flat_map(|value| f16::from_f32(value / scale).to_le_bytes())
            .collect();
        Self { scale, bytes }
    }

    /// A power of two by which radiance is divided, so that the brightest pixel is far inside the half floats' range
    /// and dark ones keep their digits. 1 for a black picture.
    fn scale(image: &Image) -> f32 {
        let brightest = image.pixels.iter().map(|rgb| rgb.abs().max_element());
        let brightest = brightest.fold(0.0, f32::max);
        match brightest > 0.0 {
            true => (brightest / 16_384.0)
                .log2()
                .ceil()
                .clamp(-100.0, 100.0)
                .exp2(),
            false => 1.0,
        }
    }
}

/// `template` with its gaps `{{name}}` filled, in one go: what fills them may hold anything.
pub fn filled(template: &str, value: impl Fn(&str) -> String) -> String {
    let mut parts = template.split("{{");
    let mut page = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (name, rest) = part.split_once("}}").unwrap_or((part, ""));
        page.push_str(&value(name));
        page.push_str(rest);
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_results::image;
    use glam::Vec3;

    #[test]
    fn half_floats_keep_three_digits_of_any_brightness() {
        for brightest in [1e-20_f32, 1e-3, 1.0, 1e6, 1e30] {
            let image = image(brightest);
            let scale = HalfFloats::scale(&image);
            for rgb in &image.pixels {
                let kept = f16::from_f32(rgb.x / scale).to_f32() * scale;
                let error = (kept / rgb.x - 1.0).abs();
                assert!(error < 1e-3, "{} became {kept} at scale {scale}", rgb.x);
            }
        }
        let black = Image {
            pixels: vec![Vec3::ZERO; 576],
            ..image(1.0)
        };
        assert_eq!(HalfFloats::scale(&black), 1.0, "black");
    }
}
