//! A table of medians, as Markdown: for a terminal, and for `summary.md`.

use std::fmt::Write;
use std::path::Path;

use crate::ExperimentError;
use crate::results::{Results, Series};
use crate::statistics::Spread;
use crate::store::write_with;

/// The figures of all series, a table for each scene and light set, with medians over seeds and the range where
/// there are several.
pub fn summary(results: &Results) -> String {
    let mut text = format!("# {}\n", results.title);
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
    }
    text + &flicker(results)
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

/// Writes [`summary`] to a file.
///
/// # Errors
/// Names the file when it cannot be written.
pub fn write_summary(path: &Path, results: &Results) -> Result<(), ExperimentError> {
    write_with(path, |file| file.write_all(summary(results).as_bytes()))
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
        let text = summary(&results);
        for part in [
            "# Two methods, made up",
            "## room, lamps",
            "| 0.375 (0.250…0.500) |",
            "+0.10 ± 0.20 %",
            "one, 4 spp: failed: there is, \"again\", no scene",
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
