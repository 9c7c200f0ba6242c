//! A finished render with its layers.

use std::path::Path;

use ::exr::image::FlatSamples;
use glam::Vec3;

use crate::{
    Exposure, FilmError, Image,
    exr::{Channel, Part, read_part, write_part},
    metadata::Metadata,
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
    /// The part of the radiance that has met at most one surface since it left a light: lights that are seen, and what
    /// they light; empty in a picture that was read from a file without this layer.
    pub direct: Vec<Vec3>,
    /// The rest of the radiance; there whenever `direct` is.
    pub indirect: Vec<Vec3>,
}

/// The colour layers with the names of their channels, in the order of [`Picture::colours`].
const COLOURS: [[&str; 3]; 6] = [
    ["R", "G", "B"],
    ["variance.R", "variance.G", "variance.B"],
    ["albedo.R", "albedo.G", "albedo.B"],
    ["normal.X", "normal.Y", "normal.Z"],
    ["direct.R", "direct.G", "direct.B"],
    ["indirect.R", "indirect.G", "indirect.B"],
];
/// So many of them are in every file; the others in none, or all of them.
const ALWAYS: usize = 4;
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
            direct: colours(),
            indirect: colours(),
        }
    }

    /// The colour layers, as in [`COLOURS`].
    fn colours(&self) -> [&Vec<Vec3>; 6] {
        [
            &self.radiance,
            &self.variance,
            &self.albedo,
            &self.normal,
            &self.direct,
            &self.indirect,
        ]
    }

    fn colours_mut(&mut self) -> [&mut Vec<Vec3>; 6] {
        [
            &mut self.radiance,
            &mut self.variance,
            &mut self.albedo,
            &mut self.normal,
            &mut self.direct,
            &mut self.indirect,
        ]
    }

    /// Whether direct and indirect light are told apart.
    fn is_divided(&self) -> bool {
        !self.direct.is_empty()
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
        let colours = self.colours().map(Vec::len);
        let others = [self.depth.len(), self.samples.len()];
        let (always, divided) = colours.split_at(ALWAYS);
        assert!(
            always.iter().chain(&others).all(|&length| length == pixels)
                && (divided == [0; 2] || divided == [pixels; 2]),
            "a picture of {}x{} has layers of {colours:?} and {others:?} values",
            self.width,
            self.height
        );
    }

    /// Writes everything as one EXR, atomically (see [`crate::write_atomically`]).
    ///
    /// One part of scan lines, ZIP-compressed, lossless to the bit: `R`, `G`, `B` (radiance), `direct.R/G/B`,
    /// `indirect.R/G/B`, `variance.R/G/B`, `albedo.R/G/B`, `normal.X/Y/Z` and `depth.Z` as 32-bit floats, and
    /// `samples.Y` as 32-bit integers. The same picture and metadata give the same bytes: no time stamp.
    ///
    /// # Errors
    ///
    /// Names the file when it cannot be written, the picture has no pixel, or an attribute has no usable
    /// name or occurs twice.
    ///
    /// # Panics
    ///
    /// When a layer's length does not fit the size.
    pub fn write_exr(&self, path: &Path, metadata: &Metadata) -> Result<(), FilmError> {
        self.assert_lengths();
        if self.radiance.is_empty() {
            return Err(FilmError::Empty {
                name: path.display().to_string(),
                width: self.width,
                height: self.height,
            });
        }
        let mut channels = Vec::new();
        let layers = self.colours().into_iter().zip(COLOURS);
        for (layer, names) in layers.filter(|(layer, _)| !layer.is_empty()) {
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
        write_part(path, self.width, self.height, channels, metadata)
    }

    /// Reads what [`Picture::write_exr`] wrote, to the bit, and its metadata with texts sorted by name.
    ///
    /// # Errors
    ///
    /// Names the file when it cannot be read, is no EXR or not a whole one, or lacks one of the channels; only those of
    /// direct and indirect light may be missing, together.
    pub fn read_exr(path: &Path) -> Result<(Picture, Metadata), FilmError> {
        let mut part = read_part(path)?;
        let mut picture = Picture::new(part.width, part.height);
        if !part.has(COLOURS[ALWAYS][0]) {
            picture.direct.clear();
            picture.indirect.clear();
        }
        let layers = picture.colours_mut().into_iter().zip(COLOURS);
        for (layer, names) in layers.filter(|(layer, _)| !layer.is_empty()) {
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
        Ok((picture, part.metadata))
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
    /// The order of the shards does not matter. Direct and indirect light are told apart if all shards do.
    /// Shards are asked for one after the other, and each is dropped before the next: if `parts` reads them when
    /// asked, a thousand need no more memory than two.
    ///
    /// # Errors
    ///
    /// The first error of `parts`; no shards; shards of different size; pixels that two shards have, or none. The
    /// message says how many pixels, where the first one is and whose shards they are.
    pub fn merge<E: From<FilmError>>(
        parts: impl IntoIterator<Item = Result<(String, Picture), E>>,
    ) -> Result<Picture, E> {
        let mut parts = parts.into_iter();
        let Some(first) = parts.next() else {
            return Err(FilmError::MergeNothing.into());
        };
        let mut merging = Merging::of(first?)?;
        for part in parts {
            merging.add(part?)?;
        }
        Ok(merging.finish()?)
    }
}

/// Shards that have been joined so far.
struct Merging {
    whole: Picture,
    /// Which shard each pixel is from, as an index of `names`.
    owner: Vec<u32>,
    names: Vec<String>,
}

/// The owner of a pixel that no shard has had so far.
const NOBODY: u32 = u32::MAX;

impl Merging {
    fn of(first: (String, Picture)) -> Result<Self, FilmError> {
        let (width, height) = (first.1.width, first.1.height);
        let whole = Picture::new(width, height);
        let mut merging = Merging {
            owner: vec![NOBODY; whole.samples.len()],
            whole,
            names: Vec::new(),
        };
        merging.add(first)?;
        Ok(merging)
    }

    fn place(&self, i: usize) -> (u32, u32) {
        let width = self.whole.width as usize;
        ((i % width) as u32, (i / width) as u32)
    }

    fn add(&mut self, (name, part): (String, Picture)) -> Result<(), FilmError> {
        part.assert_lengths();
        let whole = &mut self.whole;
        if (part.width, part.height) != (whole.width, whole.height) {
            return Err(FilmError::Size {
                name,
                width: part.width,
                height: part.height,
                other: self.names[0].clone(),
                expected_width: whole.width,
                expected_height: whole.height,
            });
        }
        if !part.is_divided() {
            whole.direct = Vec::new();
            whole.indirect = Vec::new();
        }
        let own_number = self.names.len() as u32;
        let mut overlap: Option<(usize, u32)> = None; // first pixel, its owner
        let mut overlapping = 0;
        for i in (0..self.owner.len()).filter(|&i| part.samples[i] > 0) {
            let other = self.owner[i];
            if other != NOBODY {
                let (_, reported) = *overlap.get_or_insert((i, other));
                overlapping += usize::from(reported == other);
                continue;
            }
            self.owner[i] = own_number;
            let layers = whole.colours_mut().into_iter().zip(part.colours());
            for (layer, own) in layers.filter(|(layer, _)| !layer.is_empty()) {
                layer[i] = own[i];
            }
            whole.depth[i] = part.depth[i];
            whole.samples[i] = part.samples[i];
        }
        if let Some((i, other)) = overlap {
            let (x, y) = self.place(i);
            return Err(FilmError::MergeOverlap {
                first: self.names[other as usize].clone(),
                second: name,
                count: overlapping,
                x,
                y,
            });
        }
        self.names.push(name);
        Ok(())
    }

    fn finish(self) -> Result<Picture, FilmError> {
        let without = self.owner.iter().enumerate();
        let mut without = without.filter(|(_, owner)| **owner == NOBODY);
        if let Some((i, _)) = without.next() {
            let (x, y) = self.place(i);
            return Err(FilmError::MergeMissing {
                count: 1 + without.count(),
                total: self.owner.len(),
                names: self.names.join(", "),
                x,
                y,
            });
        }
        Ok(self.whole)
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
    use crate::{CameraMatrices, read_image};

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
        for pixel in picture.colours_mut().into_iter().flatten() {
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
        let layers = picture.colours().into_iter().flatten();
        let colours = layers.flat_map(|v| v.to_array());
        colours
            .chain(picture.depth.iter().copied())
            .map(f32::to_bits)
            .chain(picture.samples.iter().copied())
            .collect()
    }

    fn metadata() -> Metadata {
        let number = |first: u8| std::array::from_fn(|i| f32::from(first) + 0.1 * i as f32);
        Metadata {
            texts: texts(),
            camera: Some(CameraMatrices {
                world_to_camera: number(0),
                world_to_ndc: number(100),
            }),
        }
    }

    fn texts() -> Vec<(String, String)> {
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
            picture.write_exr(&path, &metadata()).expect("writes");
            let (read, found) = Picture::read_exr(&path).expect("reads");
            assert_eq!((read.width, read.height), (width, height), "size");
            assert_eq!(bits(&read), bits(&picture), "bits of {width}x{height}");
            let mut expected = metadata();
            expected.texts.sort();
            assert_eq!(found, expected, "metadata");
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
        let mut metadata = metadata();
        let path = folder.path().join("a.exr");
        picture.write_exr(&path, &metadata).expect("writes");
        let first = fs::read(&path).expect("reads");
        for _ in 0..8 {
            metadata.texts.rotate_left(1);
            picture.write_exr(&path, &metadata).expect("writes");
            assert!(fs::read(&path).expect("reads") == first, "the bytes differ");
        }
    }

    #[test]
    fn attributes_that_exr_cannot_hold_are_refused() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a.exr");
        let pair = |name: &str| (name.to_string(), "value".to_string());
        let of = |texts: Vec<(String, String)>| Metadata {
            texts,
            camera: None,
        };
        for bad in [
            vec![pair("")],
            vec![pair(&"x".repeat(250))],
            vec![pair("a\0b")],
            vec![pair("a"), pair("a")],
        ] {
            let error = Picture::new(2, 2)
                .write_exr(&path, &of(bad))
                .expect_err("no such attribute");
            assert!(error.to_string().contains("a.exr: attribute"), "{error}");
            assert!(!path.exists(), "nothing is written");
        }
        // A name that EXR itself uses is as good as any.
        Picture::new(2, 2)
            .write_exr(&path, &of(vec![pair("channels"), pair("comments")]))
            .expect("writes");
        assert_eq!(
            Picture::read_exr(&path).expect("reads").1,
            of(vec![pair("channels"), pair("comments")]),
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
                picture.write_exr(&path, &Metadata::default()).is_err(),
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
            .write_exr(&path, &metadata())
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
        Picture::new(16, 16)
            .write_exr(&path, &Metadata::default())
            .expect("writes");
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
        Picture::new(16, 16)
            .write_exr(&path, &Metadata::default())
            .expect("writes");
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
        awkward(9, 20)
            .write_exr(&path, &Metadata::default())
            .expect("writes");
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
        write_part(&path, 2, 1, channels, &Metadata::default()).expect("writes");
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
        write_part(&path, 2, 1, channels, &Metadata::default()).expect("writes");
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

    fn merge(parts: &[(String, Picture)]) -> Result<Picture, FilmError> {
        Picture::merge(parts.iter().cloned().map(Ok))
    }

    #[test]
    fn merged_shards_are_the_whole_picture_to_the_bit() {
        let whole = awkward(13, 7);
        for count in [1, 2, 5] {
            let mut parts = shards(&whole, count);
            assert_eq!(
                bits(&merge(&parts).expect("merges")),
                bits(&whole),
                "{count} shards"
            );
            parts.reverse();
            assert_eq!(
                bits(&merge(&parts).expect("merges")),
                bits(&whole),
                "{count} shards, reversed"
            );
        }
    }

    #[test]
    fn direct_and_indirect_light_may_be_missing_and_are_then_missing_in_what_is_merged() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("old.exr");
        let mut parts = shards(&awkward(13, 7), 2);
        let old = &mut parts[1].1;
        old.direct.clear();
        old.indirect.clear();
        old.write_exr(&path, &metadata()).expect("writes");
        let (read, _) = Picture::read_exr(&path).expect("reads");
        assert_eq!(bits(&read), bits(old), "what an older version wrote");
        let merged = merge(&parts).expect("merges");
        assert!(!merged.is_divided(), "half of a layer is none");
        assert_eq!(merged.radiance, awkward(13, 7).radiance, "radiance");
    }

    #[test]
    fn shards_that_do_not_fit_are_refused_and_say_why() {
        let whole = awkward(13, 7);
        let message =
            |parts: &[(String, Picture)]| merge(parts).expect_err("does not fit").to_string();
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
