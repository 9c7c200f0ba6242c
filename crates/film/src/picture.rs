//! A finished render with its layers.

use std::path::Path;

use ::exr::image::FlatSamples;
use glam::Vec3;

use crate::{
    Exposure, FilmError, Image,
    exr::{Channel, Part, read_part, write_part},
};

/// A finished picture with its layers; row-major, row 0 at the top.
///
/// Each list has `width · height` entries.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Linear RGB radiance in W·sr⁻¹·m⁻², unclamped: the mean of the pixel's samples.
    pub radiance: Vec<Vec3>,
    /// Estimated variance of that mean, its unit squared, ≥ 0.
    pub variance: Vec<Vec3>,
    /// Reflectance of the first hit, 0 to 1; zero where nothing is hit.
    pub albedo: Vec<Vec3>,
    /// Mean shading normal of the first hit, world space, of length ≤ 1; zero where nothing is hit.
    pub normal: Vec<Vec3>,
    /// Distance from the camera to the first hit in scene units; zero where nothing is hit.
    pub depth: Vec<f32>,
    /// Samples that the radiance is the mean of; zero marks a pixel that this picture does not have.
    pub samples: Vec<u32>,
}

/// The colour layers with the names of their channels.
const COLOURS: [[&str; 3]; 4] = [
    ["R", "G", "B"],
    ["variance.R", "variance.G", "variance.B"],
    ["albedo.R", "albedo.G", "albedo.B"],
    ["normal.X", "normal.Y", "normal.Z"],
];
const DEPTH: &str = "depth.Z";
const SAMPLES: &str = "samples.Y";

impl Picture {
    /// A picture with every value zero.
    pub fn new(width: u32, height: u32) -> Self {
        let pixels = width as usize * height as usize;
        let colours = || vec![Vec3::ZERO; pixels];
        Picture {
            width,
            height,
            radiance: colours(),
            variance: colours(),
            albedo: colours(),
            normal: colours(),
            depth: vec![0.0; pixels],
            samples: vec![0; pixels],
        }
    }

    /// The radiance alone.
    pub fn image(&self) -> Image {
        Image {
            width: self.width,
            height: self.height,
            pixels: self.radiance.clone(),
        }
    }

    /// Panics when a list has another length than the size asks for: whoever fills a picture keeps that.
    fn assert_lengths(&self) {
        let pixels = self.width as usize * self.height as usize;
        let lengths = [
            self.radiance.len(),
            self.variance.len(),
            self.albedo.len(),
            self.normal.len(),
            self.depth.len(),
            self.samples.len(),
        ];
        assert!(
            lengths.iter().all(|&length| length == pixels),
            "a picture of {}x{} has layers of {lengths:?} values",
            self.width,
            self.height
        );
    }

    /// Writes everything as one EXR, atomically (see [`crate::write_atomically`]).
    ///
    /// One part of scan lines, ZIP-compressed, lossless to the bit: `R`, `G`, `B` (radiance), `variance.R/G/B`,
    /// `albedo.R/G/B`, `normal.X/Y/Z` and `depth.Z` as 32-bit floats, and `samples.Y` as 32-bit integers.
    /// `attributes` are names (1 to 245 bytes) and values, stored as strings named `manylight.NAME`.
    /// The same picture and attributes, in whatever order, give the same bytes: no time stamp.
    ///
    /// # Errors
    ///
    /// Names the file when it cannot be written, the picture has no pixel, or an attribute has no usable
    /// name or occurs twice.
    ///
    /// # Panics
    ///
    /// When a layer's length does not fit the size.
    pub fn write_exr(&self, path: &Path, attributes: &[(String, String)]) -> Result<(), FilmError> {
        self.assert_lengths();
        if self.radiance.is_empty() {
            return Err(FilmError::Empty {
                name: path.display().to_string(),
                width: self.width,
                height: self.height,
            });
        }
        let mut channels = Vec::new();
        let layers = [&self.radiance, &self.variance, &self.albedo, &self.normal];
        for (layer, names) in layers.into_iter().zip(COLOURS) {
            for (c, name) in names.into_iter().enumerate() {
                channels.push(Channel {
                    name,
                    samples: FlatSamples::F32(layer.iter().map(|v| v[c]).collect()),
                });
            }
        }
        channels.push(Channel {
            name: DEPTH,
            samples: FlatSamples::F32(self.depth.clone()),
        });
        channels.push(Channel {
            name: SAMPLES,
            samples: FlatSamples::U32(self.samples.clone()),
        });
        write_part(path, self.width, self.height, channels, attributes)
    }

    /// Reads what [`Picture::write_exr`] wrote, to the bit, and its attributes sorted by name.
    ///
    /// # Errors
    ///
    /// Names the file when it cannot be read, is no EXR or not a whole one, or lacks one of the channels.
    pub fn read_exr(path: &Path) -> Result<(Picture, Vec<(String, String)>), FilmError> {
        let mut part = read_part(path)?;
        let mut picture = Picture::new(part.width, part.height);
        let layers = [
            &mut picture.radiance,
            &mut picture.variance,
            &mut picture.albedo,
            &mut picture.normal,
        ];
        for (layer, names) in layers.into_iter().zip(COLOURS) {
            for (c, name) in names.into_iter().enumerate() {
                let values = floats(&mut part, path, name)?;
                layer
                    .iter_mut()
                    .zip(values)
                    .for_each(|(pixel, value)| pixel[c] = value);
            }
        }
        picture.depth = floats(&mut part, path, DEPTH)?;
        picture.samples = match part.take(path, SAMPLES)? {
            FlatSamples::U32(values) => values,
            _ => return Err(wrong_type(path, SAMPLES, "32-bit integers")),
        };
        Ok((picture, part.attributes))
    }

    /// Writes the radiance, tone-mapped, as an 8-bit sRGB PNG, atomically; see [`crate::tone_map`].
    ///
    /// # Errors
    ///
    /// Names the file when it cannot be written or the picture has no pixel.
    pub fn write_png(&self, path: &Path, exposure: Exposure) -> Result<(), FilmError> {
        crate::png::write_pixels(path, self.width, self.height, &self.radiance, exposure)
    }

    /// Joins shards of one render, each named (by its file, say) and holding samples for pixels that no other has.
    ///
    /// Each pixel, in all layers, comes bit for bit from the one shard whose `samples` there is not zero.
    /// The order of the shards does not matter.
    ///
    /// # Errors
    ///
    /// No shards; shards of different size; pixels that two shards have, or none. The message says how many
    /// pixels, where the first one is and whose shards they are.
    pub fn merge(parts: &[(String, Picture)]) -> Result<Picture, FilmError> {
        let Some((first_name, first)) = parts.first() else {
            return Err(FilmError::MergeNothing);
        };
        let (width, height) = (first.width, first.height);
        for (name, part) in parts {
            part.assert_lengths();
            if (part.width, part.height) != (width, height) {
                return Err(FilmError::Size {
                    name: name.clone(),
                    width: part.width,
                    height: part.height,
                    other: first_name.clone(),
                    expected_width: width,
                    expected_height: height,
                });
            }
        }
        let place = |i: usize| ((i % width as usize) as u32, (i / width as usize) as u32);
        let mut merged = Picture::new(width, height);
        let mut owner: Vec<Option<usize>> = vec![None; merged.samples.len()];
        for (k, (name, part)) in parts.iter().enumerate() {
            let mut overlap: Option<(usize, usize)> = None; // first pixel, its owner
            let mut overlapping = 0;
            for i in (0..owner.len()).filter(|&i| part.samples[i] > 0) {
                if let Some(other) = owner[i] {
                    let (_, reported) = *overlap.get_or_insert((i, other));
                    overlapping += usize::from(reported == other);
                    continue;
                }
                owner[i] = Some(k);
                merged.radiance[i] = part.radiance[i];
                merged.variance[i] = part.variance[i];
                merged.albedo[i] = part.albedo[i];
                merged.normal[i] = part.normal[i];
                merged.depth[i] = part.depth[i];
                merged.samples[i] = part.samples[i];
            }
            if let Some((i, other)) = overlap {
                let (x, y) = place(i);
                return Err(FilmError::MergeOverlap {
                    first: parts[other].0.clone(),
                    second: name.clone(),
                    count: overlapping,
                    x,
                    y,
                });
            }
        }
        let mut missing = owner
            .iter()
            .enumerate()
            .filter(|(_, owner)| owner.is_none())
            .map(|(i, _)| i);
        if let Some(i) = missing.next() {
            let (x, y) = place(i);
            let names: Vec<&str> = parts.iter().map(|(name, _)| name.as_str()).collect();
            return Err(FilmError::MergeMissing {
                count: 1 + missing.count(),
                total: owner.len(),
                names: names.join(", "),
                x,
                y,
            });
        }
        Ok(merged)
    }
}

fn wrong_type(path: &Path, name: &str, expected: &str) -> FilmError {
    FilmError::Exr {
        path: path.display().to_string(),
        reason: format!("channel {name} has another type; expected {expected}"),
    }
}

fn floats(part: &mut Part, path: &Path, name: &str) -> Result<Vec<f32>, FilmError> {
    match part.take(path, name)? {
        FlatSamples::F32(values) => Ok(values),
        _ => Err(wrong_type(path, name, "32-bit floats")),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::read_image;

    /// A picture with a different value everywhere, awkward ones among them.
    fn awkward(width: u32, height: u32) -> Picture {
        let mut picture = Picture::new(width, height);
        let odd = [
            -0.0,
            f32::MIN_POSITIVE / 8.0,
            f32::MAX,
            -1e-20,
            f32::INFINITY,
            f32::NEG_INFINITY,
        ];
        let mut n = 0.0_f32;
        let mut next = || {
            n += 1.0;
            if n % 7.0 == 0.0 {
                odd[n as usize / 7 % odd.len()]
            } else {
                n.sin() * n.exp2().min(1e30)
            }
        };
        let layers = [
            &mut picture.radiance,
            &mut picture.variance,
            &mut picture.albedo,
            &mut picture.normal,
        ];
        for pixel in layers.into_iter().flatten() {
            *pixel = Vec3::new(next(), next(), next());
        }
        picture.depth.iter_mut().for_each(|depth| *depth = next());
        picture
            .samples
            .iter_mut()
            .enumerate()
            .for_each(|(i, count)| *count = u32::MAX - i as u32);
        picture
    }

    /// All bits of all layers.
    fn bits(picture: &Picture) -> Vec<u32> {
        let layers = [
            &picture.radiance,
            &picture.variance,
            &picture.albedo,
            &picture.normal,
        ];
        let colours = layers.into_iter().flatten().flat_map(|v| v.to_array());
        colours
            .chain(picture.depth.iter().copied())
            .map(f32::to_bits)
            .chain(picture.samples.iter().copied())
            .collect()
    }

    fn attributes() -> Vec<(String, String)> {
        [
            (
                "config",
                "(\n  scene: \"späti.ron\", // 日本\n)".to_string(),
            ),
            ("empty", String::new()),
            ("long", "x".repeat(100_000)),
            ("seed", "1".into()),
            ("version", "0.1.0".into()),
            ("a name of more than thirty-one characters", "y".into()),
        ]
        .map(|(name, value)| (name.to_string(), value))
        .into()
    }

    #[test]
    fn a_picture_survives_its_file_to_the_bit() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("picture.exr");
        for (width, height) in [(1, 1), (37, 19), (5, 100), (300, 1)] {
            let mut picture = awkward(width, height);
            picture.radiance[0] = Vec3::new(f32::NAN, 0.5, -f32::NAN);
            picture.write_exr(&path, &attributes()).expect("writes");
            let (read, names) = Picture::read_exr(&path).expect("reads");
            assert_eq!((read.width, read.height), (width, height), "size");
            assert_eq!(bits(&read), bits(&picture), "bits of {width}x{height}");
            let mut expected = attributes();
            expected.sort();
            assert_eq!(names, expected, "attributes");
            let colours = read_image(&path).expect("reads");
            let bits = |pixels: &[Vec3]| {
                pixels
                    .iter()
                    .map(|v| v.to_array().map(f32::to_bits))
                    .collect::<Vec<_>>()
            };
            assert_eq!(
                bits(&colours.pixels),
                bits(&picture.radiance),
                "colours of {width}x{height}"
            );
        }
    }

    #[test]
    fn equal_pictures_give_equal_bytes() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let picture = awkward(40, 70);
        let mut attributes = attributes();
        let path = folder.path().join("a.exr");
        picture.write_exr(&path, &attributes).expect("writes");
        let first = fs::read(&path).expect("reads");
        for _ in 0..8 {
            attributes.rotate_left(1);
            picture.write_exr(&path, &attributes).expect("writes");
            assert!(fs::read(&path).expect("reads") == first, "the bytes differ");
        }
    }

    #[test]
    fn attributes_that_exr_cannot_hold_are_refused() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a.exr");
        let pair = |name: &str| (name.to_string(), "value".to_string());
        for bad in [
            vec![pair("")],
            vec![pair(&"x".repeat(250))],
            vec![pair("a\0b")],
            vec![pair("a"), pair("a")],
        ] {
            let error = Picture::new(2, 2)
                .write_exr(&path, &bad)
                .expect_err("no such attribute");
            assert!(error.to_string().contains("a.exr: attribute"), "{error}");
            assert!(!path.exists(), "nothing is written");
        }
        // A name that EXR itself uses is as good as any.
        Picture::new(2, 2)
            .write_exr(&path, &[pair("channels"), pair("comments")])
            .expect("writes");
        assert_eq!(
            Picture::read_exr(&path).expect("reads").1,
            [pair("channels"), pair("comments")],
            "names"
        );
    }

    #[test]
    fn a_picture_without_pixels_is_refused() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a.exr");
        for (width, height) in [(0, 0), (3, 0), (0, 3)] {
            let picture = Picture::new(width, height);
            assert!(
                picture.write_exr(&path, &[]).is_err(),
                "{width}x{height} EXR"
            );
            assert!(
                picture.write_png(&path, Exposure::Auto).is_err(),
                "{width}x{height} PNG"
            );
        }
    }

    #[test]
    fn a_broken_file_is_an_error_that_names_it() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("broken.exr");
        let expect_error = |what: &str| {
            let error = Picture::read_exr(&path).expect_err(what);
            assert!(error.to_string().contains("broken.exr"), "{what}: {error}");
            let error = read_image(&path).expect_err(what);
            assert!(error.to_string().contains("broken.exr"), "{what}: {error}");
        };
        expect_error("no file");
        fs::write(&path, b"").expect("writes");
        expect_error("empty");
        fs::write(&path, "Conference room\n".repeat(400)).expect("writes");
        expect_error("text");
        fs::write(&path, vec![0; 4096]).expect("writes");
        expect_error("zeros");

        awkward(50, 60)
            .write_exr(&path, &attributes())
            .expect("writes");
        let whole = fs::read(&path).expect("reads");
        for k in 1..40 {
            fs::write(&path, &whole[..whole.len() * k / 40]).expect("writes");
            expect_error("cut short");
        }
        fs::write(&path, &whole[..whole.len() - 1]).expect("writes");
        expect_error("last byte missing");
    }

    #[test]
    fn a_forged_size_is_refused_before_memory_is_taken() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("forged.exr");
        Picture::new(16, 16).write_exr(&path, &[]).expect("writes");
        let whole = fs::read(&path).expect("reads");
        let window = whole
            .windows(11)
            .position(|w| w == b"dataWindow\0")
            .expect("there is one")
            + 11
            + 6
            + 4;
        for (x, y) in [
            (65_535, 65_535),
            (i32::MAX - 1, 15),
            (15, i32::MAX - 1),
            (100_000_000, 100_000_000),
            (-7, -7),
        ] {
            let mut forged = whole.clone();
            forged[window + 8..window + 12].copy_from_slice(&i32::to_le_bytes(x));
            forged[window + 12..window + 16].copy_from_slice(&i32::to_le_bytes(y));
            fs::write(&path, &forged).expect("writes");
            let error = Picture::read_exr(&path).expect_err("forged");
            assert!(error.to_string().contains("forged.exr"), "{error}");
            read_image(&path).expect_err("forged");
        }
    }

    #[test]
    fn dwa_compression_is_refused_by_name() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("dwa.exr");
        Picture::new(16, 16).write_exr(&path, &[]).expect("writes");
        let mut bytes = fs::read(&path).expect("reads");
        let name = b"compression\0compression\0\x01\0\0\0";
        let at = bytes
            .windows(name.len())
            .position(|w| w == name)
            .expect("there is one")
            + name.len();
        for dwa in [8, 9] {
            bytes[at] = dwa;
            fs::write(&path, &bytes).expect("writes");
            let error = read_image(&path).expect_err("DWA").to_string();
            assert!(error.contains("dwa.exr: it has DWA compression"), "{error}");
        }
    }

    #[test]
    fn flipped_bytes_never_panic() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("flipped.exr");
        awkward(9, 20).write_exr(&path, &[]).expect("writes");
        let whole = fs::read(&path).expect("reads");
        verify::property(1000, |u| {
            let mut bytes = whole.clone();
            for _ in 0..u.int_in_range(1..=4)? {
                // Mostly in the header, where a byte does more harm.
                let end = if u.ratio(3, 4)? {
                    900.min(bytes.len())
                } else {
                    bytes.len()
                };
                bytes[u.int_in_range(0..=end - 1)?] = u.arbitrary()?;
            }
            fs::write(&path, &bytes).expect("writes");
            let _ = Picture::read_exr(&path);
            let _ = read_image(&path);
            Ok(())
        });
    }

    #[test]
    fn a_file_without_our_channels_says_which_is_missing() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("grey.exr");
        let channels = vec![Channel {
            name: "Y",
            samples: FlatSamples::F32(vec![0.25, 2.0]),
        }];
        write_part(&path, 2, 1, channels, &[]).expect("writes");
        let error = Picture::read_exr(&path).expect_err("grey");
        assert!(
            error
                .to_string()
                .ends_with("grey.exr: no channel R; the file has Y"),
            "{error}"
        );
        let image = read_image(&path).expect("grey is fine here");
        assert_eq!(image.pixels, [Vec3::splat(0.25), Vec3::splat(2.0)], "grey");
        let channels = vec![Channel {
            name: "view.R",
            samples: FlatSamples::F32(vec![0.25, 2.0]),
        }];
        write_part(&path, 2, 1, channels, &[]).expect("writes");
        let error = read_image(&path).expect_err("no default layer");
        assert!(
            error
                .to_string()
                .ends_with("no channel R, G, B or Y; the file has view.R"),
            "{error}"
        );
    }

    /// `count` shards of `whole`: pixel i goes to shard i % count.
    fn shards(whole: &Picture, count: usize) -> Vec<(String, Picture)> {
        (0..count)
            .map(|k| {
                let mut shard = whole.clone();
                for i in (0..shard.samples.len()).filter(|i| i % count != k) {
                    shard.radiance[i] = Vec3::ZERO;
                    shard.samples[i] = 0;
                }
                (format!("shard{k}.exr"), shard)
            })
            .collect()
    }

    #[test]
    fn merged_shards_are_the_whole_picture_to_the_bit() {
        let whole = awkward(13, 7);
        for count in [1, 2, 5] {
            let mut parts = shards(&whole, count);
            assert_eq!(
                bits(&Picture::merge(&parts).expect("merges")),
                bits(&whole),
                "{count} shards"
            );
            parts.reverse();
            assert_eq!(
                bits(&Picture::merge(&parts).expect("merges")),
                bits(&whole),
                "{count} shards, reversed"
            );
        }
    }

    #[test]
    fn shards_that_do_not_fit_are_refused_and_say_why() {
        let whole = awkward(13, 7);
        let message = |parts: &[(String, Picture)]| {
            Picture::merge(parts).expect_err("does not fit").to_string()
        };
        assert!(message(&[]).contains("nothing to merge"), "no shards");

        let parts = shards(&whole, 3);
        let text = message(&parts[..2]);
        assert!(
            text.contains("30 of 91 pixels") && text.contains("shard0.exr, shard1.exr"),
            "{text}"
        );
        assert!(text.contains("x=2, y=0"), "{text}");

        let mut parts = shards(&whole, 3);
        parts[2].1.samples[0] = 1;
        parts[2].1.samples[15] = 1;
        let text = message(&parts);
        assert!(
            text.contains("shard0.exr and shard2.exr both have samples for 2 pixels"),
            "{text}"
        );

        let mut parts = shards(&whole, 2);
        parts[1].1 = Picture::new(7, 13);
        let text = message(&parts);
        assert!(
            text.contains("shard1.exr is 7x13; expected 13x7 as shard0.exr"),
            "{text}"
        );
    }
}
