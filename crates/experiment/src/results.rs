//! All results of an experiment, and their summary over seeds.

use serde::{Deserialize, Serialize};

use crate::animation::Flickering;
use crate::cell::{Cell, Coordinates, Error, Figures, Outcome};
use crate::reference::Reference;
use crate::statistics::Spread;

/// What the cells were rendered by and on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Model of the processor.
    pub cpu: String,
    /// Threads of each render.
    pub threads: usize,
    /// Version of the program.
    pub version: String,
    /// Commit that it was built from.
    pub commit: String,
}

/// What the page shows of a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneView {
    /// Name of the scene.
    pub name: String,
    /// Parts of the picture to enlarge: left, top, width and height as shares of the picture's.
    pub crops: Vec<[f32; 4]>,
}

/// An experiment with all cells, finished or failed, in the order of the matrix.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// Stem of the experiment's file.
    pub name: String,
    /// One line that says what it is about.
    pub title: String,
    /// What it shows, in a few sentences; may be empty.
    pub about: String,
    /// Whether this is the quick form, whose figures are only a try.
    pub quick: bool,
    /// Where it ran.
    pub machine: Machine,
    /// What the page shows of each scene.
    pub scenes: Vec<SceneView>,
    /// What the cells are compared with.
    pub references: Vec<Reference>,
    /// The cells.
    pub cells: Vec<Cell>,
    /// How methods flicker, where scenes are animated.
    pub animations: Vec<Flickering>,
}

/// Cells that differ in seed and frame only.
#[derive(Debug, Clone, Serialize)]
pub struct Series<'a> {
    /// Name of the scene.
    pub scene: &'a str,
    /// Name of the light set.
    pub lights: &'a str,
    /// Name of the method.
    pub method: &'a str,
    /// Builder of the tree; empty without.
    pub tree: &'a str,
    /// What ended the renders.
    pub budget: &'a str,
    /// The cells that came out.
    #[serde(skip)]
    pub done: Vec<&'a Figures>,
    /// Messages of those that failed.
    pub failures: Vec<&'a str>,
}

impl Series<'_> {
    /// Median and range of a figure over seeds and frames; `None` where no cell has it.
    pub fn spread(&self, figure: impl Fn(&Figures) -> Option<f64>) -> Option<Spread> {
        Spread::of(self.done.iter().filter_map(|f| figure(f)))
    }

    /// Median and range of an error figure.
    pub fn error(&self, figure: fn(&Error) -> Option<f64>) -> Option<Spread> {
        self.spread(|f| figure(&f.error))
    }

    /// Method and, `with_tree`, tree: what a legend says.
    pub fn label(&self, with_tree: bool) -> String {
        label(self.method, self.tree, with_tree)
    }

    /// Whether the method says it is unbiased and yet the mean over its cells differs from the reference's by
    /// more than chance allows: five of the standard errors of that mean, once in two million by chance. Either
    /// the method or the reference is wrong then.
    pub fn is_suspicious(&self) -> bool {
        let biases: Vec<(f64, f64)> = self
            .done
            .iter()
            .filter(|f| f.unbiased)
            .filter_map(|f| Some((f.error.bias?, f.error.bias_95? / 1.96)))
            .collect();
        let n = biases.len() as f64;
        let mean = biases.iter().map(|b| b.0).sum::<f64>() / n;
        // The reference's own error is common to all: the standard errors do not average out.
        let error = biases.iter().map(|b| b.1).sum::<f64>() / n;
        mean.abs() > 5.0 * error
    }
}

/// What a legend calls a method on a tree.
fn label(method: &str, tree: &str, with_tree: bool) -> String {
    match with_tree && !tree.is_empty() {
        true => format!("{method}, {tree}"),
        false => method.to_owned(),
    }
}

impl Coordinates {
    /// Method and, `with_tree`, tree: what a legend says.
    pub fn label(&self, with_tree: bool) -> String {
        label(&self.method, &self.tree, with_tree)
    }
}

impl Results {
    /// The series, in the order in which their first cells come.
    pub fn series(&self) -> Vec<Series<'_>> {
        let mut all: Vec<Series<'_>> = Vec::new();
        for cell in &self.cells {
            let c = &cell.coordinates;
            let own = |s: &Series<'_>| {
                (s.scene, s.lights, s.method) == (&*c.scene, &*c.lights, &*c.method)
                    && (s.tree, s.budget) == (&*c.tree, &*c.budget)
            };
            let at = all.iter().position(own).unwrap_or_else(|| {
                all.push(Series {
                    scene: &c.scene,
                    lights: &c.lights,
                    method: &c.method,
                    tree: &c.tree,
                    budget: &c.budget,
                    done: Vec::new(),
                    failures: Vec::new(),
                });
                all.len() - 1
            });
            match &cell.outcome {
                Outcome::Done(figures) => all[at].done.push(figures),
                Outcome::Failed(message) => all[at].failures.push(message),
            }
        }
        all
    }

    /// Cells that failed.
    pub fn failures(&self) -> usize {
        self.cells.iter().filter(|c| c.figures().is_none()).count()
    }

    /// Whether the methods ran on more than one tree.
    pub fn has_trees(&self) -> bool {
        let mut trees = self.cells.iter().map(|c| &c.coordinates.tree);
        let first = trees.find(|t| !t.is_empty());
        trees.any(|t| !t.is_empty() && Some(t) != first)
    }
}
