//! `index.html`: tables, plots and pictures to compare, in a folder that needs no network.
//!
//! A page from a disk may not read pixels of image files, but may run scripts beside it: each picture is a script
//! with its linear radiance as half floats and its HDR-FLIP map, loaded when it is first shown.

use std::path::Path;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use film::{Image, PIXELS_PER_DEGREE};
use serde::Serialize;

use crate::animation::Flickering;
use crate::browser::{COLOURS, HalfFloats, STYLE, filled};
use crate::cell::{Cell, Figures};
use crate::plot::Plot;
use crate::reference::Reference;
use crate::results::{Machine, Results, Series};
use crate::statistics::Spread;
use crate::store::{Store, write_with};
use crate::{ExperimentError, Outcome};

const TEMPLATE: &str = include_str!("page/index.html");
/// One script: they share their names.
const SCRIPTS: [&str; 4] = [
    COLOURS,
    include_str!("page/pictures.js"),
    include_str!("page/comparer.js"),
    include_str!("page/tables.js"),
];

/// All that the page shows.
#[derive(Serialize)]
struct Data<'a> {
    title: &'a str,
    about: &'a str,
    quick: bool,
    machine: &'a Machine,
    references: &'a [Reference],
    places: Vec<Place<'a>>,
    series: Vec<Row<'a>>,
    plots: &'a [Plot],
    animations: &'a [Flickering],
    failures: Vec<String>,
}

/// A scene under some lights.
#[derive(Serialize)]
struct Place<'a> {
    scene: &'a str,
    lights: &'a str,
    /// Factor that brings its reference to a middle brightness.
    exposure: f32,
    crops: &'a [[f32; 4]],
    frames: Vec<Frame<'a>>,
}

/// The pictures of a frame.
#[derive(Serialize)]
struct Frame<'a> {
    #[serde(skip)]
    number: u32,
    reference: &'a str,
    pictures: Vec<Shown<'a>>,
}

#[derive(Serialize)]
struct Shown<'a> {
    label: String,
    budget: &'a str,
    key: &'a str,
    relmse: Option<f64>,
}

/// A row of the table of figures.
#[derive(Serialize)]
struct Row<'a> {
    scene: &'a str,
    lights: &'a str,
    label: String,
    budget: &'a str,
    spp: Option<Spread>,
    seconds: Option<Spread>,
    cpu_seconds: Option<Spread>,
    mrays: Option<Spread>,
    relmse: Option<Spread>,
    mape: Option<Spread>,
    hdr_flip: Option<Spread>,
    flip: Option<Spread>,
    bias: Option<Spread>,
    bias_95: Option<Spread>,
    local_bias: Option<Spread>,
    local_bias_95: Option<Spread>,
    product: Option<Spread>,
    suspicious: bool,
}

impl<'a> Row<'a> {
    fn of(series: &Series<'a>, with_tree: bool) -> Self {
        Self {
            scene: series.scene,
            lights: series.lights,
            label: series.label(with_tree),
            budget: series.budget,
            spp: series.spread(|f| Some(f64::from(f.spp))),
            seconds: series.spread(|f| Some(f.seconds.render)),
            cpu_seconds: series.spread(|f| f.cpu_seconds),
            mrays: series.spread(|f| Some(f.shadow_rays as f64 * 1e-6)),
            relmse: series.error(|e| e.relmse),
            mape: series.error(|e| e.mape),
            hdr_flip: series.error(|e| e.hdr_flip),
            flip: series.error(|e| e.flip),
            bias: series.error(|e| e.bias),
            bias_95: series.error(|e| e.bias_95),
            local_bias: series.error(|e| e.local_bias),
            local_bias_95: series.error(|e| e.local_bias_95),
            product: series.spread(|f| Some(f.error.relmse? * f.cpu_seconds?)),
            suspicious: series.is_suspicious(),
        }
    }
}

/// Writes `index.html` and the pictures it shows, those of cells whose EXR was kept, into the store's folder.
/// Plots and previews of animations are there already.
///
/// # Errors
/// Names the file that could not be read or written.
pub fn write_page(store: &Store, results: &Results, plots: &[Plot]) -> Result<(), ExperimentError> {
    let series = results.series();
    let with_tree = results.has_trees();
    let mut failures: Vec<String> = Vec::new();
    for cell in &results.cells {
        if let Outcome::Failed(message) = &cell.outcome {
            let c = &cell.coordinates;
            let told = format!(
                "{}, {}, {}, {}: {message}",
                c.scene, c.lights, c.method, c.budget
            );
            if !failures.contains(&told) {
                failures.push(told);
            }
        }
    }
    let data = Data {
        title: &results.title,
        about: &results.about,
        quick: results.quick,
        machine: &results.machine,
        references: &results.references,
        places: places(store, results, with_tree)?,
        series: series.iter().map(|s| Row::of(s, with_tree)).collect(),
        plots,
        animations: &results.animations,
        failures,
    };
    // `<` would let text end the script.
    let data = serde_json::to_string(&data)
        .map_err(|error| ExperimentError::Page(error.to_string()))?
        .replace('<', "\\u003c");
    let page = filled(TEMPLATE, |name| match name {
        "title" => escaped(&results.title),
        "style" => STYLE.to_owned(),
        "scripts" => SCRIPTS.join("\n"),
        "data" => data.clone(),
        _ => unreachable!("the template has no other gap: {name}"),
    });
    let path = store.folder().join("index.html");
    write_with(&path, |file| file.write_all(page.as_bytes()))
}

/// Text as HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

/// What there are pictures of, which are written.
fn places<'a>(
    store: &Store,
    results: &'a Results,
    with_tree: bool,
) -> Result<Vec<Place<'a>>, ExperimentError> {
    let mut places: Vec<Place<'a>> = Vec::new();
    for cell in &results.cells {
        let Some(figures) = cell.figures() else {
            continue;
        };
        let (picture, reference) = (
            store.cell(&figures.key, "exr"),
            store.reference(&figures.reference, "exr"),
        );
        if !picture.is_file() || !reference.is_file() {
            continue;
        }
        let reference = film::read_image(&reference)?;
        write_picture(store, &figures.reference, &reference, None)?;
        write_cell(store, &figures.key, &picture, &reference)?;
        let c = &cell.coordinates;
        let own = |p: &&mut Place<'_>| (p.scene, p.lights) == (&*c.scene, &*c.lights);
        let place = match places.iter_mut().find(own) {
            Some(place) => place,
            None => {
                let view = results.scenes.iter().find(|s| s.name == c.scene);
                places.push(Place {
                    scene: &c.scene,
                    lights: &c.lights,
                    exposure: film::auto_exposure(&reference.pixels),
                    crops: view.map_or(&[], |v| &v.crops),
                    frames: Vec::new(),
                });
                let last = places.len() - 1;
                &mut places[last]
            }
        };
        place.show(cell, figures, with_tree);
    }
    Ok(places)
}

impl<'a> Place<'a> {
    fn show(&mut self, cell: &'a Cell, figures: &'a Figures, with_tree: bool) {
        let c = &cell.coordinates;
        let at = match self.frames.iter().position(|f| f.number == c.frame) {
            Some(at) => at,
            None => {
                self.frames.push(Frame {
                    number: c.frame,
                    reference: &figures.reference,
                    pictures: Vec::new(),
                });
                self.frames.len() - 1
            }
        };
        self.frames[at].pictures.push(Shown {
            label: c.label(with_tree),
            budget: &c.budget,
            key: &figures.key,
            relmse: figures.error.relmse,
        });
    }
}

/// Writes a cell's picture for the page, with its FLIP map, unless it is there: names are hashes of content.
fn write_cell(
    store: &Store,
    key: &str,
    exr: &Path,
    reference: &Image,
) -> Result<(), ExperimentError> {
    if script(store, key).is_file() {
        return Ok(());
    }
    let image = film::read_image(exr)?;
    let flip = film::flip_map(&image, reference, PIXELS_PER_DEGREE)?;
    write_picture(store, key, &image, Some(&flip))
}

fn script(store: &Store, key: &str) -> std::path::PathBuf {
    store.folder().join("pictures").join(format!("{key}.js"))
}

/// The call `addPicture(key, width, height, scale, colours, flip)`: half floats, red, green, blue, pixel by pixel,
/// little-endian, which times `scale` are radiance; FLIP in a byte a pixel, 255 being 1.
fn write_picture(
    store: &Store,
    key: &str,
    image: &Image,
    flip: Option<&[f32]>,
) -> Result<(), ExperimentError> {
    let path = script(store, key);
    if path.is_file() {
        return Ok(());
    }
    let HalfFloats { scale, bytes } = HalfFloats::of(image);
    let flip = flip.map(|map| {
        let bytes: Vec<u8> = map.iter().map(|v| (255.0 * v + 0.5) as u8).collect();
        BASE64_STANDARD.encode(bytes)
    });
    write_with(&path, |file| {
        write!(
            file,
            "addPicture(\"{key}\", {}, {}, {scale:e}, \"{}\", \"{}\");",
            image.width,
            image.height,
            BASE64_STANDARD.encode(bytes),
            flip.unwrap_or_default()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_results::{image, results};
    use film::{Metadata, Picture};

    fn page(change: fn(&mut Results)) -> (tempfile::TempDir, String) {
        let folder = tempfile::tempdir().expect("temporary folder");
        let store = Store::new(folder.path());
        let mut results = results();
        change(&mut results);
        let reference = image(1.0);
        let mut picture = Picture::new(32, 18);
        picture.radiance.clone_from(&reference.pixels);
        picture
            .write_exr(&store.reference("ref", "exr"), &Metadata::default())
            .expect("writes");
        for key in ["room-one-1", "room-two-1"] {
            let path = store.cell(key, "exr");
            image(1.1)
                .write_exr(&path, &Metadata::default())
                .expect("writes");
        }
        write_page(&store, &results, &[]).expect("writes");
        let text = std::fs::read_to_string(folder.path().join("index.html"));
        (folder, text.expect("reads"))
    }

    #[test]
    fn the_page_holds_its_data_and_asks_nothing_of_a_network() {
        let (folder, page) = page(|_| {});
        for part in [
            "<title>Two methods, made up</title>",
            "\"places\":[{\"scene\":\"room\"",
            "\"key\":\"room-two-1\"",
            "hall, lamps, one, 4 spp: there is",
            "\"crops\":[[0.25,0.25,0.5,0.5]]",
        ] {
            assert!(page.contains(part), "no {part}");
        }
        for part in ["http://", "https://", "{{", "<fast>"] {
            assert!(!page.contains(part), "{part} in the page");
        }
        let picture = folder.path().join("pictures/room-one-1.js");
        let picture = std::fs::read_to_string(picture).expect("reads");
        assert!(
            picture.starts_with("addPicture(\"room-one-1\", 32, 18, "),
            "{picture}"
        );
    }

    #[test]
    fn text_cannot_end_the_script() {
        let (_folder, page) = page(|r| r.title = "</script><b>{{scripts}}".into());
        assert_eq!(page.matches("</script>").count(), 1, "the script's own end");
        assert_eq!(page.matches("\nbegin();").count(), 1, "the script once");
        assert!(page.contains("<title>&lt;/script>"), "the title");
    }
}
