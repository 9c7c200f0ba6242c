//! EXR files: channels and text attributes in one part, and anybody's colours.

use std::{fs, io, path::Path};

use ::exr::{
    image::{Blocks, Encoding, FlatSamples, read::specific_channels::ReadSpecificChannel},
    meta::{
        BlockDescription, MetaData,
        attribute::{AttributeValue, Chromaticities, LineOrder, Text},
        header::Header,
    },
    prelude::{
        AnyChannel, AnyChannels, Compression, ImageAttributes, Layer, LayerAttributes,
        ReadChannels, ReadLayers, Vec2, WritableImage,
    },
};
use glam::{DVec3, Vec3};

use crate::{
    FilmError,
    metadata::{CameraMatrices, Metadata},
    write_atomically,
};

/// Our attributes carry this before their names, so that none can take the place of one that EXR defines.
const PREFIX: &str = "manylight.";

/// The primaries of linear RGB here: those of sRGB.
const REC_709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.3, 0.6),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.329),
};

/// Reading a file may take this many bytes whatever the file's size …
const ALWAYS_ALLOWED_BYTES: u64 = 256 << 20;
/// … and beyond that, this many for each byte of it. Deflate reaches 1032, and whoever forges a header
/// wants far more.
const ALLOWED_EXPANSION: u64 = 3000;

/// A picture's colours, for comparisons; row-major, row 0 at the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width · height` values: linear RGB, for a render radiance in W·sr⁻¹·m⁻².
    pub pixels: Vec<Vec3>,
}

impl Image {
    /// The pixels as f64.
    pub(crate) fn pixels_f64(&self) -> Vec<DVec3> {
        self.pixels.iter().map(|rgb| rgb.as_dvec3()).collect()
    }

    /// Writes the colours as one EXR (`R`, `G`, `B`, 32-bit floats, ZIP), atomically.
    ///
    /// # Errors
    ///
    /// Names the file when it cannot be written, the picture has no pixel, or an attribute has no usable
    /// name or occurs twice.
    pub fn write_exr(&self, path: &Path, metadata: &Metadata) -> Result<(), FilmError> {
        if self.pixels.is_empty() {
            return Err(FilmError::Empty {
                name: path.display().to_string(),
                width: self.width,
                height: self.height,
            });
        }
        let channels = ["R", "G", "B"].into_iter().enumerate();
        let channels = channels.map(|(c, name)| Channel {
            name,
            samples: FlatSamples::F32(self.pixels.iter().map(|rgb| rgb[c]).collect()),
        });
        write_part(path, self.width, self.height, channels.collect(), metadata)
    }
}

/// One channel of a file to be written: its name and a value for each pixel.
pub(crate) struct Channel {
    pub(crate) name: &'static str,
    pub(crate) samples: FlatSamples,
}

/// What a file holds: a single part with all of its channels.
pub(crate) struct Part {
    pub(crate) width: u32,
    pub(crate) height: u32,
    channels: Vec<(String, FlatSamples)>,
    /// Texts sorted by name.
    pub(crate) metadata: Metadata,
}

/// Writes one part with `channels`, compressed without loss (ZIP).
///
/// The same input gives the same bytes.
pub(crate) fn write_part(
    path: &Path,
    width: u32,
    height: u32,
    channels: Vec<Channel>,
    metadata: &Metadata,
) -> Result<(), FilmError> {
    let size = Vec2(width as usize, height as usize);
    let mut layer_attributes = LayerAttributes {
        software_name: Some(Text::from("manylight")),
        world_to_camera: metadata.camera.map(|m| m.world_to_camera),
        world_to_normalized_device: metadata.camera.map(|m| m.world_to_ndc),
        ..Default::default()
    };
    for (name, value) in &metadata.texts {
        let (name, value) = attribute(path, name, value)?;
        if layer_attributes.other.insert(name.clone(), value).is_some() {
            return Err(bad_attribute(
                path,
                &name.to_string(),
                "is given twice; expected distinct names",
            ));
        }
    }
    let list = channels
        .into_iter()
        .map(|channel| AnyChannel::new(channel.name, channel.samples))
        .collect();
    let layer = Layer {
        channel_data: AnyChannels::sort(list),
        attributes: layer_attributes,
        size,
        encoding: Encoding {
            compression: Compression::ZIP16,
            blocks: Blocks::ScanLines,
            line_order: LineOrder::Increasing,
        },
    };
    let image = ::exr::image::Image {
        attributes: ImageAttributes {
            chromaticities: Some(REC_709),
            ..ImageAttributes::with_size(size)
        },
        layer_data: layer,
    };
    let mut bytes = io::Cursor::new(Vec::new());
    image
        .write()
        .to_buffered(&mut bytes)
        .map_err(|error| exr_error(path, error))?;
    let mut bytes = bytes.into_inner();
    sort_header(&mut bytes).ok_or_else(|| FilmError::Exr {
        path: path.display().to_string(),
        reason: "the encoder gave a header that cannot be parsed".into(),
    })?;
    write_atomically(path, |file| file.write_all(&bytes))
}

/// Puts the attributes of a single-part header into the order of their names, as OpenEXR writes them.
///
/// The encoder keeps custom attributes in a hash map, whose order differs from run to run. Sorting moves no
/// pixel data, so the offsets in the file hold. `None` when the bytes are no such header.
fn sort_header(bytes: &mut [u8]) -> Option<()> {
    const START: usize = 8; // magic number and version
    fn text_end(bytes: &[u8], from: usize) -> Option<usize> {
        Some(from + bytes.get(from..)?.iter().position(|&byte| byte == 0)? + 1)
    }
    let mut entries = Vec::new();
    let mut at = START;
    while *bytes.get(at)? != 0 {
        let name_end = text_end(bytes, at)?;
        let type_end = text_end(bytes, name_end)?;
        let length = u32::from_le_bytes(bytes.get(type_end..type_end + 4)?.try_into().ok()?);
        let end = type_end + 4 + length as usize;
        entries.push((bytes[at..name_end].to_vec(), bytes.get(at..end)?.to_vec()));
        at = end;
    }
    entries.sort();
    let sorted: Vec<u8> = entries.into_iter().flat_map(|(_, entry)| entry).collect();
    bytes.get_mut(START..at)?.copy_from_slice(&sorted);
    Some(())
}

fn bad_attribute(path: &Path, name: &str, reason: &str) -> FilmError {
    FilmError::Attribute {
        path: path.display().to_string(),
        name: name.into(),
        reason: reason.into(),
    }
}

/// EXR text is bytes; ours are UTF-8, which readers either know or show as Latin-1.
fn attribute(path: &Path, name: &str, value: &str) -> Result<(Text, AttributeValue), FilmError> {
    let stored = format!("{PREFIX}{name}");
    if name.is_empty() || name.contains('\0') || stored.len() > 255 {
        return Err(bad_attribute(
            path,
            name,
            "has no usable name; expected 1 to 245 bytes, none of them 0",
        ));
    }
    if i32::try_from(value.len()).is_err() {
        return Err(bad_attribute(
            path,
            name,
            "is too long; expected at most 2147483647 bytes",
        ));
    }
    let text = |text: &str| Text::from_slice_unchecked(text.as_bytes());
    Ok((text(&stored), AttributeValue::Text(text(value))))
}

fn exr_error(path: &Path, error: ::exr::error::Error) -> FilmError {
    let path = path.display().to_string();
    match error {
        ::exr::error::Error::Io(source) => FilmError::Io { path, source },
        other => FilmError::Exr {
            path,
            reason: format!("not a readable EXR: {other}"),
        },
    }
}

/// The headers of a file, once they claim no more than such a file can hold.
fn headers(path: &Path) -> Result<Vec<Header>, FilmError> {
    let io_error = |source| FilmError::Io {
        path: path.display().to_string(),
        source,
    };
    let found = fs::metadata(path).map_err(io_error)?;
    if !found.is_file() {
        return Err(io_error(io::Error::new(
            io::ErrorKind::InvalidInput,
            "not a regular file",
        )));
    }
    let meta = MetaData::read_from_file(path, false).map_err(|error| exr_error(path, error))?;
    let allowed = ALWAYS_ALLOWED_BYTES.max(found.len().saturating_mul(ALLOWED_EXPANSION));
    for header in &meta.headers {
        if matches!(
            header.compression,
            Compression::DWAA(_) | Compression::DWAB(_)
        ) {
            // exr 1.74's decoder reserves whatever memory a forged block asks for, and the process aborts.
            return Err(FilmError::Exr {
                path: path.display().to_string(),
                reason: "it has DWA compression, which is lossy and not read here; expected ZIP, PIZ, RLE or none".into(),
            });
        }
        if let BlockDescription::Tiles(tiles) = &header.blocks {
            // The decoder makes room for whole ones.
            let Vec2(width, height) = tiles.tile_size;
            let texels = (width as u64).saturating_mul(height as u64);
            if texels.saturating_mul(header.channels.bytes_per_pixel as u64) > allowed {
                return Err(FilmError::Exr {
                    path: path.display().to_string(),
                    reason: format!(
                        "the header claims tiles of {width}x{height} pixels, which a file of {} bytes cannot hold",
                        found.len()
                    ),
                });
            }
        }
        let Vec2(width, height) = header.layer_size;
        // The samples, and what they become here.
        let per_pixel = (header.channels.bytes_per_pixel + size_of::<Vec3>()) as u64;
        let pixels = (width as u64).saturating_mul(height as u64);
        if pixels.saturating_mul(per_pixel) > allowed
            || u32::try_from(width).is_err()
            || u32::try_from(height).is_err()
        {
            return Err(FilmError::Exr {
                path: path.display().to_string(),
                reason: format!(
                    "the header claims {width}x{height} pixels in {} channels, which a file of {} bytes cannot hold",
                    header.channels.list.len(),
                    found.len()
                ),
            });
        }
    }
    Ok(meta.headers.into_iter().collect())
}

/// Names of all channels, for a message.
fn channel_names(headers: &[Header]) -> String {
    let names: Vec<String> = headers
        .iter()
        .flat_map(|header| {
            header
                .channels
                .list
                .iter()
                .map(|channel| channel.name.to_string())
        })
        .collect();
    if names.is_empty() {
        "none".into()
    } else {
        names.join(", ")
    }
}

/// Reads the first part with all of its channels.
pub(crate) fn read_part(path: &Path) -> Result<Part, FilmError> {
    headers(path)?;
    let image = ::exr::image::read::read_first_flat_layer_from_file(path)
        .map_err(|error| exr_error(path, error))?;
    let layer = image.layer_data;
    let own = &layer.attributes;
    let mut texts: Vec<(String, String)> = own
        .other
        .iter()
        .filter_map(|(name, value)| {
            let name = String::from_utf8_lossy(name.as_slice())
                .strip_prefix(PREFIX)?
                .to_string();
            let AttributeValue::Text(value) = value else {
                return None;
            };
            Some((name, String::from_utf8_lossy(value.as_slice()).into_owned()))
        })
        .collect();
    texts.sort();
    let camera = match (own.world_to_camera, own.world_to_normalized_device) {
        (Some(world_to_camera), Some(world_to_ndc)) => Some(CameraMatrices {
            world_to_camera,
            world_to_ndc,
        }),
        _ => None,
    };
    Ok(Part {
        width: layer.size.0 as u32,
        height: layer.size.1 as u32,
        channels: layer
            .channel_data
            .list
            .into_iter()
            .map(|channel| (channel.name.to_string(), channel.sample_data))
            .collect(),
        metadata: Metadata { texts, camera },
    })
}

impl Part {
    /// Pixels of the part.
    pub(crate) fn len(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether there is a channel `name`.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.channels.iter().any(|(present, _)| present == name)
    }

    /// Takes out the channel `name`, which must have a value for each pixel.
    pub(crate) fn take(&mut self, path: &Path, name: &str) -> Result<FlatSamples, FilmError> {
        let found = self
            .channels
            .iter()
            .position(|(present, _)| present == name);
        let Some(found) = found else {
            let present: Vec<&str> = self
                .channels
                .iter()
                .map(|(name, _)| name.as_str())
                .collect();
            return Err(FilmError::Channel {
                path: path.display().to_string(),
                wanted: name.into(),
                present: present.join(", "),
            });
        };
        let samples = self.channels.swap_remove(found).1;
        if samples.len() != self.len() {
            return Err(FilmError::Exr {
                path: path.display().to_string(),
                reason: format!(
                    "channel {name} has {} values; expected one for each pixel",
                    samples.len()
                ),
            });
        }
        Ok(samples)
    }
}

/// Reads the colours of any EXR: channels R, G and B of the first part that has them, or else Y as grey.
///
/// Half, float and integer channels, every compression but DWA, tiles and scan lines.
/// The pixels are those of the data window. Alpha and other channels are ignored; the values are taken as
/// they are, in whatever primaries the file has, and may be non-finite.
///
/// # Errors
///
/// Names the file: it cannot be read, is no EXR or not a whole one, claims more pixels than it can hold,
/// has no such channels, or has subsampled ones.
pub fn read_image(path: &Path) -> Result<Image, FilmError> {
    let headers = headers(path)?;
    let has = |header: &Header, wanted: &[&str]| {
        let there = |name: &&str| {
            header
                .channels
                .list
                .iter()
                .any(|channel| channel.name.eq(name))
        };
        !header.deep && wanted.iter().all(there)
    };
    let first = |wanted: &[&str]| headers.iter().find(|header| has(header, wanted));
    let (header, grey) = match (first(&["R", "G", "B"]), first(&["Y"])) {
        (Some(header), _) => (header, false),
        (None, Some(header)) => (header, true),
        (None, None) => {
            return Err(FilmError::Channel {
                path: path.display().to_string(),
                wanted: "R, G, B or Y".into(),
                present: channel_names(&headers),
            });
        }
    };
    if header
        .channels
        .list
        .iter()
        .any(|channel| channel.sampling != Vec2(1, 1))
    {
        return Err(FilmError::Exr {
            path: path.display().to_string(),
            reason: "it has subsampled channels; expected a value for each pixel".into(),
        });
    }
    let reader = ::exr::image::read::read()
        .no_deep_data()
        .largest_resolution_level();
    let blank = |size: Vec2<usize>| Image {
        width: size.0 as u32,
        height: size.1 as u32,
        pixels: vec![Vec3::ZERO; size.0 * size.1],
    };
    let set = |image: &mut Image, at: Vec2<usize>, value: Vec3| {
        image.pixels[at.1 * image.width as usize + at.0] = value
    };
    let image = if grey {
        reader
            .specific_channels()
            .required("Y")
            .collect_pixels(
                move |size, _| blank(size),
                move |image, at, (y,): (f32,)| set(image, at, Vec3::splat(y)),
            )
            .first_valid_layer()
            .all_attributes()
            .from_file(path)
            .map(|image| image.layer_data.channel_data.pixels)
    } else {
        reader
            .specific_channels()
            .required("R")
            .required("G")
            .required("B")
            .collect_pixels(
                move |size, _| blank(size),
                move |image, at, (r, g, b): (f32, f32, f32)| set(image, at, Vec3::new(r, g, b)),
            )
            .first_valid_layer()
            .all_attributes()
            .from_file(path)
            .map(|image| image.layer_data.channel_data.pixels)
    };
    image.map_err(|error| exr_error(path, error))
}
