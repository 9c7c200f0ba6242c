//! Pictures of environments: EXR, Radiance HDR, PNG and JPEG.

use std::io::Cursor;

use glam::Vec3;
use image::ImageFormat;

use crate::load::decode::{Decoded, claimed_texels, decode};
use crate::load::{SceneText, unreadable};
use crate::{Environment, SceneError};

/// Bytes a decoder may use: 16384 × 8192 texels of three floats.
const MOST_BYTES: u64 = 3 << 29;

/// Bytes a texel at once: decoded, as three floats, and with its running sum. What a file has of more than three channels
/// is gone by then.
const TEXEL: u64 = 40;

/// The environment in `file`, which `field` of the scene names, with its radiance times `scale`; `None` when it is
/// black.
pub(super) fn load(
    scene: &SceneText<'_>,
    field: &str,
    file: &str,
    scale: f32,
) -> Result<Option<Environment>, SceneError> {
    let (source, name) = scene.resolve(field, file)?;
    let bytes = source.read(&name);
    let bytes = bytes.map_err(|e| scene.error(field, unreadable(&source, &name, &e)))?;
    let shown = source.shown(&name);
    let texels = claimed_texels(Cursor::new(&bytes)).unwrap_or(0);
    (scene.fits)(texels * TEXEL)
        .map_err(|message| scene.error(field, format!("{shown} needs {message}")))?;
    read(&bytes, scale).map_err(|message| scene.error(field, format!("{shown}: {message}")))
}

fn read(bytes: &[u8], scale: f32) -> Result<Option<Environment>, String> {
    use ImageFormat::{Hdr, Jpeg, OpenExr, Png};
    let formats = [OpenExr, Hdr, Png, Jpeg];
    let Decoded { image, format } =
        decode(bytes, &formats, "an EXR, HDR, PNG or JPEG", MOST_BYTES)?;
    let linear = matches!(format, OpenExr | Hdr);
    let image = image.into_rgb32f();
    let (width, height) = image.dimensions();
    let mut texels = Vec::with_capacity(width as usize * height as usize);
    for (x, y, pixel) in image.enumerate_pixels() {
        let stored = Vec3::from_array(pixel.0);
        let radiance = if linear {
            stored
        } else {
            stored.map(srgb_to_linear)
        } * scale;
        if !radiance.is_finite() || radiance.min_element() < 0.0 {
            return Err(format!(
                "found {:?} at x = {x}, y = {y}; expected finite radiance that is not negative",
                pixel.0
            ));
        }
        texels.push(radiance);
    }
    Ok(Environment::new(width as usize, height as usize, texels))
}

/// IEC 61966-2-1, for values in [0, 1].
fn srgb_to_linear(c: f32) -> f32 {
    if c <= 0.040_45 {
        c / 12.92
    } else {
        ((c + 0.055) / 1.055).powf(2.4)
    }
}
