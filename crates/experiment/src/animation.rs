//! Animations: how much each method flickers, and a preview that moves.

use std::path::Path;

use film::{FLICKER_BLOCK, Flicker, Image};
use serde::Serialize;

use crate::ExperimentError;
use crate::cell::{Cell, Coordinates, Figures};
use crate::results::Results;
use crate::store::{Store, write_with};

/// Frames of one method, and how they flicker.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Flickering {
    /// Name of the scene.
    pub scene: String,
    /// Name of the light set.
    pub lights: String,
    /// Method and, where there are several, tree.
    pub label: String,
    /// What ended each frame's render.
    pub budget: String,
    /// [`Flicker::pixel`].
    pub pixel: f64,
    /// [`Flicker::block`].
    pub block: f64,
    /// How alike neighbours flicker: `block` over what it would be if pixels flickered independently of one
    /// another, `pixel`/64. 1 is noise, 64 a picture that blinks as a whole; `None` without any flicker.
    pub pattern: Option<f64>,
    /// Name of the animated PNG in `animations/`.
    pub preview: String,
}

/// Pixels of a block.
const BLOCK_PIXELS: f64 = (FLICKER_BLOCK * FLICKER_BLOCK) as f64;

/// Milliseconds that the preview shows a frame.
const FRAME_MILLISECONDS: u16 = 125;

/// Measures the flicker of all series of frames whose pictures were kept, and writes their previews.
///
/// # Errors
/// Names the file that could not be read or written.
pub fn write_animations(
    store: &Store,
    results: &Results,
) -> Result<Vec<Flickering>, ExperimentError> {
    let mut found = Vec::new();
    for first in results.cells.iter().filter(|c| c.coordinates.frame == 0) {
        let frames = frames(store, results, &first.coordinates);
        if frames.len() < 2 {
            continue;
        }
        let read = |(figures, _): &(&Figures, &Cell)| -> Result<(Image, Image), ExperimentError> {
            let reference = film::read_image(&store.reference(&figures.reference, "exr"))?;
            let image = film::read_image(&store.cell(&figures.key, "exr"))?;
            Ok((image, reference))
        };
        let (images, references): (Vec<Image>, Vec<Image>) = frames
            .iter()
            .map(read)
            .collect::<Result<Vec<_>, _>>()?
            .into_iter()
            .unzip();
        let Some(Flicker { pixel, block }) = Flicker::of(&images, &references)? else {
            continue;
        };
        let exposure = film::auto_exposure(&references[0].pixels);
        let preview = format!("{}.png", frames[0].0.key);
        let path = store.folder().join("animations").join(&preview);
        write_preview(&path, &images, exposure)?;
        let c = &first.coordinates;
        found.push(Flickering {
            scene: c.scene.clone(),
            lights: c.lights.clone(),
            label: c.label(results.has_trees()),
            budget: c.budget.clone(),
            pixel,
            block,
            pattern: (pixel > 0.0).then(|| block / (pixel / BLOCK_PIXELS)),
            preview,
        });
    }
    Ok(found)
}

/// The frames that differ from `first` in their number only, in order, as far as their pictures were kept.
fn frames<'a>(
    store: &Store,
    results: &'a Results,
    first: &Coordinates,
) -> Vec<(&'a Figures, &'a Cell)> {
    let alike = |c: &Coordinates| {
        Coordinates {
            frame: first.frame,
            ..c.clone()
        } == *first
    };
    let mut frames: Vec<(&Figures, &Cell)> = results
        .cells
        .iter()
        .filter(|cell| alike(&cell.coordinates))
        .filter_map(|cell| Some((cell.figures()?, cell)))
        .filter(|(figures, _)| store.cell(&figures.key, "exr").is_file())
        .collect();
    frames.sort_by_key(|(_, cell)| cell.coordinates.frame);
    frames
}

/// An animated PNG of equally large frames, which repeats for ever.
fn write_preview(path: &Path, images: &[Image], exposure: f32) -> Result<(), ExperimentError> {
    let (width, height) = (images[0].width, images[0].height);
    write_with(path, |file| {
        let mut encoder = png::Encoder::new(file, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_animated(images.len() as u32, 0)?;
        encoder.set_frame_delay(FRAME_MILLISECONDS, 1000)?;
        let mut writer = encoder.write_header()?;
        for image in images {
            writer.write_image_data(&film::tone_map(&image.pixels, exposure))?;
        }
        writer.finish()?;
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Outcome;
    use crate::test_results::{cell, results};
    use film::{Metadata, Picture};
    use glam::Vec3;

    fn flat(value: f32) -> Image {
        Image {
            width: 16,
            height: 8,
            pixels: vec![Vec3::splat(value); 128],
        }
    }

    #[test]
    fn a_jump_is_measured_and_the_preview_has_all_frames() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let store = Store::new(folder.path());
        let mut results = results();
        results.cells.clear();
        let mut reference = Picture::new(16, 8);
        reference.radiance = flat(1.0).pixels;
        let path = store.reference("ref", "exr");
        reference
            .write_exr(&path, &Metadata::default())
            .expect("writes");
        // Out of order, as frames may come.
        for (frame, value) in [(1, 1.5), (0, 1.0), (2, 1.5)] {
            let mut one = cell("room", "one", 1, 1.0);
            one.coordinates.frame = frame;
            let Outcome::Done(figures) = &mut one.outcome else {
                unreachable!("made so")
            };
            figures.key = format!("frame-{frame}");
            let path = store.cell(&figures.key, "exr");
            flat(value)
                .write_exr(&path, &Metadata::default())
                .expect("writes");
            results.cells.push(one);
        }
        let found = write_animations(&store, &results).expect("writes");
        assert_eq!(found.len(), 1, "{found:?}");
        // One step of 0.5 and one of none, over 1 + 0.01.
        let expected = 0.5 * 0.25 / 1.01;
        assert!((found[0].block - expected).abs() < 1e-9, "{found:?}");
        let pattern = found[0].pattern.expect("it flickers");
        assert!((pattern - 64.0).abs() < 1e-6, "all of it blinks: {pattern}");
        let file = std::fs::File::open(folder.path().join("animations/frame-0.png"));
        let file = std::io::BufReader::new(file.expect("there"));
        let reader = png::Decoder::new(file).read_info().expect("PNG");
        let frames = reader.info().animation_control.map(|a| a.num_frames);
        assert_eq!(frames, Some(3), "frames");
    }

    #[test]
    fn stills_have_no_animation() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let found = write_animations(&Store::new(folder.path()), &results()).expect("nothing");
        assert!(found.is_empty(), "{found:?}");
    }
}
