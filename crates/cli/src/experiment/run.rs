//! Goes through the cells: makes what a group shares, once, and renders what is not there yet.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Instant;

use experiment::{Cell, Figures, Outcome, Reference, Results, Seconds, Store, store};
use gather::Shard;

use super::interrupted;
use super::matrix::{Group, Planned};
use super::path::{Still, moves_lights};
use super::reference::{self, Compared};
use super::render_cell::{self, Rendered};
use super::spec::Spec;
use crate::error::CliError;
use crate::fingerprint::Fnv;
use crate::interrupt;
use crate::job::{Builder, Job, LightsSpec};
use crate::prepared::{LoadedScene, PreparedLights};
use crate::progress::Progress;
use crate::report;
use crate::state::Subject;

/// What all parts of a run use.
pub(crate) struct Machinery<'a> {
    pub(crate) store: &'a Store,
    pub(crate) progress: &'a Progress,
}

/// An experiment under way.
pub(super) struct Run<'a> {
    pub(super) spec: &'a Spec,
    pub(super) machinery: Machinery<'a>,
    pub(super) program: u64,
    /// Cells so far, and of all.
    pub(super) planned: usize,
    pub(super) total: usize,
    pub(super) results: Results,
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
    pub(super) fn all(
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
        let limit = group.cells[0].job.limit;
        let loaded =
            LoadedScene::load(path, limit, self.machinery.progress).map_err(|e| e.to_string())?;
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
            let metadata = report::metadata(&cell.job, &loaded.scene, figures.spp);
            image.write_exr(&store.cell(key, "exr"), &metadata)?;
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
