//! `results.csv` and `results.json`.

use std::path::Path;

use serde::Serialize;

use crate::cell::{Cell, Figures};
use crate::results::{Machine, Results};
use crate::statistics::slope;
use crate::store::{write_record, write_with};
use crate::{ExperimentError, Reference};

/// A column: its name and what it says of a cell; nothing where there is nothing to say.
type Column = (&'static str, fn(&Row<'_>) -> Option<String>);

/// All that a row of the table draws on.
struct Row<'a> {
    cell: &'a Cell,
    figures: Option<&'a Figures>,
    reference: Option<&'a Reference>,
    machine: &'a Machine,
    slopes: Slopes,
}

/// Exponents of `relmse` against cost over the passes of one cell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
struct Slopes {
    seconds: Option<f64>,
    rays: Option<f64>,
}

impl Slopes {
    fn of(figures: &Figures) -> Self {
        let fit = |cost: fn(&crate::Pass) -> f64| {
            let points = figures.passes.iter();
            let points = points.filter_map(|p| Some((cost(p), p.relmse?)));
            slope(&points.collect::<Vec<_>>())
        };
        Self {
            seconds: fit(|p| p.seconds),
            rays: fit(|p| p.shadow_rays as f64),
        }
    }
}

/// Shows a value of the figures.
macro_rules! figure {
    ($name:literal, $($path:tt).+) => {
        ($name, |row: &Row<'_>| Some(row.figures?.$($path).+.to_string()))
    };
}

/// Shows a value of the figures that may be missing.
macro_rules! perhaps {
    ($name:literal, $($path:tt).+) => {
        ($name, |row: &Row<'_>| Some(row.figures?.$($path).+?.to_string()))
    };
}

#[rustfmt::skip]
const COLUMNS: &[Column] = &[
    ("scene", |row| Some(row.cell.coordinates.scene.clone())),
    ("lights", |row| Some(row.cell.coordinates.lights.clone())),
    ("method", |row| Some(row.cell.coordinates.method.clone())),
    ("tree", |row| Some(row.cell.coordinates.tree.clone())),
    ("budget", |row| Some(row.cell.coordinates.budget.clone())),
    ("seed", |row| Some(row.cell.coordinates.seed.to_string())),
    ("frame", |row| Some(row.cell.coordinates.frame.to_string())),
    ("status", |row| Some(match row.figures { Some(_) => "done", None => "failed" }.to_owned())),
    ("message", |row| match &row.cell.outcome {
        crate::Outcome::Failed(message) => Some(message.clone()),
        crate::Outcome::Done(_) => None,
    }),
    ("settings", |row| Some(row.cell.settings.clone())),
    figure!("width", width),
    figure!("height", height),
    figure!("spp", spp),
    figure!("light_count", light_count),
    figure!("triangles", triangles),
    figure!("seconds_load", seconds.load),
    figure!("seconds_bvh", seconds.bvh),
    figure!("seconds_lights", seconds.lights),
    figure!("seconds_tree", seconds.tree),
    figure!("seconds_render", seconds.render),
    perhaps!("cpu_seconds_render", cpu_seconds),
    figure!("thread_seconds_eye", phases.eye),
    figure!("thread_seconds_cut", phases.cut),
    figure!("thread_seconds_select", phases.select),
    figure!("thread_seconds_evaluate", phases.evaluate),
    figure!("thread_seconds_shadow", phases.shadow),
    figure!("rays_camera", camera_rays),
    figure!("rays_shadow", shadow_rays),
    figure!("light_samples", light_samples),
    figure!("nonfinite", nonfinite),
    perhaps!("peak_rss_bytes", peak_rss_bytes),
    perhaps!("mse", error.mse),
    perhaps!("rmse", error.rmse),
    perhaps!("relmse", error.relmse),
    perhaps!("mape", error.mape),
    perhaps!("hdr_flip", error.hdr_flip),
    perhaps!("flip", error.flip),
    perhaps!("mean_ratio", error.mean_ratio),
    figure!("unbiased", unbiased),
    perhaps!("bias", error.bias),
    perhaps!("bias_95", error.bias_95),
    perhaps!("local_bias", error.local_bias),
    perhaps!("local_bias_95", error.local_bias_95),
    ("slope_seconds", |row| row.slopes.seconds.map(three_digits)),
    ("slope_rays", |row| row.slopes.rays.map(three_digits)),
    ("reference_method", |row| Some(row.reference?.method.clone())),
    ("reference_standard_error", |row| Some(row.reference?.standard_error.to_string())),
    ("threads", |row| Some(row.machine.threads.to_string())),
    ("cpu", |row| Some(row.machine.cpu.clone())),
    ("version", |row| Some(row.machine.version.clone())),
    ("commit", |row| Some(row.machine.commit.clone())),
];

/// A slope is never known better.
fn three_digits(slope: f64) -> String {
    format!("{slope:.3}")
}

/// Writes `results.csv`: one row a cell, a header line, RFC 4180; an empty field is a figure that is not known
/// or not finite.
///
/// # Errors
/// Names the file when it cannot be written.
pub fn write_csv(path: &Path, results: &Results) -> Result<(), ExperimentError> {
    write_with(path, |file| {
        let mut csv = csv::Writer::from_writer(file);
        csv.write_record(COLUMNS.iter().map(|column| column.0))?;
        for cell in &results.cells {
            let figures = cell.figures();
            let own = |r: &&Reference| figures.is_some_and(|f| f.reference == r.key);
            let row = Row {
                cell,
                figures,
                reference: results.references.iter().find(own),
                machine: &results.machine,
                slopes: figures.map_or_else(Slopes::default, Slopes::of),
            };
            csv.write_record(
                COLUMNS
                    .iter()
                    .map(|column| column.1(&row).unwrap_or_default()),
            )?;
        }
        csv.flush()
    })
}

/// Writes `results.json`: everything in [`Results`], all passes among it.
///
/// # Errors
/// Names the file when it cannot be written.
pub fn write_json(path: &Path, results: &Results) -> Result<(), ExperimentError> {
    write_record(path, results)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_results::results;

    #[test]
    fn the_table_has_a_row_a_cell_and_keeps_its_columns() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("results.csv");
        write_csv(&path, &results()).expect("writes");
        let text = std::fs::read_to_string(&path).expect("reads");
        let expected = include_str!("test_results.csv");
        assert_eq!(text, expected, "the table changed:\n{text}");
    }

    #[test]
    fn json_holds_the_passes_and_no_nan() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("results.json");
        write_json(&path, &results()).expect("writes");
        let text = std::fs::read(&path).expect("reads");
        let found: serde_json::Value = serde_json::from_slice(&text).expect("JSON");
        let passes = &found["cells"][0]["outcome"]["done"]["passes"];
        assert_eq!(passes.as_array().map(Vec::len), Some(3), "{passes}");
        let failed = &found["cells"][2]["outcome"]["failed"];
        assert_eq!(failed, "there is, \"again\", no scene", "{failed}");
    }
}
