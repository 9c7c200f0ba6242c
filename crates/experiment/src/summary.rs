//! A table of medians, as Markdown: for a terminal, and for `summary.md`.

use std::fmt::Write;
use std::path::Path;

use crate::ExperimentError;
use crate::plot::Plot;
use crate::reference::Reference;
use crate::results::{Results, Series};
use crate::statistics::Spread;
use crate::store::write_with;
use crate::strips::Strip;

/// The figures of all series, a table for each scene and light set, with medians over seeds and the range where
/// there are several, and where they come from: machine, program and references.
pub fn summary(results: &Results) -> String {
    let mut text = format!("# {}\n", results.title);
    let machine = &results.machine;
    let _ = write!(
        text,
        "\n{}, threads: {}; manylight {}, commit {}.\n",
        machine.cpu, machine.threads, machine.version, machine.commit
    );
    if results.quick {
        text.push_str("\nThe quick form: figures are a try, not a result.\n");
    }
    let series = results.series();
    let mut places: Vec<(&str, &str)> = series.iter().map(|s| (s.scene, s.lights)).collect();
    places.dedup();
    for (scene, lights) in places {
        let own: Vec<&Series<'_>> = series
            .iter()
            .filter(|s| (s.scene, s.lights) == (scene, lights))
            .collect();
        // Writing into a string cannot fail.
        let _ = write!(text, "\n## {scene}, {lights}\n\n{}", table(results, &own));
        let here = |r: &&Reference| (&*r.scene, &*r.lights) == (scene, lights);
        let references: Vec<&Reference> = results.references.iter().filter(here).collect();
        text.push_str(&origin(&references));
    }
    text + &flicker(results)
}

/// Where the references of a place, one for each frame, come from.
fn origin(references: &[&Reference]) -> String {
    let Some(first) = references.first() else {
        return String::new();
    };
    let errors = Spread::of(references.iter().map(|r| r.standard_error));
    let spp = Spread::of(references.iter().map(|r| f64::from(r.spp)));
    let range = |spread: Option<Spread>, text: fn(f64) -> String| match spread {
        Some(v) if v.low < v.high => format!("{} to {}", text(v.low), text(v.high)),
        Some(v) => text(v.median),
        None => "–".into(),
    };
    let tested = match first.under_test {
        true => ", which is under test itself",
        false => "",
    };
    format!(
        "\nReference: {}{tested}, seed {}, {} spp; relative standard error {}, asked for {}.\n",
        first.method.split('(').next().unwrap_or_default(),
        first.seed,
        range(spp, |v| format!("{v:.0}")),
        range(errors, digits),
        digits(first.asked)
    )
}

/// A table of how methods flicker; nothing without animations.
fn flicker(results: &Results) -> String {
    if results.animations.is_empty() {
        return String::new();
    }
    let head = [
        "scene",
        "method",
        "budget",
        "per pixel",
        "blocks of 8 × 8",
        "pattern",
    ];
    let mut rows = vec![head.map(str::to_owned)];
    for a in &results.animations {
        rows.push([
            format!("{}, {}", a.scene, a.lights),
            a.label.clone(),
            a.budget.clone(),
            digits(a.pixel),
            digits(a.block),
            a.pattern.map_or("–".into(), digits),
        ]);
    }
    format!("\n## Flicker\n\n{}", markdown(&rows, 3))
}

/// Writes [`summary`] to a file, and under it the pictures of `plots/`.
///
/// # Errors
/// Names the file when it cannot be written.
pub fn write_summary(
    path: &Path,
    results: &Results,
    strips: &[Strip],
    plots: &[Plot],
) -> Result<(), ExperimentError> {
    let mut text = summary(results);
    if !(strips.is_empty() && plots.is_empty()) {
        text.push_str("\n## Pictures\n");
    }
    for strip in strips {
        let _ = write!(
            text,
            "\n![{}, {}; from left to right: {}, reference](plots/{})\n",
            strip.scene,
            strip.lights,
            strip.labels.join(", "),
            strip.file
        );
    }
    for plot in plots {
        let _ = write!(text, "\n![{}](plots/{}.svg)\n", plot.caption, plot.name);
    }
    write_with(path, |file| file.write_all(text.as_bytes()))
}

fn table(results: &Results, series: &[&Series<'_>]) -> String {
    let head = [
        "method",
        "budget",
        "spp",
        "seconds",
        "CPU s",
        "Mrays",
        "relmse",
        "HDR-FLIP",
        "bias",
        "relmse × CPU s",
    ];
    let mut rows = vec![head.map(str::to_owned)];
    for s in series {
        let label = s.label(results.has_trees());
        let whole = |spread: Option<Spread>| spread.map_or("–".into(), |v| v.median.to_string());
        rows.push([
            label,
            s.budget.to_owned(),
            whole(s.spread(|f| Some(f64::from(f.spp)))),
            shown(s.spread(|f| Some(f.seconds.render))),
            shown(s.spread(|f| f.cpu_seconds)),
            shown(s.spread(|f| Some(f.shadow_rays as f64 * 1e-6))),
            shown(s.error(|e| e.relmse)),
            shown(s.error(|e| e.hdr_flip)),
            bias(s),
            shown(s.spread(|f| Some(f.error.relmse? * f.cpu_seconds?))),
        ]);
    }
    let mut text = markdown(&rows, 2);
    for s in series {
        let mut told: Vec<&str> = Vec::new();
        for failure in &s.failures {
            if !told.contains(failure) {
                told.push(failure);
                let _ = writeln!(text, "\n{}, {}: failed: {failure}", s.method, s.budget);
            }
        }
    }
    text
}

/// A table whose first row is its head; the first `words` columns hold words, the others numbers.
fn markdown<const N: usize>(rows: &[[String; N]], words: usize) -> String {
    let width = |c: usize| rows.iter().map(|r| r[c].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..N).map(width).collect();
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let mut text = String::new();
    for (i, row) in rows.iter().enumerate() {
        let cells = row.iter().zip(&widths).enumerate();
        let padded = |(c, (cell, &width)): (usize, (&String, &usize))| match c < words {
            true => format!("{cell:<width$}"),
            false => format!("{cell:>width$}"),
        };
        text.push_str(&line(cells.map(padded).collect()));
        if i == 0 {
            let rule = |(c, &width): (usize, &usize)| match c < words {
                true => "-".repeat(width),
                false => format!("{}:", "-".repeat(width.saturating_sub(1))),
            };
            text.push_str(&line(widths.iter().enumerate().map(rule).collect()));
        }
    }
    text
}

/// Three digits of the median, and the range where there is one.
fn shown(spread: Option<Spread>) -> String {
    match spread {
        None => "–".into(),
        Some(v) if v.low == v.high => digits(v.median),
        Some(v) => format!(
            "{} ({}…{})",
            digits(v.median),
            digits(v.low),
            digits(v.high)
        ),
    }
}

/// Three significant digits.
pub(crate) fn digits(value: f64) -> String {
    let magnitude = value.abs();
    if magnitude == 0.0 {
        "0".into()
    } else if !(1e-3..1e5).contains(&magnitude) {
        format!("{value:.2e}")
    } else {
        let decimals = (2 - magnitude.log10().floor() as i32).max(0) as usize;
        format!("{value:.decimals$}")
    }
}

/// Bias of the mean, in per cent, with its interval; `!` where an unbiased method has one.
fn bias(series: &Series<'_>) -> String {
    let (Some(bias), Some(half)) = (series.error(|e| e.bias), series.error(|e| e.bias_95)) else {
        return "–".into();
    };
    let mark = if series.is_suspicious() { " !" } else { "" };
    format!(
        "{:+.2} ± {:.2} %{mark}",
        100.0 * bias.median,
        100.0 * half.median
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_results::{cell, results};

    #[test]
    fn the_summary_has_medians_ranges_and_failures() {
        let mut results = results();
        results.cells.push(cell("room", "one", 2, 2.0));
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("summary.md");
        let strip = Strip {
            scene: "room".into(),
            lights: "lamps".into(),
            file: "1-crops.png".into(),
            labels: vec!["one".into(), "two".into()],
        };
        write_summary(&path, &results, &[strip], &[]).expect("writes");
        let text = std::fs::read_to_string(path).expect("reads");
        for part in [
            "# Two methods, made up",
            "## room, lamps",
            "| 0.375 (0.250…0.500) |",
            "+0.10 ± 0.20 %",
            "one, 4 spp: failed: there is, \"again\", no scene",
            "threads: 2; manylight 0.1.0, commit abc.",
            "Reference: AllLights, seed 99, 1024 spp; relative standard error 0.00400, asked for 0.00500.",
            "![room, lamps; from left to right: one, two, reference](plots/1-crops.png)",
        ] {
            assert!(text.contains(part), "no {part:?} in:\n{text}");
        }
    }

    #[test]
    fn three_digits_are_shown() {
        let shown = [0.0, 1.0, 12.345, 1234.5, 0.012345, 1e-5, -2.5e7].map(digits);
        let expected = ["0", "1.00", "12.3", "1234", "0.0123", "1.00e-5", "-2.50e7"];
        assert_eq!(shown, expected, "digits");
    }
}
