//! Damaged run files, experiments and states: each is read or refused, in little time and memory.

use std::path::Path;

use gather::{MethodSpec, Shard};
use peak_alloc::PeakAlloc;
use verify::{Fuzz, Outcome};

use crate::args::JobArgs;
use crate::experiment::Spec;
use crate::fingerprint::Fnv;
use crate::job::{BARE, Job};
use crate::prepared::{LoadedScene, Prepared, PreparedLights};
use crate::progress::Progress;
use crate::state::{self, Saved, Subject};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// What a damaged file of a few thousand bytes may make its reader take.
const MOST_BYTES: usize = 100 << 20;

const RUN: &str = "(
    scene: \"scene.ron\", image: (width: 5, height: 4, spp: 3),
    lights: Virtual(kind: Vsl(radius: 0.1), count: 20, max_bounces: 2),
    integrator: Direct, tree: (builder: Morton),
    method: StochasticLightcuts(cut: 4, weights: MinMax, stopping: Bounds), seed: 1,
)";
const SCENE: &str = "(
    geometry: [\"scene.obj\"],
    camera: (origin: (0, 1, 5), target: (0, 1, 0), up: (0, 1, 0), fov_y_deg: 60.0),
    lights: [Point(position: (0, 2, 1), intensity: (1, 1, 1))],
)";
const EXPERIMENT: &str = "(
    title: \"Two\", image: (width: 4, height: 3), scenes: [(name: \"a\", scene: \"scene.ron\")],
    lights: [(name: \"few\", lights: Virtual(count: 10))], trees: [Binned, Morton],
    methods: [(name: \"l\", method: Lightcuts(cut: 10)), (name: \"p\", method: Power)],
    budgets: [Spp(2), CpuSeconds(0.1)], seeds: [1, 2], reference: (standard_error: 0.1, max_seconds: 1),
)";
const WORDS: &[&str] = &[
    "((",
    "[[",
    "Path(",
    "Virtual,",
    "/*",
    "r#\"",
    "#![enable(x)]",
    "$X/",
    "None",
    "StratifiedLightcuts(",
    ",",
];

fn peak() -> usize {
    let peak = MEMORY.peak_usage();
    MEMORY.reset_peak_usage();
    peak
}

fn fuzz<'a>(name: &'a str, seed: Vec<u8>, repair: fn(&mut [u8])) -> Fuzz<'a> {
    Fuzz {
        name,
        seeds: vec![seed],
        words: WORDS,
        repair,
        peak: &peak,
        most_bytes: MOST_BYTES,
    }
}

fn arguments(file: &Path) -> JobArgs {
    JobArgs {
        config: file.to_owned(),
        method: None,
        size: None,
        spp: None,
        seed: None,
        overrides: Vec::new(),
        max_memory: None,
    }
}

/// The check sum at the end of a state.
fn repair_state(bytes: &mut [u8]) {
    if let Some(end) = bytes.len().checked_sub(8) {
        let mut sum = Fnv::default();
        sum.bytes(&bytes[..end]);
        bytes[end..].copy_from_slice(&sum.0.to_le_bytes());
    }
}

/// Tries `inputs` of each kind.
fn all(inputs: u64) -> [Outcome; 3] {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let write = |name: &str, bytes: &[u8]| std::fs::write(at(name), bytes).expect("a file");
    write("scene.ron", SCENE.as_bytes());
    write("scene.obj", b"v 0 0 0\nv 2 0 0\nv 0 2 0\nf 1 2 3\n");
    write("sound.ron", RUN.as_bytes());

    let runs = fuzz("run", RUN.into(), |_| ()).run(inputs, |bytes| {
        write("run.ron", bytes);
        Job::read(&arguments(&at("run.ron"))).is_ok()
    });
    let bare: Vec<&str> = BARE.iter().chain(MethodSpec::VARIANTS).copied().collect();
    let experiments = fuzz("experiment", EXPERIMENT.into(), |_| ()).run(inputs, |bytes| {
        let text = ron_file::text("e.ron", bytes);
        text.is_ok_and(|text| ron_file::parse::<Spec>("e.ron", text, &[], &bare).is_ok())
    });

    let job = Job::read(&arguments(&at("sound.ron"))).unwrap_or_else(|e| panic!("{e}"));
    let quiet = Progress::new(true);
    let loaded = LoadedScene::load(&job.scene, job.limit, &quiet).unwrap_or_else(|e| panic!("{e}"));
    let lights = PreparedLights::trace(&job, &loaded, &quiet);
    let prepared = Prepared { loaded, lights };
    let subject = Subject::of(&job, &prepared.loaded.scene, Shard::ALL);
    let mut render = prepared.render(&job, Shard::ALL);
    render.pass(&|_| ());
    state::write(&at("a.state"), &subject, &[], &render).unwrap_or_else(|e| panic!("{e}"));
    let sound = std::fs::read(at("a.state")).expect("a state");
    let states = fuzz("state", sound, repair_state).run(inputs, |bytes| {
        write("a.state", bytes);
        let fresh = prepared.render(&job, Shard::ALL);
        match Saved::open(&at("a.state")) {
            Ok(Some(saved)) => saved.resume(&subject, fresh).is_ok(),
            _ => false,
        }
    });
    [runs, experiments, states]
}

#[test]
fn damaged_files_are_read_or_refused_in_little_time_and_memory() {
    for outcome in all(1000) {
        assert!(
            outcome.accepted > 0 && outcome.accepted < 1000,
            "{outcome:?}"
        );
    }
}

#[test]
#[ignore = "minutes: half a million files"]
fn very_many_damaged_files_are_read_or_refused() {
    for (name, outcome) in ["run", "experiment", "state"].iter().zip(all(150_000)) {
        eprintln!("{name}: {outcome:?}");
    }
}
