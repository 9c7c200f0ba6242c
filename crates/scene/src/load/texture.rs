//! PNG and JPEG files.

use std::collections::HashMap;
use std::io::Cursor;

use image::{ImageReader, Limits};

use crate::load::source::Source;
use crate::load::unreadable;
use crate::{SceneError, Texture, TextureId};

/// Texels a side at most: a small file must not claim the whole memory.
const LARGEST: u32 = 16384;

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

impl Wanted {
    pub(super) fn load(&self) -> Result<Texture, SceneError> {
        self.decode()
            .map_err(|message| SceneError::file(&self.named_by, message))
    }

    fn decode(&self) -> Result<Texture, String> {
        let bytes = self.source.read(&self.name);
        let bytes = bytes.map_err(|e| unreadable(&self.source, &self.name, &e))?;
        let wrong = |e: &dyn std::fmt::Display| format!("{}: {e}", self.shown);
        let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
        let mut reader = reader.map_err(|e| wrong(&e))?;
        if reader.format().is_none() {
            return Err(wrong(&"not a PNG or JPEG file"));
        }
        let mut limits = Limits::default();
        limits.max_image_width = Some(LARGEST);
        limits.max_image_height = Some(LARGEST);
        limits.max_alloc = Some(MOST_BYTES);
        reader.limits(limits);
        let image = reader.decode().map_err(|e| match e {
            image::ImageError::Limits(_) => wrong(&format_args!(
                "{e}; expected at most {LARGEST} × {LARGEST} texels"
            )),
            e => wrong(&e),
        })?;
        let has_alpha = image.color().has_alpha();
        let image = image.into_rgba8();
        let (width, height) = image.dimensions();
        if width == 0 || height == 0 {
            return Err(wrong(&"the image has no texels"));
        }
        Ok(Texture {
            path: self.shown.clone(),
            width,
            height,
            texels: image.pixels().map(|p| p.0).collect(),
            has_alpha,
        })
    }
}
