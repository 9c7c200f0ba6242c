//! From an experiment to its cells, in the order in which they are rendered.

use std::path::{Path, PathBuf};

use experiment::Coordinates;

use super::budget::Budget;
use super::spec::{Labelled, Spec};
use crate::job::{Job, LightsSpec, TreeSpec};
use crate::limits::MemoryLimit;

/// A cell to be rendered.
#[derive(Debug, Clone)]
pub(crate) struct Planned {
    pub(crate) coordinates: Coordinates,
    pub(crate) budget: Budget,
    /// Of the scene, lights, method, tree, size and seed.
    pub(crate) job: Job,
    /// Whether its picture is kept for the page: those of the first seed are.
    pub(crate) keeps_picture: bool,
}

/// Cells that share scene, lights and camera, and so a reference.
#[derive(Debug, Clone)]
pub(crate) struct Group {
    /// Index among the experiment's scenes.
    pub(crate) scene: usize,
    /// Index among its light sets.
    pub(crate) lights: usize,
    pub(crate) frame: u32,
    pub(crate) cells: Vec<Planned>,
}

/// Seed of light paths in an experiment: the same lights for every seed of the renders.
const LIGHTS_SEED: u64 = 1;

/// All groups, with the scene files at `paths`, each cell within `limit`. `file` is the experiment's.
///
/// Within a group the methods take turns, budget by budget and seed by seed, so that a machine that becomes
/// slower does so for all of them.
pub(crate) fn plan(spec: &Spec, file: &Path, paths: &[PathBuf], limit: MemoryLimit) -> Vec<Group> {
    let mut groups = Vec::new();
    for (scene, entry) in spec.scenes.0.iter().enumerate() {
        for lights in 0..spec.lights.0.len() {
            let frames = entry.animation.as_ref().map_or(1, |a| a.frames.0);
            for frame in 0..frames {
                let mut group = Group {
                    scene,
                    lights,
                    frame,
                    cells: cells(spec, file, &paths[scene], scene, lights, frame),
                };
                for cell in &mut group.cells {
                    cell.job.limit = limit;
                }
                groups.push(group);
            }
        }
    }
    groups
}

fn cells(
    spec: &Spec,
    file: &Path,
    path: &Path,
    scene: usize,
    lights: usize,
    frame: u32,
) -> Vec<Planned> {
    let mut lights_spec = spec.lights.0[lights].lights;
    if let LightsSpec::Virtual(virtual_lights) = &mut lights_spec {
        virtual_lights.seed.get_or_insert(LIGHTS_SEED);
    }
    let mut cells = Vec::new();
    for &seed in &spec.seeds.0 {
        for &budget in &spec.budgets.0 {
            for (at, &builder) in spec.trees.0.iter().enumerate() {
                for entry in &spec.methods.0 {
                    // A method without a tree is the same on all of them.
                    let uses_tree = entry.method.uses_tree();
                    if !uses_tree && at > 0 {
                        continue;
                    }
                    let tree = match uses_tree {
                        true => builder.label(),
                        false => String::new(),
                    };
                    cells.push(Planned {
                        coordinates: Coordinates {
                            scene: spec.scenes.0[scene].name.clone(),
                            lights: spec.lights.0[lights].name.clone(),
                            method: entry.name.clone(),
                            tree,
                            budget: budget.to_string(),
                            seed,
                            frame,
                        },
                        budget,
                        job: Job {
                            file: file.to_owned(),
                            scene: path.to_owned(),
                            width: spec.image.width.0,
                            height: spec.image.height.0,
                            spp: budget.most_spp(),
                            integrator: spec.integrator.under(&lights_spec),
                            lights: lights_spec,
                            tree: TreeSpec { builder },
                            method: entry.method.clone(),
                            // Every frame has noise of its own.
                            seed: seed.wrapping_add(u64::from(frame) << 32),
                            name: entry.name.clone(),
                            limit: MemoryLimit::default(),
                        },
                        keeps_picture: seed == spec.seeds.0[0],
                    });
                }
            }
        }
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use gather::MethodSpec;

    fn parsed(text: &str) -> Result<Spec, ron_file::RonError> {
        let bare = crate::job::BARE.iter().chain(MethodSpec::VARIANTS);
        let bare: Vec<&str> = bare.copied().collect();
        ron_file::parse("test.ron", text, &[], &bare)
    }

    fn spec(text: &str) -> Spec {
        parsed(text).expect("sound")
    }

    const TEXT: &str = "(
        title: \"t\",
        image: (width: 640, height: 360),
        scenes: [
            (name: \"still\", scene: \"a.ron\"),
            (name: \"moving\", scene: \"b.ron\", animation: (frames: 3, path: Lights([(0, 0, 0), (1, 0, 0)]))),
        ],
        lights: [
            (name: \"lamps\", lights: AsGiven),
            (name: \"many\", lights: Virtual(count: 1000000)),
            (name: \"more\", lights: Virtual(count: 2000000)),
        ],
        trees: [Binned, Morton],
        methods: [
            (name: \"power\", method: Power),
            (name: \"cuts\", method: StochasticLightcuts(cut: 4)),
        ],
        budgets: [Spp(1), Spp(16), Seconds(30)],
        seeds: [5, 6],
    )";

    fn groups(spec: &Spec) -> Vec<Group> {
        let paths = ["a.ron".into(), "b.ron".into()];
        plan(spec, Path::new("e.ron"), &paths, MemoryLimit::default())
    }

    #[test]
    fn every_combination_is_there_once() {
        let spec = spec(TEXT);
        let groups = groups(&spec);
        assert_eq!(groups.len(), 3 + 3 * 3, "scenes × lights × frames");
        // Seeds × budgets × (one method on two trees, and one without).
        assert!(groups.iter().all(|g| g.cells.len() == 2 * 3 * 3), "cells");
        let mut seen: Vec<_> = groups
            .iter()
            .flat_map(|g| g.cells.iter().map(|c| c.coordinates.clone()))
            .collect();
        let all = seen.len();
        seen.sort();
        seen.dedup();
        assert_eq!(seen.len(), all, "twice");
    }

    #[test]
    fn methods_take_turns_and_seeds_come_last() {
        let spec = spec(TEXT);
        let order: Vec<_> = groups(&spec)[0]
            .cells
            .iter()
            .map(|c| format!("{} {}", c.coordinates.method, c.coordinates.tree))
            .collect();
        assert_eq!(
            order[..3],
            ["power ", "cuts Binned", "cuts Morton"],
            "turns"
        );
        assert!(order.chunks(3).all(|turn| turn == &order[..3]), "{order:?}");
        let seeds: Vec<_> = groups(&spec)[0].cells.iter().map(|c| c.job.seed).collect();
        assert!(seeds.is_sorted(), "{seeds:?}");
    }

    #[test]
    fn renders_of_different_seeds_see_the_same_lights_and_frames_differ_in_noise() {
        let spec = spec(TEXT);
        let groups = groups(&spec);
        for group in &groups {
            for cell in &group.cells {
                if let LightsSpec::Virtual(lights) = cell.job.lights {
                    assert_eq!(lights.seed, Some(LIGHTS_SEED), "seed of light paths");
                }
            }
        }
        let seed = |frame| {
            let group = groups.iter().find(|g| g.scene == 1 && g.frame == frame);
            group.expect("a frame").cells[0].job.seed
        };
        assert!(seed(0) != seed(1) && seed(1) != seed(2), "noise");
    }

    #[test]
    fn the_quick_form_is_small() {
        let spec = spec(TEXT).quick();
        assert_eq!((spec.image.width.0, spec.image.height.0), (160, 90), "size");
        let budgets: Vec<_> = spec.budgets.0.iter().map(Budget::to_string).collect();
        assert_eq!(budgets, ["1 spp", "4 spp", "1 s"], "budgets");
        assert_eq!(spec.lights.0.len(), 2, "sets that became alike are one");
        assert_eq!(spec.seeds.0, [5], "seeds");
        let groups = groups(&spec);
        assert_eq!(groups.len(), 2 + 2 * 3, "frames up to four");
        let many = groups[1].cells[0].job.lights;
        assert!(
            matches!(many, LightsSpec::Virtual(v) if v.count.0 == 20_000),
            "{many:?}"
        );
    }

    #[test]
    fn lists_are_neither_empty_nor_ambiguous() {
        let refused = |from: &str, to: &str| {
            let text = TEXT.replace(from, to);
            assert!(text != TEXT, "{from}");
            parsed(&text).expect_err("refused").to_string()
        };
        let error = refused("seeds: [5, 6]", "seeds: []");
        assert!(
            error.contains("19:16: seeds: found an empty list"),
            "{error}"
        );
        let error = refused("seeds: [5, 6]", "seeds: [5, 5]");
        assert!(error.contains("seeds: found 5 twice"), "{error}");
        let error = refused("name: \"many\"", "name: \"lamps\"");
        assert!(error.contains("lights: found lamps twice"), "{error}");
        let error = refused("Seconds(30)", "Seconds(0)");
        assert!(error.contains("found 0; expected"), "{error}");
        let error = refused("frames: 3", "frames: 1");
        assert!(error.contains("frames: found 1; expected 2..="), "{error}");
        let error = refused("[(0, 0, 0), (1, 0, 0)]", "[(0, 0, 0)]");
        assert!(
            error.contains("found 1 keys; expected at least 2"),
            "{error}"
        );
    }
}
