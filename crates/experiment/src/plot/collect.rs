//! From results to what is drawn.

use super::curves::{Curve, Curves};
use super::shares::Shares;
use crate::cell::{Figures, Pass, Phases};
use crate::results::{Results, Series};
use crate::statistics::{Spread, slope};

/// File name, caption and drawing.
type Named<D> = (String, String, D);

/// What a pass has cost; NaN where nobody knows.
type Cost = fn(&Pass) -> f64;

/// All plots with curves, in the order in which the page shows them.
pub(super) fn curves(results: &Results) -> Vec<Named<Curves>> {
    let series = results.series();
    let mut plots = Vec::new();
    for (n, (scene, lights)) in places(&series).into_iter().enumerate() {
        let own: Vec<&Series<'_>> = series
            .iter()
            .filter(|s| (s.scene, s.lights) == (scene, lights))
            .collect();
        let error = results
            .references
            .iter()
            .filter(|r| (&*r.scene, &*r.lights) == (scene, lights))
            .map(|r| r.standard_error.powi(2));
        // The reference's own noise is in every error that is measured against it.
        let floor = Spread::of(error).map(|s| (s.median, "noise of the reference"));
        let costs: [(&str, &str, Cost); 3] = [
            ("time", "render time [s]", |p| p.seconds),
            ("cpu", "processor time, all threads [s]", |p| {
                p.cpu_seconds.unwrap_or(f64::NAN)
            }),
            ("rays", "shadow rays", |p| p.shadow_rays as f64),
        ];
        for (kind, x, cost) in costs {
            let chart = Curves {
                title: format!(
                    "{scene}, {lights}: error against {}",
                    x.trim_end_matches(" [s]")
                ),
                x,
                y: "relmse (relative mean squared error) [1]",
                curves: convergence(results, &own, cost),
                floor,
            };
            let name = format!("{}-{}-{}-error-{kind}", n + 1, slug(scene), slug(lights));
            let caption = format!(
                "{scene}, {lights}: error against {}, medians over seeds, bars from least to greatest. Slope: exponent \
                 of the fitted power law, \u{2212}1 for unbiased sampling.",
                x.trim_end_matches(" [s]")
            );
            plots.push((name, caption, chart));
        }
    }
    for scene in scenes(&series) {
        plots.extend(against_lights(results, &series, scene));
    }
    plots.retain(|(_, _, chart)| chart.has_points());
    plots
}

/// Shares of time by phase, for each place that has any.
pub(super) fn shares(results: &Results) -> Vec<Named<Shares>> {
    let series = results.series();
    let mut plots = Vec::new();
    for (n, (scene, lights)) in places(&series).into_iter().enumerate() {
        let own = largest(
            series
                .iter()
                .filter(|s| (s.scene, s.lights) == (scene, lights)),
        );
        let bars: Vec<(String, Vec<f64>)> = own
            .iter()
            .filter_map(|s| Some((s.label(results.has_trees()), phases(&s.done)?)))
            .collect();
        if bars.is_empty() {
            continue;
        }
        let name = format!("{}-{}-{}-phases", n + 1, slug(scene), slug(lights));
        let caption = format!("{scene}, {lights}: where the threads' time goes while rendering.");
        let chart = Shares {
            title: format!("{scene}, {lights}: time by phase"),
            parts: Phases::default().parts().map(|part| part.0).to_vec(),
            bars,
        };
        plots.push((name, caption, chart));
    }
    plots
}

/// Scenes and light sets, in order.
fn places<'a>(series: &[Series<'a>]) -> Vec<(&'a str, &'a str)> {
    let mut places: Vec<_> = series.iter().map(|s| (s.scene, s.lights)).collect();
    places.dedup();
    places
}

fn scenes<'a>(series: &[Series<'a>]) -> Vec<&'a str> {
    let mut scenes: Vec<_> = series.iter().map(|s| s.scene).collect();
    scenes.dedup();
    scenes
}

/// Of the series of each method and tree, the one with most samples a pixel.
fn largest<'s, 'a: 's>(series: impl Iterator<Item = &'s Series<'a>>) -> Vec<&'s Series<'a>> {
    let mut largest: Vec<&Series<'_>> = Vec::new();
    let samples = |s: &Series<'_>| s.done.iter().map(|f| f.spp).max();
    for s in series {
        let same = |other: &&mut &Series<'_>| {
            (other.lights, other.method, other.tree) == (s.lights, s.method, s.tree)
        };
        match largest.iter_mut().find(same) {
            Some(other) if samples(s) > samples(other) => *other = s,
            Some(_) => {}
            None => largest.push(s),
        }
    }
    largest
}

/// A curve for each method and tree: at each number of samples the medians over all cells that recorded it.
fn convergence(results: &Results, series: &[&Series<'_>], cost: Cost) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    for one in largest(series.iter().copied()) {
        let same = |s: &&&Series<'_>| (s.method, s.tree) == (one.method, one.tree);
        let cells: Vec<&Figures> = series
            .iter()
            .filter(same)
            .flat_map(|s| s.done.clone())
            .collect();
        let mut counts: Vec<u32> = cells
            .iter()
            .flat_map(|f| &f.passes)
            .map(|p| p.spp)
            .collect();
        counts.sort_unstable();
        counts.dedup();
        let mut points = Vec::new();
        for spp in counts {
            let passes = || {
                cells
                    .iter()
                    .flat_map(|f| &f.passes)
                    .filter(|p| p.spp == spp)
            };
            let errors: Vec<f64> = passes().filter_map(|p| p.relmse).collect();
            // Where time ends a render, the last passes differ from seed to seed: a point needs most of them.
            if 2 * errors.len() >= one.done.len()
                && let (Some(at), Some(error)) =
                    (Spread::of(passes().map(cost)), Spread::of(errors))
            {
                points.push((at.median, error));
            }
        }
        let medians: Vec<(f64, f64)> = points.iter().map(|p| (p.0, p.1.median)).collect();
        let note = slope(&medians).map_or(String::new(), |k| {
            format!("slope {:.2}", k).replace('-', "\u{2212}")
        });
        curves.push(Curve {
            label: one.label(results.has_trees()),
            note,
            points,
        });
    }
    curves.retain(|curve| !curve.points.is_empty());
    curves
}

/// Cost and error against the number of lights, where a scene has several.
fn against_lights(results: &Results, series: &[Series<'_>], scene: &str) -> Vec<Named<Curves>> {
    let own = largest(series.iter().filter(|s| s.scene == scene));
    let count = |s: &Series<'_>| s.spread(|f| Some(f.light_count as f64)).map(|c| c.median);
    let mut counts: Vec<f64> = own.iter().filter_map(|s| count(s)).collect();
    counts.sort_unstable_by(f64::total_cmp);
    counts.dedup();
    if counts.len() < 2 {
        return Vec::new();
    }
    let per_sample = |f: &Figures| {
        let samples = f64::from(f.spp) * f64::from(f.width) * f64::from(f.height);
        Some(1e6 * f.cpu_seconds? / samples)
    };
    let curves = |figure: &dyn Fn(&Figures) -> Option<f64>| {
        let mut curves: Vec<Curve> = Vec::new();
        for s in &own {
            let label = s.label(results.has_trees());
            let (Some(count), Some(value)) = (count(s), s.spread(figure)) else {
                continue;
            };
            match curves.iter_mut().find(|c| c.label == label) {
                Some(curve) => curve.points.push((count, value)),
                None => curves.push(Curve {
                    label,
                    note: String::new(),
                    points: vec![(count, value)],
                }),
            }
        }
        for curve in &mut curves {
            curve.points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let medians: Vec<(f64, f64)> = curve.points.iter().map(|p| (p.0, p.1.median)).collect();
            curve.note = slope(&medians).map_or(String::new(), |k| {
                format!("slope {k:.2}").replace('-', "\u{2212}")
            });
        }
        curves
    };
    let x = "lights in use";
    let cost = Curves {
        title: format!("{scene}: cost against the number of lights"),
        x,
        y: "processor time per pixel sample [µs]",
        curves: curves(&per_sample),
        floor: None,
    };
    let error = Curves {
        title: format!("{scene}: error against the number of lights"),
        x,
        y: "relmse (relative mean squared error) [1]",
        curves: curves(&|f| f.error.relmse),
        floor: None,
    };
    let slug = slug(scene);
    vec![
        (
            format!("{slug}-cost-lights"),
            format!("{scene}: processor time per pixel sample against the number of lights."),
            cost,
        ),
        (
            format!("{slug}-error-lights"),
            format!("{scene}: error of the largest budget against the number of lights."),
            error,
        ),
    ]
}

/// Mean shares of the phases; `None` where no time was measured.
fn phases(done: &[&Figures]) -> Option<Vec<f64>> {
    let sum = |part: usize| done.iter().map(|f| f.phases.parts()[part].1).sum::<f64>();
    let sums: Vec<f64> = (0..5).map(sum).collect();
    let total: f64 = sums.iter().sum();
    (total > 0.0).then(|| sums.iter().map(|s| s / total).collect())
}

/// A name as a part of a file's name: small letters, digits and hyphens.
fn slug(name: &str) -> String {
    let plain = |c: char| match c.is_ascii_alphanumeric() {
        true => c.to_ascii_lowercase(),
        false => '-',
    };
    let text: String = name.chars().map(plain).take(40).collect();
    text.trim_matches('-').to_owned()
}
