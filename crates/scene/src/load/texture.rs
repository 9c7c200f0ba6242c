//! PNG and JPEG files.

use image::ImageFormat;
use rayon::prelude::*;
use std::collections::HashMap;

use crate::load::decode::{claimed_texels, decode};
use crate::load::source::Source;
use crate::load::{Fits, unreadable};
use crate::{SceneError, Texture, TextureId};

/// Bytes a decoder may use: 16384 × 16384 texels of four bytes.
const MOST_BYTES: u64 = 1 << 30;

/// A texture that a material names.
#[derive(Debug)]
pub(super) struct Wanted {
    pub(super) source: Source,
    /// Name in the source.
    pub(super) name: String,
    /// Full name, which tells textures apart.
    pub(super) shown: String,
    /// Where it is named first: `scene.mtl:3: map_Kd`.
    pub(super) named_by: String,
}

/// All textures that materials name; one entry per file.
#[derive(Debug, Default)]
pub(super) struct WantedList {
    list: Vec<Wanted>,
    by_name: HashMap<String, TextureId>,
}

impl WantedList {
    /// The id of a texture, which is added when it is new.
    pub(super) fn id(&mut self, wanted: Wanted) -> TextureId {
        if let Some(&id) = self.by_name.get(&wanted.shown) {
            return id;
        }
        // One line or JSON object each: fewer than 2³² in any text that fits in memory.
        let id = TextureId(u32::try_from(self.list.len()).unwrap_or(u32::MAX));
        self.by_name.insert(wanted.shown.clone(), id);
        self.list.push(wanted);
        id
    }

    /// Indexed by [`TextureId`].
    pub(super) fn all(&self) -> &[Wanted] {
        &self.list
    }
}

/// Bytes a texel that stays …
const KEPT: u64 = 4;
/// … and beside it while a file is decoded: as the file has it, eight bytes in a PNG of 16 bits, or once more as four.
const DECODING: u64 = 8;

/// Refuses textures that would not fit, by what their headers claim. What is wrong with a file is said when it is decoded.
pub(super) fn refuse_too_large(wanted: &[Wanted], fits: Fits<'_>) -> Result<(), String> {
    let texels = wanted.par_iter().map(|w| match &w.source {
        Source::Disk(folder) => claimed_texels(std::fs::File::open(folder.join(&w.name)).ok()?),
        // Those of built-in scenes are in memory already, and small.
        Source::Memory { .. } => None,
    });
    let mut texels: Vec<u64> = texels.flatten().collect();
    texels.sort_unstable();
    let largest = texels.iter().rev().take(rayon::current_num_threads());
    let bytes = KEPT * texels.iter().sum::<u64>() + DECODING * largest.sum::<u64>();
    let files = texels.len();
    fits(bytes).map_err(|message| format!("its textures ({files} in all) need {message}"))
}

impl Wanted {
    pub(super) fn load(&self) -> Result<Texture, SceneError> {
        self.decode()
            .map_err(|message| SceneError::file(&self.named_by, message))
    }

    fn decode(&self) -> Result<Texture, String> {
        let bytes = self.source.read(&self.name);
        let bytes = bytes.map_err(|e| unreadable(&self.source, &self.name, &e))?;
        let formats = [ImageFormat::Png, ImageFormat::Jpeg];
        let decoded = decode(&bytes, &formats, "a PNG or JPEG", MOST_BYTES);
        let image = decoded
            .map_err(|message| format!("{}: {message}", self.shown))?
            .image;
        let has_alpha = image.color().has_alpha();
        let image = image.into_rgba8();
        let (width, height) = image.dimensions();
        Ok(Texture {
            path: self.shown.clone(),
            width,
            height,
            texels: image.pixels().map(|p| p.0).collect(),
            has_alpha,
        })
    }
}
