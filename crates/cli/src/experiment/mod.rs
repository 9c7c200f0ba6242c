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
mod spec;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

use experiment::{
    Cell, Figures, Machine, Outcome, Reference, Results, SceneView, Seconds, Store, store,
};
use gather::{MethodSpec, Shard};
use ron_file::{Place, RonError};

use crate::answer::Answer;
use crate::args::ExperimentArgs;
use crate::error::CliError;
use crate::fingerprint::Fnv;
use crate::interrupt;
use crate::job::{self, Builder, Job, LightsSpec, find_scene};
use crate::machine::cpu_model;
use crate::output::check_folder;
use crate::prepared::{LoadedScene, PreparedLights};
use crate::progress::Progress;
use crate::report;
use crate::state::Subject;
use matrix::{Group, Planned};
use path::{Still, moves_lights};
use reference::Compared;
use render_cell::Rendered;
use spec::Spec;

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
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads.map_or(0, usize::from))
        .build()
        .map_err(|e| CliError::Input(format!("--threads: cannot start threads: {e}")))?;
    pool.install(|| {
        let store = Store::new(&folder);
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
        let ended = run.all(matrix::plan(&spec, file, &paths), &scenes);
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
    experiment::write_summary(&folder.join("summary.md"), results)?;
    let plots = experiment::write_plots(folder, results)?;
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

/// What all parts of a run use.
pub(crate) struct Machinery<'a> {
    pub(crate) store: &'a Store,
    pub(crate) progress: &'a Progress,
}

struct Run<'a> {
    spec: &'a Spec,
    machinery: Machinery<'a>,
    program: u64,
    /// Cells so far, and of all.
    planned: usize,
    total: usize,
    results: Results,
}

/// A scene in use.
struct Stage {
    scene: usize,
    loaded: LoadedScene,
    still: Still,
    /// Light set and, where lights move, frame that `lit` is of.
    which: Option<(usize, Option<u32>)>,
    /// By tree builder.
    lit: Vec<Lit>,
}

/// Lights with one kind of tree.
struct Lit {
    builder: Builder,
    lights: PreparedLights,
    /// 0 until a method asks for the tree.
    tree_seconds: f64,
}

impl Run<'_> {
    /// Renders what is not there yet.
    ///
    /// # Errors
    /// When results cannot be read or written, or someone wants it to stop: what failed in a cell is in its record.
    fn all(
        &mut self,
        groups: Vec<Group>,
        scenes: &[Result<PathBuf, String>],
    ) -> Result<(), CliError> {
        self.total = groups.iter().map(|g| g.cells.len()).sum();
        let mut stage: Option<Stage> = None;
        for group in groups {
            if stage.as_ref().is_none_or(|s| s.scene != group.scene) {
                // The old scene goes before the new one comes.
                drop(stage.take());
                stage = match self.load(&group, &scenes[group.scene]) {
                    Ok(stage) => Some(stage),
                    Err(message) => {
                        self.fail(group.cells, &message);
                        continue;
                    }
                };
            }
            if let Some(stage) = &mut stage {
                self.group(group, stage)?;
            }
        }
        Ok(())
    }

    fn load(&self, group: &Group, scene: &Result<PathBuf, String>) -> Result<Stage, String> {
        let path = scene.as_ref().map_err(Clone::clone)?;
        let loaded = LoadedScene::load(path, self.machinery.progress).map_err(|e| e.to_string())?;
        Ok(Stage {
            scene: group.scene,
            still: Still::of(&loaded.scene),
            loaded,
            which: None,
            lit: Vec::new(),
        })
    }

    /// Records cells that cannot be rendered.
    fn fail(&mut self, cells: Vec<Planned>, message: &str) {
        for cell in cells {
            self.planned += 1;
            self.record(cell, Outcome::Failed(message.to_owned()));
        }
    }

    fn record(&mut self, cell: Planned, outcome: Outcome) {
        let c = &cell.coordinates;
        let what = match &outcome {
            Outcome::Done(f) => {
                let relmse = f
                    .error
                    .relmse
                    .map_or("infinite".into(), |e| format!("{e:.3e}"));
                format!("{:.1} s, relmse {relmse}", f.seconds.render)
            }
            Outcome::Failed(message) => format!("failed: {message}"),
        };
        let frame = match c.frame {
            0 => String::new(),
            frame => format!(", frame {frame}"),
        };
        self.machinery.progress.line(&format!(
            "{}/{}: {}, {}, {} {}, {}, seed {}{frame}: {what}",
            self.planned, self.total, c.scene, c.lights, c.method, c.tree, c.budget, c.seed
        ));
        self.results.cells.push(Cell {
            settings: format!("{:?}", cell.job.method),
            coordinates: cell.coordinates,
            outcome,
        });
    }

    fn group(&mut self, group: Group, stage: &mut Stage) -> Result<(), CliError> {
        let animation = self.spec.scenes.0[group.scene].animation.as_ref();
        stage
            .still
            .pose(&mut stage.loaded.scene, animation, group.frame);
        let (job, under_test) = match self.reference_job(&group, &stage.loaded) {
            Ok(found) => found,
            Err(error) => {
                self.fail(group.cells, &error.to_string());
                return Ok(());
            }
        };
        let subject = Subject::of(&job, &stage.loaded.scene, Shard::ALL);
        let reference_key = reference::key(&subject, &self.spec.reference);
        let mut compared: Option<Result<Compared, String>> = None;
        for cell in group.cells {
            self.planned += 1;
            let key = self.key(&cell, &stage.loaded, &reference_key);
            if let Some(figures) = self.kept(&cell, &key)? {
                self.record(cell, Outcome::Done(Box::new(figures)));
                continue;
            }
            let frame = moves_lights(animation).then_some(group.frame);
            let at = stage.light(&cell, (group.lights, frame), self.machinery.progress);
            let (loaded, lit) = (&stage.loaded, &stage.lit[at]);
            let reference = compared.get_or_insert_with(|| {
                guarded(|| {
                    let wanted = reference::Wanted {
                        spec: &self.spec.reference,
                        key: &reference_key,
                        coordinates: &cell.coordinates,
                        job: &job,
                        subject: &subject,
                        under_test,
                    };
                    reference::obtain(&self.machinery, &wanted, loaded, &lit.lights)
                })
            });
            let outcome = match reference {
                Ok(reference) => self.cell(&cell, &key, loaded, lit, reference)?,
                Err(message) => Outcome::Failed(format!("reference: {message}")),
            };
            // Whoever wants it to stop may have said so while a reference was made.
            self.refuse_interrupted()?;
            self.record(cell, outcome);
        }
        let path = self.machinery.store.reference(&reference_key, "json");
        self.results
            .references
            .extend(store::read_record::<Reference>(&path)?);
        Ok(())
    }

    /// The group's reference as a job, and whether its method is one of those under test.
    fn reference_job(&self, group: &Group, loaded: &LoadedScene) -> Result<(Job, bool), CliError> {
        let first = &group.cells[0].job;
        first.refuse_too_large()?;
        // How many lights there will be decides nothing but the reference's method, so about will do.
        let about = match first.lights {
            LightsSpec::AsGiven => vpl::source_lights(&loaded.scene).len(),
            LightsSpec::Virtual(v) => v.count.0,
        };
        let choice = reference::choose(&self.spec.reference, &self.spec.methods.0, about);
        let job = Job {
            method: choice.method,
            seed: self.spec.reference.seed,
            spp: self.spec.reference.max_spp.0,
            ..first.clone()
        };
        Ok((job, choice.under_test))
    }

    /// Hash of all that decides a cell's figures, time among them.
    fn key(&self, cell: &Planned, loaded: &LoadedScene, reference: &str) -> String {
        let mut hash = Fnv::default();
        hash.debug(&self.program);
        hash.debug(&Subject::of(&cell.job, &loaded.scene, Shard::ALL));
        hash.debug(&(cell.budget, reference));
        format!("{:016x}", hash.0)
    }

    /// The figures of a cell that is there already, with its picture where that is wanted.
    fn kept(&self, cell: &Planned, key: &str) -> Result<Option<Figures>, CliError> {
        let store = self.machinery.store;
        let kept = store::read_record::<Figures>(&store.cell(key, "json"))?;
        Ok(kept.filter(|_| !cell.keeps_picture || store.cell(key, "exr").is_file()))
    }

    /// Renders a cell and keeps it.
    ///
    /// # Errors
    /// When it cannot be kept, or someone wants it to stop.
    fn cell(
        &self,
        cell: &Planned,
        key: &str,
        loaded: &LoadedScene,
        lit: &Lit,
        reference: &Compared,
    ) -> Result<Outcome, CliError> {
        let seconds = Seconds {
            load: loaded.load_seconds,
            bvh: loaded.bvh_seconds,
            lights: lit.lights.seconds,
            tree: match cell.job.method.uses_tree() {
                true => lit.tree_seconds,
                false => 0.0,
            },
            render: 0.0,
        };
        let inputs = &lit.lights.inputs;
        let rendered =
            guarded(|| render_cell::render(cell, key, loaded, inputs, reference, seconds));
        let (figures, image) = match rendered {
            Ok(Some(Rendered { figures, image })) => (figures, image),
            Ok(None) => return Err(interrupted(self.machinery.store)),
            Err(message) => return Ok(Outcome::Failed(message)),
        };
        let store = self.machinery.store;
        if cell.keeps_picture {
            let attributes = report::attributes(&cell.job, &loaded.scene, figures.spp);
            image.write_exr(&store.cell(key, "exr"), &attributes)?;
        }
        // Last, for it says that the cell is whole.
        store::write_record(&store.cell(key, "json"), &figures)?;
        Ok(Outcome::Done(Box::new(figures)))
    }

    fn refuse_interrupted(&self) -> Result<(), CliError> {
        match interrupt::flag().load(Ordering::Relaxed) {
            true => Err(interrupted(self.machinery.store)),
            false => Ok(()),
        }
    }
}

impl Stage {
    /// Makes the lights of `cell`, unless they are there, and says where in `lit`.
    ///
    /// `which` is the light set, and the frame where lights differ from frame to frame.
    fn light(&mut self, cell: &Planned, which: (usize, Option<u32>), progress: &Progress) -> usize {
        if self.which != Some(which) {
            // The old lights go before the new ones come.
            self.lit.clear();
            self.which = Some(which);
        }
        let builder = cell.job.tree.builder;
        let at = match self.lit.iter().position(|lit| lit.builder == builder) {
            Some(at) => at,
            None => {
                self.lit.push(Lit {
                    builder,
                    lights: PreparedLights::trace(&cell.job, &self.loaded, progress),
                    tree_seconds: 0.0,
                });
                self.lit.len() - 1
            }
        };
        let lit = &mut self.lit[at];
        if cell.job.method.uses_tree() && lit.lights.inputs.built_tree().is_none() {
            let started = Instant::now();
            lit.lights.inputs.tree();
            lit.tree_seconds = started.elapsed().as_secs_f64();
        }
        at
    }
}

/// What `work` gives, or what was wrong: a defect in one method must not end hours of others.
fn guarded<T>(work: impl FnOnce() -> Result<T, CliError>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(done) => done.map_err(|error| error.to_string()),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or(panic.downcast_ref::<&str>().copied());
            Err(format!(
                "the program is at fault: {}",
                text.unwrap_or("panic")
            ))
        }
    }
}
