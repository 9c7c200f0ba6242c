//! One case with every method.

use film::Picture;
use gather::{MethodSpec, Render, RenderSpec, Shard};
use glam::DVec3;
use verify::{critical_z, sidak};

use crate::conditions::{Case, Expected};
use crate::exact;
use crate::room::{self, Built, Lights, Room};

/// Probability that all of a sound suite's comparisons with all lights raise one alarm, for a random seed.
const FALSE_ALARM: f64 = 1e-4;
/// How far a method that is allowed an error may be from all lights, apart from noise.
const BIAS: f64 = 0.05;

/// What became of one method in one case.
#[derive(Debug, Clone)]
pub(crate) struct Finding {
    pub(crate) group: &'static str,
    pub(crate) what: String,
    /// Relative error of the mean against what was known beforehand, of all lights only.
    pub(crate) off_known: Option<f64>,
    /// Relative difference of the method's mean from that of all lights, of it and in standard errors.
    pub(crate) off_all: Option<Difference>,
    pub(crate) problem: Option<String>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Difference {
    pub(crate) relative: f64,
    /// `None` for a method that is biased by design.
    pub(crate) z: Option<f64>,
    /// Standard deviation of `relative`.
    noise: f64,
}

impl Finding {
    pub(crate) fn failure(&self) -> Option<String> {
        let problem = self.problem.as_ref()?;
        Some(format!("{}: {}: {problem}", self.group, self.what))
    }
}

/// A render's sums.
struct Rendered {
    picture: Picture,
    mean: DVec3,
    nonfinite: u64,
}

pub(crate) fn check(case: &Case, checks: usize) -> Vec<Finding> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let build =
        |room: &Room, lights: &Lights| room::build(room, lights, case.builder, folder.path());
    let built = build(&case.room, &case.lights);
    let all_lights = MethodSpec::AllLights(Default::default());
    let truth = render(&built, &all_lights, case.size);
    let ordinary = match case.expected {
        Expected::SameBits(_) => Some(build(
            &Room::default(),
            &Lights::scattered(case.lights.kind),
        )),
        _ => None,
    };
    let limit = critical_z(sidak(FALSE_ALARM, checks));
    let methods = MethodSpec::all();
    let findings = methods.iter().map(|method| {
        let rendered = render(&built, method, case.size);
        let mut problem = unsound(&rendered);
        let mut off_known = None;
        if *method == all_lights {
            let (off, wrong) = against_known(case, &built, &rendered, &build);
            off_known = off;
            problem = problem.or(wrong);
        }
        if let (Expected::SameBits(factor), Some(ordinary)) = (&case.expected, &ordinary) {
            let expected = render(ordinary, method, case.size).picture.radiance;
            let same = rendered.picture.radiance.iter().zip(&expected);
            let differ = same
                .filter(|(found, wanted)| **found != **wanted * *factor)
                .count();
            if differ > 0 {
                problem = problem.or(Some(format!("{differ} pixels have other bits")));
            }
        }
        let off_all = (*method != all_lights).then(|| difference(method, &rendered, &truth));
        if let Some(Difference { relative, z, noise }) = off_all {
            let wrong = match z {
                Some(z) => z.is_nan() || z.abs() >= limit,
                None => relative.is_nan() || relative.abs() >= BIAS + limit * noise,
            };
            if wrong {
                let message = format!(
                    "mean {} instead of {}: {:.2} %, z {z:?}",
                    rendered.mean,
                    truth.mean,
                    100.0 * relative
                );
                problem = problem.or(Some(message));
            }
        }
        Finding {
            group: case.group,
            what: format!("{}, {:?}, {}", case.name, case.lights.kind, method.name()),
            off_known,
            off_all,
            problem,
        }
    });
    findings.collect()
}

fn render(built: &Built, method: &MethodSpec, size: [u32; 3]) -> Rendered {
    let mut render = Render::new(
        &built.scene,
        &built.tracer,
        &built.inputs,
        method,
        spec(built, size),
    );
    while render.pass(&|_| ()).is_some() {}
    let picture = render.picture();
    let pixels = picture.radiance.len() as f64;
    let mean = picture.radiance.iter().map(|c| c.as_dvec3()).sum::<DVec3>() / pixels;
    Rendered {
        mean,
        nonfinite: render.counters().nonfinite,
        picture,
    }
}

fn spec(built: &Built, [width, height, spp]: [u32; 3]) -> RenderSpec {
    RenderSpec {
        width,
        height,
        spp,
        seed: 7,
        shape: built.shape,
        integrator: built.integrator,
        shard: Shard::ALL,
    }
}

fn unsound(rendered: &Rendered) -> Option<String> {
    if rendered.nonfinite > 0 {
        return Some(format!("{} samples were not finite", rendered.nonfinite));
    }
    let sound = |c: &glam::Vec3| c.is_finite() && c.min_element() >= 0.0;
    let bad = rendered.picture.radiance.iter().find(|c| !sound(c))?;
    Some(format!("a pixel is {bad}"))
}

/// Relative error of all lights against what is known, and what is wrong with it.
fn against_known(
    case: &Case,
    built: &Built,
    rendered: &Rendered,
    build: &impl Fn(&Room, &Lights) -> Built,
) -> (Option<f64>, Option<String>) {
    let off = |expected: DVec3| {
        let scale = expected.max_element().max(f64::MIN_POSITIVE);
        (rendered.mean - expected).abs().max_element() / scale
    };
    let mut worst = None;
    let mut note = |what: &str, expected: DVec3, within: f64| {
        let off = off(expected);
        if within.is_finite() {
            worst = Some(off.max(worst.unwrap_or(0.0)));
        }
        let text = format!(
            "mean {} instead of {expected} {what}: off by {off:.1e}",
            rendered.mean
        );
        (off.is_nan() || off > within).then_some(text)
    };
    let mut problem = match &case.expected {
        Expected::Black => note("(black)", DVec3::ZERO, 0.0),
        Expected::Mean { of, factor, within } => {
            let all_lights = MethodSpec::AllLights(Default::default());
            let other = self::render(&build(&of.0, &of.1), &all_lights, case.size);
            note("by another way", other.mean * *factor, *within)
        }
        Expected::Nothing | Expected::SameBits(_) => None,
    };
    if case.rounding.is_finite()
        && let Some(expected) = exact::mean(built, &spec(built, case.size))
    {
        problem = problem.or(note("in double precision", expected, case.rounding));
    }
    (worst, problem)
}

/// The sum of a sound method's differences from all lights, pixel by pixel, has mean 0, and their squares have its
/// variance. That holds for light of any brightness, where the film's own variance would leave the range of `f32`.
fn difference(method: &MethodSpec, rendered: &Rendered, truth: &Rendered) -> Difference {
    let sum = |picture: &Picture| {
        let pixels = picture.radiance.iter();
        pixels
            .map(|c| c.as_dvec3().element_sum())
            .collect::<Vec<_>>()
    };
    let (found, expected) = (sum(&rendered.picture), sum(&truth.picture));
    let total: f64 = expected.iter().sum();
    let differences = found.iter().zip(&expected).map(|(f, e)| f - e);
    let off: f64 = differences.clone().sum();
    // A method that is exact but for rounding has hardly any variance.
    let rounding = 1e-6 * total;
    let deviation = differences
        .map(|d| d * d)
        .sum::<f64>()
        .sqrt()
        .hypot(rounding);
    let over = |unit: f64| if off == 0.0 { 0.0 } else { off / unit };
    Difference {
        relative: over(total),
        z: method.is_unbiased().then(|| over(deviation)),
        noise: if deviation == 0.0 {
            0.0
        } else {
            deviation / total
        },
    }
}
