//! Pictures out of bytes that nobody vouches for.

use std::io::{BufReader, Cursor, Read, Seek};

use exr::compression::Compression;
use exr::meta::{BlockDescription, MetaData};
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

/// Texels that a file claims to have, of which no more is read than its header; `None` where it cannot be told.
pub(super) fn claimed_texels(file: impl Read + Seek) -> Option<u64> {
    let reader = ImageReader::new(BufReader::new(file)).with_guessed_format();
    let (width, height) = reader.ok()?.into_dimensions().ok()?;
    // What is larger is refused when it is decoded.
    Some(u64::from(width.min(LARGEST)) * u64::from(height.min(LARGEST)))
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
        refuse_forged_blocks(bytes)?;
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
    // What is over a limit is refused by its name first.
    limits.check_dimensions(width, height).map_err(told)?;
    limits.reserve(claimed).map_err(told)?;
    if claimed > greatest_claim(bytes.len()) {
        return Err(format!(
            "the header claims {width} × {height} texels, which a file of {} bytes cannot hold",
            bytes.len()
        ));
    }
    decoder.set_limits(limits).map_err(told)?;
    let image = DynamicImage::from_decoder(decoder).map_err(told)?;
    if image.width() == 0 || image.height() == 0 {
        return Err("the image has no texels".to_owned());
    }
    Ok(Decoded { image, format })
}

/// Bytes that a file of so many can hold, with room for the smallest.
fn greatest_claim(size: usize) -> u64 {
    ALWAYS_ALLOWED_BYTES.max((size as u64).saturating_mul(ALLOWED_EXPANSION))
}

/// Refuses an EXR whose blocks would take memory beyond its picture's: the decoder of DWA compression reserves whatever
/// a forged block asks for, and the process would end; and that of tiles makes room for whole ones.
fn refuse_forged_blocks(bytes: &[u8]) -> Result<(), String> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false);
    let meta = meta.map_err(|e| format!("not a readable EXR: {e}"))?;
    for header in &meta.headers {
        if matches!(
            header.compression,
            Compression::DWAA(_) | Compression::DWAB(_)
        ) {
            return Err("it has DWA compression, which is lossy and not read here; expected ZIP, PIZ, RLE or none".to_owned());
        }
        if let BlockDescription::Tiles(tiles) = &header.blocks {
            let [width, height] = [tiles.tile_size.0, tiles.tile_size.1];
            let texels = (width as u64).saturating_mul(height as u64);
            if texels.saturating_mul(header.channels.bytes_per_pixel as u64)
                > greatest_claim(bytes.len())
            {
                return Err(format!(
                    "the header claims tiles of {width} × {height} texels, which a file of {} bytes cannot hold",
                    bytes.len()
                ));
            }
        }
    }
    Ok(())
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

    /// An EXR of four by four texels, and where in it the value of an attribute begins.
    fn exr_with(attribute: &[u8]) -> (Vec<u8>, usize) {
        let mut bytes = Cursor::new(Vec::new());
        let texels = image::Rgb32FImage::new(4, 4);
        let written = DynamicImage::from(texels).write_to(&mut bytes, ImageFormat::OpenExr);
        written.expect("an EXR in memory");
        let bytes = bytes.into_inner();
        let at = bytes.windows(attribute.len()).position(|w| w == attribute);
        let at = at.expect("the encoder writes it") + attribute.len();
        (bytes, at)
    }

    #[test]
    fn dwa_compression_is_refused_by_name() {
        let (mut bytes, at) = exr_with(b"compression\0compression\0\x01\0\0\0");
        bytes[at] = 9;
        let message = message(&bytes);
        assert!(message.starts_with("it has DWA compression"), "{message}");
    }

    #[test]
    fn tiles_that_a_file_cannot_hold_are_refused_before_memory_is_taken() {
        let (mut bytes, at) = exr_with(b"tiles\0tiledesc\0\x09\0\0\0");
        bytes[at..at + 4].copy_from_slice(&0x003c_0040_u32.to_le_bytes());
        let message = message(&bytes);
        assert!(
            message.contains("claims tiles of 3932224 × 64 texels"),
            "{message}"
        );
    }
}
