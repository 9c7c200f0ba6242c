//! `manylight render`.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use film::{Exposure, Image};
use gather::{Pass, Render, Shard};

use crate::args::RenderArgs;
use crate::denoise::denoiser;
use crate::error::CliError;
use crate::interrupt;
use crate::job::Job;
use crate::merge;
use crate::output::Output;
use crate::prepared::{self, LoadedScene, Prepared, PreparedLights};
use crate::progress::Progress;
use crate::report::{self, Measured, PassError, SetUpSeconds};
use crate::state::{self, Resumed, Saved, Subject};
use crate::tev::Viewer;

pub(crate) fn run(arguments: &RenderArgs) -> Result<(), CliError> {
    let job = Job::read(&arguments.job)?;
    let pool = prepared::threads(arguments.threads)?;
    let mut progress = Progress::new(arguments.quiet);
    pool.install(|| render(arguments, &job, &mut progress))
}

fn render(arguments: &RenderArgs, job: &Job, progress: &mut Progress) -> Result<(), CliError> {
    job.refuse_too_large()?;
    let name = arguments.name.as_deref().unwrap_or(&job.name);
    let output = Output::new(&arguments.out, name)?;
    let reference = read_reference(job, arguments.reference.as_deref())?;
    let denoiser = match arguments.denoise {
        true => Some(denoiser()?),
        false => None,
    };
    let mut viewer = match &arguments.tev {
        Some(address) => Some(Viewer::connect(address, name, job.width, job.height)?),
        None => None,
    };
    let saved = match arguments.resume {
        true => Saved::open(&output.state)?,
        false => {
            if output.state.exists() {
                let state = output.state.display();
                progress.line(&format!(
                    "{state} is of an unfinished render, which --resume would continue: this one begins anew"
                ));
            }
            None
        }
    };
    let loaded = LoadedScene::load(&job.scene, job.limit, progress)?;
    let lights = PreparedLights::trace(job, &loaded, progress);
    let prepared = Prepared { loaded, lights };
    let mut seconds = SetUpSeconds {
        load: prepared.loaded.load_seconds,
        bvh: prepared.loaded.bvh_seconds,
        lights: prepared.lights.seconds,
        ..SetUpSeconds::default()
    };
    let shard = arguments.shard.unwrap_or(Shard::ALL);
    let mut render = prepared.render(job, shard);
    let subject = Subject::of(job, &prepared.loaded.scene, shard);
    let mut passes = Vec::new();
    if let Some(saved) = saved {
        Resumed { render, passes } = saved.resume(&subject, render)?;
        progress.line(&format!(
            "going on from {}: {} of {} samples a pixel, {:.1} s",
            output.state.display(),
            render.spp(),
            job.spp,
            render.seconds()
        ));
    } else if arguments.resume {
        let state = output.state.display();
        progress.line(&format!("{state} is not there: beginning from the start"));
    }
    // The first pass would build the tree inside the time that is called rendering.
    let started = Instant::now();
    render.prepare();
    seconds.tree = started.elapsed().as_secs_f64();
    if let Some((nodes, depth)) = prepared.lights.inputs.tree_size() {
        progress.line(&format!(
            "light tree: {nodes} nodes, depth {depth}, {:.2} s",
            seconds.tree
        ));
    }

    let stop = interrupt::flag();
    render.stop_on(stop);
    let mut checkpoint = Checkpoint::new();
    let enough = |render: &Render<'_>| {
        let limit = arguments.max_seconds;
        render.spp() > 0 && limit.is_some_and(|limit| render.seconds() >= limit)
    };
    progress.start_bar("render");
    progress.advance(f64::from(render.spp()) / f64::from(job.spp));
    while !enough(&render) {
        let share = f64::from(render.next_samples()) / f64::from(job.spp);
        let Some(pass) = render.pass(&|tile| progress.advance(tile * share)) else {
            break;
        };
        progress.pass(|| {
            let left = f64::from(job.spp - pass.spp) / f64::from(pass.spp) * pass.seconds;
            let left = match pass.spp < job.spp {
                true => format!(", about {left:.0} s left"),
                false => String::new(),
            };
            format!(
                "{} of {} samples a pixel, {:.1} s{left}",
                pass.spp, job.spp, pass.seconds
            )
        });
        if reference.is_some() || viewer.is_some() {
            let image = render.picture().image();
            if let Some(reference) = &reference {
                passes.push(pass_error(&image, reference, pass)?);
            }
            if let Some(viewer) = &mut viewer {
                viewer.show(&image, progress);
            }
        }
        if render.spp() < job.spp && checkpoint.is_due() {
            let written = state::write(&output.state, &subject, &passes, &render);
            // The render itself is sound: it may still end well.
            if let Err(error) = written {
                progress.line(&format!("warning: no checkpoint: {error}"));
            }
            checkpoint.done();
        }
    }
    progress.finish();

    let finished = render.spp() == job.spp;
    if !finished {
        state::write(&output.state, &subject, &passes, &render)?;
        if stop.load(Ordering::Relaxed) {
            return Err(CliError::Interrupted(format!(
                "interrupted at {} of {} samples a pixel; all that is done is in {}: to go on, give the same \
                 command with --resume",
                render.spp(),
                job.spp,
                output.state.display()
            )));
        }
    }
    let started = Instant::now();
    let picture = render.picture();
    let mut metadata = report::metadata(job, &prepared.loaded.scene, render.spp());
    if let Some(shard) = arguments.shard {
        let shard = (merge::SHARD.to_owned(), shard.to_string());
        metadata.texts.push(shard);
    }
    let written = picture
        .write_exr(&output.exr, &metadata)
        .and_then(|()| picture.write_png(&output.png, Exposure::Auto));
    if let Err(error) = written {
        // Hours may be in it: perhaps there is room for the state, which is smaller.
        let advice = match state::write(&output.state, &subject, &passes, &render) {
            Ok(()) => format!(
                "; all that is done is in {}: to write the picture, give the same command with --resume",
                output.state.display()
            ),
            Err(_) => String::new(),
        };
        return Err(CliError::Input(format!("{error}{advice}")));
    }
    seconds.write = started.elapsed().as_secs_f64();
    if let Some(denoiser) = denoiser {
        let started = Instant::now();
        let denoised = denoiser
            .denoise(&picture)
            .map_err(|error| CliError::Input(format!("--denoise: {error}")))?;
        progress.line(&format!(
            "denoised, {:.2} s",
            started.elapsed().as_secs_f64()
        ));
        denoised.write_exr(&output.denoised_exr, &metadata)?;
        // As bright as the other one, to be compared.
        let exposure = film::auto_exposure(&picture.radiance);
        let pixels = film::tone_map(&denoised.pixels, exposure);
        film::write_rgb8(&output.denoised_png, job.width, job.height, &pixels)?;
    }

    let final_error = reference
        .map(|r| film::compare(&picture.image(), &r))
        .transpose()?;
    let measured = Measured {
        seconds,
        passes,
        final_error,
    };
    report::write(&output.json, job, &prepared, &render, &measured)?;
    progress.line(&format!(
        "wrote {}",
        output.exr.with_extension("{exr,png,json}").display()
    ));
    match finished {
        true => state::remove(&output.state)?,
        false => progress.line(&format!(
            "stopped at {} of {} samples a pixel: to go on, give a larger --max-seconds and --resume",
            render.spp(),
            job.spp
        )),
    }
    Ok(())
}

/// Says when an unfinished render is to be saved again, so that a crash costs little.
pub(crate) struct Checkpoint {
    last: Instant,
    begun: Instant,
    pause: Duration,
}

impl Checkpoint {
    const PAUSE: Duration = Duration::from_secs(60);

    pub(crate) fn new() -> Self {
        let now = Instant::now();
        Self {
            last: now,
            begun: now,
            pause: Self::PAUSE,
        }
    }

    pub(crate) fn is_due(&mut self) -> bool {
        self.begun = Instant::now();
        self.last.elapsed() >= self.pause
    }

    /// Large pictures on slow disks are saved less often: saving takes at most a twentieth of the time.
    pub(crate) fn done(&mut self) {
        self.pause = Self::PAUSE.max(self.begun.elapsed() * 20);
        self.last = Instant::now();
    }
}

/// Reads the reference, if there is to be one.
///
/// # Errors
/// When it cannot be read, or no picture of the job can be compared with it.
pub(crate) fn read_reference(job: &Job, path: Option<&Path>) -> Result<Option<Image>, CliError> {
    let Some(path) = path else {
        return Ok(None);
    };
    let reference = film::read_image(path)?;
    let path = path.display();
    if (reference.width, reference.height) != (job.width, job.height) {
        return Err(CliError::Input(format!(
            "{path}: the reference is {}x{}; expected the render's {}x{}",
            reference.width, reference.height, job.width, job.height
        )));
    }
    match reference.pixels.iter().position(|p| !p.is_finite()) {
        Some(at) => Err(CliError::Input(format!(
            "{path}: the reference is {} at x={}, y={}; expected finite values",
            reference.pixels[at],
            at % reference.width as usize,
            at / reference.width as usize
        ))),
        None => Ok(Some(reference)),
    }
}

fn pass_error(image: &Image, reference: &Image, pass: Pass) -> Result<PassError, CliError> {
    let error = film::compare_without_flip(image, reference)?;
    Ok(PassError {
        spp: pass.spp,
        seconds: pass.seconds,
        relmse: error.relmse,
        mse: error.mse,
    })
}
