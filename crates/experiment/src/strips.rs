//! Enlarged crops of all methods side by side, as a supplement prints them.

use film::Image;

use crate::ExperimentError;
use crate::cell::Cell;
use crate::results::Results;
use crate::store::Store;

/// The crops of a scene under some lights: a row for each crop, a column for each method, and one for the reference.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Strip {
    /// Name of the scene.
    pub scene: String,
    /// Name of the light set.
    pub lights: String,
    /// Name of its file in `plots/`.
    pub file: String,
    /// What the columns show, but for the last.
    pub labels: Vec<String>,
}

/// Pixels of a strip, across and down, for one of a picture.
const SCALE: usize = 3;
/// White pixels between crops.
const GAP: usize = 4;

/// Writes a strip for each scene that names crops, from the pictures that were kept: of each method the one of the
/// last budget and the first seed, in its first frame.
///
/// # Errors
/// Names the file that could not be read or written.
pub fn write_strips(store: &Store, results: &Results) -> Result<Vec<Strip>, ExperimentError> {
    let mut strips: Vec<Strip> = Vec::new();
    for first in &results.cells {
        let (scene, lights) = (&first.coordinates.scene, &first.coordinates.lights);
        let view = results.scenes.iter().find(|s| s.name == *scene);
        let crops = view.map_or(&[][..], |v| &v.crops);
        let is_made = |s: &Strip| (&s.scene, &s.lights) == (scene, lights);
        if crops.is_empty() || strips.iter().any(is_made) {
            continue;
        }
        let columns = columns(store, results, first);
        let Some(reference) = columns.first().and_then(|c| c.figures()) else {
            continue;
        };
        let reference = film::read_image(&store.reference(&reference.reference, "exr"))?;
        let mut images = Vec::new();
        for figures in columns.iter().filter_map(|c| c.figures()) {
            images.push(film::read_image(&store.cell(&figures.key, "exr"))?);
        }
        images.push(reference);
        let file = format!("{}-crops.png", strips.len() + 1);
        let Mosaic {
            width,
            height,
            values,
        } = mosaic(&images, crops);
        let path = store.folder().join("plots").join(&file);
        film::write_rgb8(&path, width as u32, height as u32, &values)?;
        let label = |c: &&Cell| c.coordinates.label(results.has_trees());
        strips.push(Strip {
            scene: scene.clone(),
            lights: lights.clone(),
            file,
            labels: columns.iter().map(label).collect(),
        });
    }
    Ok(strips)
}

/// A kept cell of each method where `first` is, of its seed.
fn columns<'a>(store: &Store, results: &'a Results, first: &Cell) -> Vec<&'a Cell> {
    let at = &first.coordinates;
    let with_tree = results.has_trees();
    let mut columns: Vec<&Cell> = Vec::new();
    for cell in &results.cells {
        let c = &cell.coordinates;
        let is_here = (&c.scene, &c.lights, c.seed, c.frame) == (&at.scene, &at.lights, at.seed, 0);
        let is_kept = |key| store.cell(key, "exr").is_file();
        if !is_here || !cell.figures().is_some_and(|f| is_kept(&f.key)) {
            continue;
        }
        let label = c.label(with_tree);
        match columns
            .iter_mut()
            .find(|other| other.coordinates.label(with_tree) == label)
        {
            Some(other) => *other = cell,
            None => columns.push(cell),
        }
    }
    columns
}

/// Display values, three bytes a pixel.
struct Mosaic {
    width: usize,
    height: usize,
    values: Vec<u8>,
}

/// The `crops` of equally large `images`, at the exposure that suits the last.
fn mosaic(images: &[Image], crops: &[[f32; 4]]) -> Mosaic {
    let last = &images[images.len() - 1];
    let exposure = film::auto_exposure(&last.pixels);
    let (columns, rows) = (last.width as usize, last.height as usize);
    let span = |from: f32, share: f32, whole: usize| {
        let size = ((share * whole as f32).round() as usize).clamp(1, whole);
        let from = ((from * whole as f32).round() as usize).min(whole - size);
        from..from + size
    };
    let places: Vec<_> = crops
        .iter()
        .map(|&[left, top, width, height]| (span(left, width, columns), span(top, height, rows)))
        .collect();
    let widest = places.iter().map(|(x, _)| x.len()).max().unwrap_or(0);
    let step = SCALE * widest + GAP;
    let width = images.len() * step - GAP;
    let heights = places.iter().map(|(_, y)| SCALE * y.len() + GAP);
    let height = heights.sum::<usize>() - GAP;
    let mut values = vec![255; 3 * width * height];
    for (i, image) in images.iter().enumerate() {
        let shown = film::tone_map(&image.pixels, exposure);
        let mut top = 0;
        for (x, y) in &places {
            for row in 0..SCALE * y.len() {
                for column in 0..SCALE * x.len() {
                    let from = 3 * ((y.start + row / SCALE) * columns + x.start + column / SCALE);
                    let to = 3 * ((top + row) * width + i * step + column);
                    values[to..to + 3].copy_from_slice(&shown[from..from + 3]);
                }
            }
            top += SCALE * y.len() + GAP;
        }
    }
    Mosaic {
        width,
        height,
        values,
    }
}

#[cfg(test)]
mod tests {
    use film::Metadata;

    use super::*;
    use crate::test_results::{cell, image, results};

    #[test]
    fn a_strip_has_a_column_for_each_method_that_was_kept_and_one_for_the_reference() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let store = Store::new(folder.path());
        let mut results = results();
        // A later budget of the first method, and another seed, which is not shown.
        for (seed, budget) in [(1, "8 spp"), (2, "16 spp")] {
            let mut later = cell("room", "one", seed, 1.0);
            later.coordinates.budget = budget.into();
            results.cells.push(later);
        }
        let exr = |path: &std::path::Path, brightest| {
            let written = image(brightest).write_exr(path, &Metadata::default());
            written.expect("writes");
        };
        exr(&store.reference("ref", "exr"), 1.0);
        exr(&store.cell("room-one-1", "exr"), 2.0);
        let strips = write_strips(&store, &results).expect("writes");
        let [strip] = &strips[..] else {
            panic!("one strip: {strips:?}")
        };
        assert_eq!(strip.labels, ["one"], "kept");
        let path = folder.path().join("plots").join(&strip.file);
        let file = std::fs::File::open(path).expect("opens");
        let mut reader = png::Decoder::new(std::io::BufReader::new(file))
            .read_info()
            .expect("is a PNG");
        // Half of 32 × 18 pixels, twice.
        assert_eq!(
            (reader.info().width, reader.info().height),
            (2 * 48 + 4, 27)
        );
        let mut values = vec![0; reader.output_buffer_size().expect("small")];
        reader.next_frame(&mut values).expect("decodes");
        let at = |x: usize| values[3 * (13 * 100 + x)];
        assert!(
            at(20) > at(52 + 20),
            "the first is brighter: {} {}",
            at(20),
            at(72)
        );
        assert_eq!(at(49), 255, "white between");
    }

    #[test]
    fn without_crops_there_is_none() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let mut results = results();
        results.scenes[0].crops.clear();
        let strips = write_strips(&Store::new(folder.path()), &results).expect("has nothing to do");
        assert!(strips.is_empty(), "{strips:?}");
    }
}
