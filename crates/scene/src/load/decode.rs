//! Pictures out of bytes that nobody vouches for.

use std::io::Cursor;

use exr::compression::Compression;
use exr::meta::MetaData;
use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};

/// Texels a side at most: a small file must not claim the whole memory.
const LARGEST: u32 = 16384;

/// A picture may claim this many bytes whatever the size of its file …
const ALWAYS_ALLOWED_BYTES: u64 = 64 << 20;
/// … and beyond that, this many for each byte of it. Deflate reaches 1032, and whoever forges a header wants far more.
const ALLOWED_EXPANSION: u64 = 3000;

/// A picture, and the format that its bytes are in.
pub(super) struct Decoded {
    pub(super) image: DynamicImage,
    pub(super) format: ImageFormat,
}

/// Decodes a file of one of the `formats`, which a message calls `kinds`, into at most `most_bytes`; else a message.
pub(super) fn decode(
    bytes: &[u8],
    formats: &[ImageFormat],
    kinds: &str,
    most_bytes: u64,
) -> Result<Decoded, String> {
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let mut reader = reader.map_err(|e| e.to_string())?;
    let Some(format) = reader.format().filter(|found| formats.contains(found)) else {
        return Err(format!("not {kinds} file"));
    };
    if format == ImageFormat::OpenExr {
        refuse_dwa(bytes)?;
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST);
    limits.max_image_height = Some(LARGEST);
    limits.max_alloc = Some(most_bytes);
    let told = |e: ImageError| match e {
        ImageError::Limits(_) => format!("{e}; expected at most {LARGEST} × {LARGEST} texels"),
        e => e.to_string(),
    };
    reader.limits(limits.clone());
    let mut decoder = reader.into_decoder().map_err(told)?;
    let (width, height) = decoder.dimensions();
    let claimed = decoder.total_bytes();
    let size = bytes.len() as u64;
    // What is over a limit is refused by its name first.
    limits.check_dimensions(width, height).map_err(told)?;
    limits.reserve(claimed).map_err(told)?;
    if claimed > ALWAYS_ALLOWED_BYTES.max(size.saturating_mul(ALLOWED_EXPANSION)) {
        return Err(format!(
            "the header claims {width} × {height} texels, which a file of {size} bytes cannot hold"
        ));
    }
    decoder.set_limits(limits).map_err(told)?;
    let image = DynamicImage::from_decoder(decoder).map_err(told)?;
    if image.width() == 0 || image.height() == 0 {
        return Err("the image has no texels".to_owned());
    }
    Ok(Decoded { image, format })
}

/// The decoder of DWA compression reserves whatever memory a forged block asks for, and the process would end.
fn refuse_dwa(bytes: &[u8]) -> Result<(), String> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false);
    let meta = meta.map_err(|e| format!("not a readable EXR: {e}"))?;
    let dwa = |c: &Compression| matches!(c, Compression::DWAA(_) | Compression::DWAB(_));
    match meta.headers.iter().any(|h| dwa(&h.compression)) {
        true => Err("it has DWA compression, which is lossy and not read here; expected ZIP, PIZ, RLE or none".to_owned()),
        false => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A PNG of one texel whose header says something else.
    fn png_that_claims(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        let one = image::RgbImage::new(1, 1);
        one.write_to(&mut bytes, ImageFormat::Png)
            .expect("a PNG in memory");
        let mut bytes = bytes.into_inner();
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes[20..24].copy_from_slice(&height.to_be_bytes());
        let mut crc = !0u32;
        for &byte in &bytes[12..29] {
            crc ^= u32::from(byte);
            for _ in 0..8 {
                crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
            }
        }
        bytes[29..33].copy_from_slice(&(!crc).to_be_bytes());
        bytes
    }

    fn message(bytes: &[u8]) -> String {
        let decoded = decode(
            bytes,
            &[ImageFormat::Png, ImageFormat::OpenExr],
            "a PNG",
            1 << 30,
        );
        decoded.err().expect("refused")
    }

    #[test]
    fn a_header_that_claims_what_its_file_cannot_hold_is_refused_before_memory_is_taken() {
        assert!(message(&png_that_claims(16000, 16000)).contains("claims 16000 × 16000 texels"));
        assert!(message(&png_that_claims(1 << 20, 1)).contains("expected at most 16384"));
    }

    #[test]
    fn dwa_compression_is_refused_by_name() {
        let mut bytes = Cursor::new(Vec::new());
        let texels = image::Rgb32FImage::new(4, 4);
        let written = DynamicImage::from(texels).write_to(&mut bytes, ImageFormat::OpenExr);
        written.expect("an EXR in memory");
        let mut bytes = bytes.into_inner();
        let name = b"compression\0compression\0\x01\0\0\0";
        let at = bytes.windows(name.len()).position(|w| w == name);
        bytes[at.expect("an attribute of each EXR") + name.len()] = 9;
        let message = message(&bytes);
        assert!(message.starts_with("it has DWA compression"), "{message}");
    }
}
