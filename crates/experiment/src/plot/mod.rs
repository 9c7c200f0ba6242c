//! Plots, each as SVG and as PNG.
//!
//! The same code draws both; letters in the PNG come from a font in the program, so that no system font is needed.
//! Curves differ in colour, in dashes and in markers, so that a grey print can be read.

mod axis;
mod collect;
mod curves;
mod ink;
mod shares;

use std::path::Path;
use std::sync::Once;

use plotters::coord::Shift;
use plotters::prelude::{BitMapBackend, DrawingArea, DrawingBackend, IntoDrawingArea, SVGBackend};
use plotters::style::{FontStyle, WHITE, register_font};
use serde::Serialize;

use crate::ExperimentError;
use crate::results::Results;
use crate::store::write_with;

/// Columns and rows of a plot in the SVG's unit.
const SIZE: (u32, u32) = (880, 480);
/// Pixels of the PNG per unit.
const PNG_SCALE: u32 = 2;

/// A plot that was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Plot {
    /// Name of its files in `plots/`, without `.svg` or `.png`.
    pub name: String,
    /// What it shows.
    pub caption: String,
}

/// What can be drawn; sizes are in units times `scale`.
trait Drawing {
    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
        scale: i32,
    ) -> Result<(), DrawError<DB>>;
}

type DrawError<DB> = plotters::drawing::DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>;

/// Draws all plots that `results` have figures for into `plots/` in `folder`.
///
/// # Errors
/// Names the file that could not be drawn or written.
pub fn write_plots(folder: &Path, results: &Results) -> Result<Vec<Plot>, ExperimentError> {
    let mut plots = Vec::new();
    for (name, caption, chart) in collect::curves(results) {
        write(folder, &name, &chart)?;
        plots.push(Plot { name, caption });
    }
    for (name, caption, chart) in collect::shares(results) {
        write(folder, &name, &chart)?;
        plots.push(Plot { name, caption });
    }
    Ok(plots)
}

fn write(folder: &Path, name: &str, drawing: &impl Drawing) -> Result<(), ExperimentError> {
    let path = |end: &str| folder.join("plots").join(format!("{name}.{end}"));
    let failed = |message: String| ExperimentError::Plot {
        path: path("svg").display().to_string(),
        message,
    };
    let svg = svg(drawing).map_err(failed)?;
    write_with(&path("svg"), |file| file.write_all(svg.as_bytes()))?;
    let (width, height) = (SIZE.0 * PNG_SCALE, SIZE.1 * PNG_SCALE);
    let pixels = bitmap(drawing, (width, height)).map_err(failed)?;
    film::write_rgb8(&path("png"), width, height, &pixels)?;
    Ok(())
}

fn svg(drawing: &impl Drawing) -> Result<String, String> {
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        draw(drawing, &root, 1)?;
    }
    Ok(text)
}

fn bitmap(drawing: &impl Drawing, size: (u32, u32)) -> Result<Vec<u8>, String> {
    let mut pixels = vec![0; 3 * size.0 as usize * size.1 as usize];
    {
        let root = BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area();
        draw(drawing, &root, PNG_SCALE as i32)?;
    }
    Ok(pixels)
}

fn draw<DB: DrawingBackend>(
    drawing: &impl Drawing,
    root: &DrawingArea<DB, Shift>,
    scale: i32,
) -> Result<(), String> {
    static FONT: Once = Once::new();
    FONT.call_once(|| {
        let font = epaint_default_fonts::UBUNTU_LIGHT;
        // The font is part of the program: it is sound.
        let _ = register_font("sans-serif", FontStyle::Normal, font);
    });
    root.fill(&WHITE)
        .and_then(|()| drawing.draw(root, scale))
        .and_then(|()| root.present())
        .map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_results::{cell, results};

    #[test]
    fn plots_have_axes_with_units_legends_slopes_and_ticks() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let plots = write_plots(folder.path(), &results()).expect("writes");
        let names: Vec<&str> = plots.iter().map(|p| &*p.name).collect();
        let expected = [
            "1-room-lamps-error-time",
            "1-room-lamps-error-cpu",
            "1-room-lamps-error-rays",
            "1-room-lamps-phases",
        ];
        assert_eq!(names, expected, "names");
        let text = |name: &str| {
            let path = folder.path().join("plots").join(format!("{name}.svg"));
            std::fs::read_to_string(path).expect("reads")
        };
        for (name, parts) in [
            (
                expected[0],
                &[
                    "relmse",
                    "render time [s]",
                    "one",
                    "two",
                    "slope \u{2212}1.00",
                    "0.1",
                    "polygon",
                    "reference",
                ][..],
            ),
            (expected[2], &["shadow rays", "1e6", "one", "two"][..]),
            (
                expected[3],
                &["share of thread time [%]", "shadow rays", "37 %", "100"][..],
            ),
        ] {
            let text = text(name);
            for part in parts {
                assert!(text.contains(part), "{name}: no {part:?} in:\n{text}");
            }
        }
    }

    #[test]
    fn png_plots_are_neither_blank_nor_without_letters() {
        let results = results();
        let (_, _, chart) = &collect::curves(&results)[0];
        let pixels = bitmap(chart, SIZE).expect("draws");
        let dark = pixels
            .chunks_exact(3)
            .filter(|p| p.iter().all(|&v| v < 100));
        assert!(dark.count() > 500, "axes and letters are dark");
        let labels = bitmap(&Unlabelled, SIZE).expect("draws");
        assert!(labels.iter().any(|&v| v < 100), "a letter is drawn");
    }

    struct Unlabelled;

    impl Drawing for Unlabelled {
        fn draw<DB: DrawingBackend>(
            &self,
            root: &DrawingArea<DB, Shift>,
            scale: i32,
        ) -> Result<(), DrawError<DB>> {
            ink::Ink { root, scale }.text("W", (100, 100), 14, ink::Place::Middle)
        }
    }

    #[test]
    fn several_numbers_of_lights_give_a_plot_of_cost() {
        let mut results = results();
        for (name, count) in [("few", 10), ("many", 10_000)] {
            let mut one = cell("room", "one", 1, 1.0);
            one.coordinates.lights = name.into();
            let crate::Outcome::Done(figures) = &mut one.outcome else {
                unreachable!("made so")
            };
            figures.light_count = count;
            results.cells.push(one);
        }
        let charts = collect::curves(&results);
        let names: Vec<&str> = charts.iter().map(|c| &*c.0).collect();
        assert!(names.contains(&"room-cost-lights"), "{names:?}");
        assert!(names.contains(&"room-error-lights"), "{names:?}");
    }

    #[test]
    fn nothing_is_drawn_of_nothing() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let mut results = results();
        results.cells.retain(|cell| cell.figures().is_none());
        let plots = write_plots(folder.path(), &results).expect("writes");
        assert!(plots.is_empty(), "{plots:?}");
    }
}
