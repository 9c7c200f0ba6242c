//! `manylight view`: a page on this machine that shows the picture refining, from any camera and by any method.
//!
//! Scene, lights and trees are there once. The page says what it [wishes](Wish) to see; a wish ends the pass under
//! way, and the render begins anew with one sample a pixel.

mod desk;
mod server;

use std::io::Write;

use film::Image;
use gather::{MethodSpec, Render, Shard};

use crate::args::ViewArgs;
use crate::error::CliError;
use crate::job::Job;
use crate::prepared::{self, LoadedScene, PreparedLights};
use crate::progress::Progress;
use crate::render::read_reference;
use desk::{Desk, Shown, Wish};
use server::{Page, Server};

/// The first picture after a change has so many times fewer columns and rows: it is there at once.
const COARSE: u32 = 4;

pub(crate) fn run(arguments: &ViewArgs) -> Result<(), CliError> {
    let job = Job::read(&arguments.job)?;
    let progress = Progress::new(arguments.quiet);
    let pool = prepared::threads(arguments.threads)?;
    job.refuse_too_large()?;
    let reference = read_reference(&job, arguments.reference.as_deref())?;
    // Whether the port is free shows before the scene is read.
    let server = Server::bind(arguments.port)?;
    pool.install(|| view(&job, reference, server, &progress))
}

/// Serves the page until the process is ended.
fn view(
    job: &Job,
    reference: Option<Image>,
    server: Server,
    progress: &Progress,
) -> Result<(), CliError> {
    let mut loaded = LoadedScene::load(&job.scene, job.limit, progress)?;
    let lights = PreparedLights::trace(job, &loaded, progress);
    let home = Wish {
        camera: loaded.scene.camera,
        method: 0,
    };
    let methods = methods(job);
    let desk = Desk::new(home);
    let page = Page {
        job,
        offset: loaded.scene.origin,
        home,
        methods: methods.iter().map(|(name, _)| name.clone()).collect(),
        reference: reference.as_ref(),
    };
    let url = server.url();
    let told = writeln!(std::io::stdout(), "{url}");
    told.map_err(|error| CliError::Input(format!("cannot write to stdout: {error}")))?;
    progress.line(&format!(
        "look at {url} in a browser on this machine; Ctrl-C ends it"
    ));
    std::thread::scope(|scope| {
        server.start(scope, &desk, &page);
        let mut last = 0;
        loop {
            let (number, wish) = desk.next_wish(last);
            last = number;
            loaded.scene.camera = wish.camera;
            let job = Job {
                method: methods[wish.method].1.clone(),
                ..job.clone()
            };
            // From elsewhere it shows something else.
            let reference = reference.as_ref().filter(|_| wish.camera == home.camera);
            fulfil(&desk, number, &job, &loaded, &lights, reference);
        }
    })
}

/// The methods to choose from: the run file's own, and all others with their default settings.
fn methods(job: &Job) -> Vec<(String, MethodSpec)> {
    let own = (
        format!("{} (of the run)", job.method.name()),
        job.method.clone(),
    );
    let others = MethodSpec::all().into_iter().filter(|m| *m != job.method);
    let others = others.map(|method| (method.name().to_owned(), method));
    std::iter::once(own).chain(others).collect()
}

/// Renders until all samples are there or another wish comes.
fn fulfil(
    desk: &Desk,
    number: u64,
    job: &Job,
    loaded: &LoadedScene,
    lights: &PreparedLights,
    reference: Option<&Image>,
) {
    let coarse = Job {
        width: job.width.div_ceil(COARSE),
        height: job.height.div_ceil(COARSE),
        spp: 1,
        ..job.clone()
    };
    for (job, reference) in [(&coarse, None), (job, reference)] {
        let mut render = prepared::render(loaded, &lights.inputs, job, Shard::ALL);
        render.stop_on(desk.stop());
        // Also methods that like to take all of a pixel's samples at once show something soon.
        while let Some(pass) = render.pass_of_at_most(render.spp().clamp(1, 16), &|_| ()) {
            desk.show(shown(number, job, &render, reference, pass.seconds));
        }
    }
}

fn shown(
    wish: u64,
    job: &Job,
    render: &Render<'_>,
    reference: Option<&Image>,
    seconds: f64,
) -> Shown {
    let image = render.picture().image();
    // Sizes were compared, and both are finite.
    let error = reference.and_then(|r| film::compare_without_flip(&image, r).ok());
    Shown {
        wish,
        image,
        spp: render.spp(),
        of: job.spp,
        seconds,
        relmse: error.map(|e| e.relmse).filter(|e| e.is_finite()),
    }
}
