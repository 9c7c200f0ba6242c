//! Pictures of environments: EXR, Radiance HDR, PNG and JPEG.

use std::io::Cursor;

use glam::Vec3;
use image::{ImageFormat, ImageReader, Limits};

use crate::load::{SceneText, unreadable};
use crate::{Environment, SceneError};

/// Texels a side at most.
const LARGEST: u32 = 16384;

/// Bytes a decoder may use: 16384 × 8192 texels of three floats.
const MOST_BYTES: u64 = 3 << 29;

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
    decode(bytes, scale).map_err(|message| scene.error(field, format!("{shown}: {message}")))
}

fn decode(bytes: Vec<u8>, scale: f32) -> Result<Option<Environment>, String> {
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let mut reader = reader.map_err(|e| e.to_string())?;
    let format = reader.format();
    let linear = matches!(format, Some(ImageFormat::OpenExr | ImageFormat::Hdr));
    if !linear && !matches!(format, Some(ImageFormat::Png | ImageFormat::Jpeg)) {
        return Err("not an EXR, HDR, PNG or JPEG file".to_owned());
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST);
    limits.max_image_height = Some(LARGEST);
    limits.max_alloc = Some(MOST_BYTES);
    reader.limits(limits);
    let image = reader.decode().map_err(|e| match e {
        image::ImageError::Limits(_) => {
            format!("{e}; expected at most {LARGEST} × {LARGEST} texels")
        }
        e => e.to_string(),
    })?;
    let image = image.into_rgb32f();
    let (width, height) = image.dimensions();
    if width == 0 || height == 0 {
        return Err("the image has no texels".to_owned());
    }
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
