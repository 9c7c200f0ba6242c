//! The record of a reference picture.

use serde::{Deserialize, Serialize};

/// What the pictures of some cells are compared with, and how well that is known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reference {
    /// Hash of all that decides it, in hexadecimal: the name of its files.
    pub key: String,
    /// Name of the scene.
    pub scene: String,
    /// Name of the light set.
    pub lights: String,
    /// Frame of an animation, from 0.
    pub frame: u32,
    /// The method with all its settings.
    pub method: String,
    /// Whether one of the methods that are compared made it, because no other serves.
    pub under_test: bool,
    /// Seed, which no cell has.
    pub seed: u64,
    /// Samples a pixel.
    pub spp: u32,
    /// Seconds of rendering.
    pub seconds: f64,
    /// Its own relative standard error: the root of the `relmse` that its noise alone gives.
    pub standard_error: f64,
    /// The level asked for; a limit in samples or seconds may have come first.
    pub asked: f64,
    /// Version of the program that made it.
    pub version: String,
    /// Commit that program was built from.
    pub commit: String,
}

impl Reference {
    /// Whether it is as good as was asked for.
    pub fn is_good_enough(&self) -> bool {
        self.standard_error <= self.asked
    }
}
