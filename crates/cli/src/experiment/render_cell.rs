//! Renders one cell.

use std::sync::atomic::Ordering;

use experiment::{Error, Figures, Pass, Phases, Seconds};
use film::{Bias, Image, PIXELS_PER_DEGREE, Picture};
use gather::{Inputs, Shard};

use super::budget::Spent;
use super::matrix::Planned;
use super::reference::Compared;
use crate::error::CliError;
use crate::interrupt;
use crate::machine::{cpu_seconds, peak_resident};
use crate::prepared::{self, LoadedScene};

/// What a cell gave.
pub(crate) struct Rendered {
    pub(crate) figures: Figures,
    pub(crate) image: Image,
}

/// Renders `cell` and measures it. Of the `seconds`, which the caller has measured, the render's are filled in.
///
/// `None` when someone wants it to stop.
///
/// # Errors
/// When the budget is none for this method, or the picture cannot be compared.
pub(crate) fn render(
    cell: &Planned,
    key: &str,
    loaded: &LoadedScene,
    inputs: &Inputs,
    reference: &Compared,
    seconds: Seconds,
) -> Result<Option<Rendered>, CliError> {
    let stop = interrupt::flag();
    let mut render = prepared::render(loaded, inputs, &cell.job, Shard::ALL);
    render.stop_on(stop);
    render.prepare();
    let expected = reference.picture.image();
    let pixels = expected.pixels.len() as f64;
    let mut cpu = cpu_seconds().map(|_| 0.0);
    let mut passes: Vec<Pass> = Vec::new();
    loop {
        let spent = Spent {
            spp: render.spp(),
            light_samples_per_pixel: render.counters().light_samples as f64 / pixels,
            seconds: render.seconds(),
            cpu_seconds: cpu,
        };
        let most = cell.budget.next(&spent)?;
        let far_enough = passes.last().is_none_or(|p| p.is_passed_by(spent.spp));
        if spent.spp > 0 && (far_enough || most == 0) {
            let error = film::compare_without_flip(&render.picture().image(), &expected)?;
            passes.push(Pass {
                spp: spent.spp,
                seconds: spent.seconds,
                cpu_seconds: spent.cpu_seconds,
                shadow_rays: render.counters().shadow_rays,
                relmse: finite(error.relmse),
                mse: finite(error.mse),
            });
        }
        if most == 0 {
            break;
        }
        let before = cpu_seconds();
        let pass = render.pass_of_at_most(most, &|_| ());
        if let (Some(sum), Some(before), Some(after)) = (&mut cpu, before, cpu_seconds()) {
            *sum += after - before;
        }
        if pass.is_none() || stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
    }
    let picture = render.picture();
    let counters = render.counters();
    let phases = counters.seconds();
    let figures = Figures {
        key: key.to_owned(),
        reference: reference.record.key.clone(),
        unbiased: cell.job.method.is_unbiased(),
        width: cell.job.width,
        height: cell.job.height,
        spp: render.spp(),
        light_count: inputs.lights.len(),
        triangles: loaded.scene.mesh.len(),
        seconds: Seconds {
            render: render.seconds(),
            ..seconds
        },
        cpu_seconds: cpu,
        phases: Phases {
            eye: phases.eye,
            cut: phases.cut,
            select: phases.select,
            evaluate: phases.evaluate,
            shadow: phases.shadow,
        },
        camera_rays: counters.camera_rays,
        shadow_rays: counters.shadow_rays,
        light_samples: counters.light_samples,
        nonfinite: counters.nonfinite,
        peak_rss_bytes: peak_resident(),
        error: error(&picture, reference)?,
        passes,
    };
    Ok(Some(Rendered {
        figures,
        image: picture.image(),
    }))
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn error(picture: &Picture, reference: &Compared) -> Result<Error, CliError> {
    let (image, expected) = (picture.image(), reference.picture.image());
    let metrics = film::compare(&image, &expected)?;
    let exposure = film::auto_exposure(&expected.pixels);
    let flip = film::ldr_flip_map(&image, &expected, exposure, PIXELS_PER_DEGREE)?;
    let flip = flip.iter().map(|&v| f64::from(v)).sum::<f64>() / flip.len() as f64;
    let bias = Bias::of(picture, &reference.picture)?;
    Ok(Error::new(&metrics, flip, bias))
}
