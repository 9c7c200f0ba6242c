//! `manylight experiment`: a matrix of renders, measured against references.
//!
//! A cell is one render. Cells that share scene, lights and camera form a group, for which everything before the
//! first sample is made once, and only if one of them is still to be rendered. Each finished cell is a file named
//! by a hash of all that decides it, so that an ended run goes on where it was, and a changed experiment renders
//! only what changed.

mod budget;
mod matrix;
mod path;
mod reference;
mod render_cell;
mod run;
mod spec;

use std::path::{Path, PathBuf};

use experiment::{Machine, Results, SceneView, Store};
use gather::MethodSpec;
use ron_file::{Place, RonError};

use crate::answer::Answer;
use crate::args::ExperimentArgs;
use crate::error::CliError;
use crate::fingerprint::Fnv;
use crate::job::{self, LightsSpec, find_scene};
use crate::limits::MemoryLimit;
use crate::machine::cpu_model;
use crate::output::check_folder;
use crate::progress::Progress;
use run::{Machinery, Run};
pub(crate) use spec::{ANNOTATED, Spec};

pub(crate) fn run(arguments: &ExperimentArgs) -> Result<(), CliError> {
    let file = &arguments.config;
    let bare: Vec<&str> = job::BARE
        .iter()
        .chain(MethodSpec::VARIANTS)
        .copied()
        .collect();
    let spec: Spec = ron_file::read(file, &[], &bare)?;
    refuse_reference(file, &spec)?;
    let lights = spec.lights.0.iter().map(|entry| &entry.lights);
    if let Some(message) = lights.filter_map(|l| spec.integrator.conflict(l)).next() {
        return Err(error_at(file, "integrator", message));
    }
    let mut lights = spec.lights.0.iter().map(|entry| &entry.lights);
    if let Some(message) = lights.find_map(LightsSpec::conflict) {
        return Err(error_at(file, "lights", message));
    }
    let spec = match arguments.quick {
        true => spec.quick(),
        false => spec,
    };
    let scenes = scenes(file, &spec);
    if let Some(Err(message)) = scenes.first()
        && scenes.iter().all(Result::is_err)
    {
        // Nothing can be rendered: that is a matter of the file, and not of a cell.
        return Err(CliError::Input(message.clone()));
    }
    let name = file.file_stem().map(|s| s.to_string_lossy().into_owned());
    let name = name.unwrap_or_else(|| "experiment".into());
    let folder = arguments.out.clone().unwrap_or_else(|| {
        let quick = if arguments.quick { "-quick" } else { "" };
        Path::new("out").join(format!("{name}{quick}"))
    });
    check_folder(&folder)?;
    let store = Store::new(&folder);
    store.remove_abandoned();
    let pool = crate::prepared::threads(arguments.threads)?;
    pool.install(|| {
        let progress = Progress::new(arguments.quiet);
        let machine = Machine {
            cpu: cpu_model(),
            threads: rayon::current_num_threads(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: env!("MANYLIGHT_COMMIT").to_owned(),
        };
        let mut run = Run {
            spec: &spec,
            machinery: Machinery {
                store: &store,
                progress: &progress,
            },
            program: program_hash(&machine),
            planned: 0,
            total: 0,
            results: Results {
                name,
                title: spec.title.clone(),
                about: spec.about.clone(),
                quick: arguments.quick,
                machine,
                scenes: spec.scenes.0.iter().map(view).collect(),
                references: Vec::new(),
                cells: Vec::new(),
                animations: Vec::new(),
            },
        };
        let paths: Vec<PathBuf> = scenes
            .iter()
            .map(|scene| scene.clone().unwrap_or_default())
            .collect();
        let limit = MemoryLimit {
            most: arguments.max_memory,
        };
        let ended = run.all(matrix::plan(&spec, file, &paths, limit), &scenes);
        write(&mut run.results, &store)?;
        ended?;
        finish(&run.results, &store, &progress)
    })
}

/// What the results say of a scene.
fn view(entry: &spec::SceneEntry) -> SceneView {
    SceneView {
        name: entry.name.clone(),
        crops: entry.crops.iter().map(|crop| crop.0).collect(),
    }
}

/// Writes all that shows the results, and fills in how methods flicker.
fn write(results: &mut Results, store: &Store) -> Result<(), CliError> {
    let folder = store.folder();
    results.animations = experiment::write_animations(store, results)?;
    experiment::write_csv(&folder.join("results.csv"), results)?;
    experiment::write_json(&folder.join("results.json"), results)?;
    let plots = experiment::write_plots(folder, results)?;
    let strips = experiment::write_strips(store, results)?;
    experiment::write_summary(&folder.join("summary.md"), results, &strips, &plots)?;
    experiment::write_page(store, results, &plots)?;
    Ok(())
}

fn finish(results: &Results, store: &Store, progress: &Progress) -> Result<(), CliError> {
    let mut answer = Answer::default();
    answer.line(experiment::summary(results).trim_end());
    answer.print()?;
    let page = store.folder().join("index.html");
    progress.line(&format!("wrote {}", page.display()));
    match results.failures() {
        0 => Ok(()),
        failures => Err(CliError::Limit(format!(
            "{failures} of {} cells failed; expected none: their messages are in {}",
            results.cells.len(),
            store.folder().join("results.csv").display()
        ))),
    }
}

/// A reference that shares its seed with a cell would share its noise as well, and a biased one is none.
fn refuse_reference(file: &Path, spec: &Spec) -> Result<(), CliError> {
    let seed = spec.reference.seed;
    if spec.seeds.0.contains(&seed) {
        let message = format!("found {seed}, which is among the seeds; expected another one");
        return Err(error_at(file, "reference.seed", &message));
    }
    match &spec.reference.method {
        Some(method) if !method.is_unbiased() => {
            let message = format!("found {method:?}, which is biased; expected an unbiased method");
            Err(error_at(file, "reference.method", &message))
        }
        _ => Ok(()),
    }
}

fn error_at(file: &Path, field: &str, message: &str) -> CliError {
    // It was read a moment ago; should it be gone, the error is still about the right file.
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let place = ron_file::place(&text, field).unwrap_or(Place { line: 1, column: 1 });
    CliError::Ron(RonError::File {
        file: file.display().to_string(),
        line: place.line,
        column: place.column,
        message: format!("{field}: {message}"),
    })
}

/// The scene files, or why there is none.
fn scenes(file: &Path, spec: &Spec) -> Vec<Result<PathBuf, String>> {
    let folder = file.parent().unwrap_or(Path::new(""));
    let entries = spec.scenes.0.iter().enumerate();
    let find = |(i, entry): (usize, &spec::SceneEntry)| {
        let field = format!("scenes[{i}].scene");
        find_scene(&entry.scene, folder).map_err(|m| error_at(file, &field, &m).to_string())
    };
    entries.map(find).collect()
}

/// Hash of the program's own file and of what else decides time: figures of two programs are not mixed.
fn program_hash(machine: &Machine) -> u64 {
    let mut hash = Fnv::default();
    let program = std::env::current_exe().and_then(std::fs::read);
    hash.file(&program.unwrap_or_default());
    hash.debug(machine);
    hash.0
}

/// What someone who pressed Ctrl-C is told.
fn interrupted(store: &Store) -> CliError {
    CliError::Interrupted(format!(
        "interrupted; finished cells are in {}: the same command goes on from there",
        store.folder().display()
    ))
}
