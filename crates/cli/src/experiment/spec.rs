//! The experiment's file, found sound while it is read.

use gather::MethodSpec;
use glam::Vec3;
use serde::Deserialize;

use super::budget::Budget;
use crate::job::{Builder, Extent, IntegratorSpec, LightCount, LightsSpec, Samples};

/// An experiment with every field, its default, its range and what it means.
pub(crate) const ANNOTATED: &str = include_str!("../annotated/experiment.ron");

/// A file of `configs/experiments/`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Spec {
    pub(crate) title: String,
    #[serde(default)]
    pub(crate) about: String,
    pub(crate) image: ImageSize,
    pub(crate) scenes: List<SceneEntry>,
    #[serde(default = "as_given")]
    pub(crate) lights: List<LightsEntry>,
    /// The same for all.
    #[serde(default)]
    pub(crate) integrator: IntegratorSpec,
    #[serde(default = "default_builders")]
    pub(crate) trees: List<Builder>,
    pub(crate) methods: List<MethodEntry>,
    pub(crate) budgets: List<Budget>,
    #[serde(default = "default_seeds")]
    pub(crate) seeds: List<u64>,
    #[serde(default)]
    pub(crate) reference: ReferenceSpec,
}

fn as_given() -> List<LightsEntry> {
    List(vec![LightsEntry {
        name: "as given".into(),
        lights: LightsSpec::AsGiven,
    }])
}

fn default_builders() -> List<Builder> {
    List(vec![Builder::default()])
}

fn default_seeds() -> List<u64> {
    List(vec![1, 2, 3])
}

/// Pixels of every picture.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ImageSize {
    pub(crate) width: Extent,
    pub(crate) height: Extent,
}

/// A scene and what is looked at in it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SceneEntry {
    pub(crate) name: String,
    pub(crate) scene: String,
    /// Parts of the picture that the page shows enlarged.
    #[serde(default)]
    pub(crate) crops: Vec<Crop>,
    /// Frames along a path; one still picture when not given.
    #[serde(default)]
    pub(crate) animation: Option<Animation>,
}

/// Left, top, width and height, as shares of the picture's.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "(f32, f32, f32, f32)")]
pub(crate) struct Crop(pub(crate) [f32; 4]);

impl TryFrom<(f32, f32, f32, f32)> for Crop {
    type Error = String;

    fn try_from(found: (f32, f32, f32, f32)) -> Result<Self, String> {
        let (x, y, w, h) = found;
        // A comparison with NaN is false.
        let within =
            |start: f32, extent: f32| start >= 0.0 && extent > 0.0 && start + extent <= 1.0;
        match within(x, w) && within(y, h) {
            true => Ok(Self([x, y, w, h])),
            false => Err(format!(
                "found {found:?}; expected left, top, width and height of a part of the picture, whose own width \
                 and height are 1"
            )),
        }
    }
}

/// Frames along a path.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Animation {
    pub(crate) frames: FrameCount,
    pub(crate) path: Path,
}

/// What moves, in equal steps from the first key to the last, straight between them.
#[derive(Debug, Clone, Deserialize)]
pub(crate) enum Path {
    /// The camera: where it stands and where it looks.
    Camera(Keys<CameraKey>),
    /// The scene's point lights: how far from where the scene has them.
    Lights(Keys<Offset>),
}

/// Where the camera is.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CameraKey {
    pub(crate) origin: Offset,
    pub(crate) target: Offset,
}

/// Three finite numbers, scene units.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(try_from = "(f32, f32, f32)")]
pub(crate) struct Offset(pub(crate) Vec3);

impl TryFrom<(f32, f32, f32)> for Offset {
    type Error = String;

    fn try_from(found: (f32, f32, f32)) -> Result<Self, String> {
        let offset = Vec3::from(found);
        match offset.is_finite() && offset.abs().max_element() <= 1e12 {
            true => Ok(Self(offset)),
            false => Err(format!(
                "found {found:?}; expected three numbers from -1e12 to 1e12"
            )),
        }
    }
}

/// At least two keys.
#[derive(Debug, Clone, Deserialize)]
#[serde(try_from = "Vec<T>", bound(deserialize = "T: Deserialize<'de>"))]
pub(crate) struct Keys<T>(pub(crate) Vec<T>);

impl<T> TryFrom<Vec<T>> for Keys<T> {
    type Error = String;

    fn try_from(found: Vec<T>) -> Result<Self, String> {
        match found.len() >= 2 {
            true => Ok(Self(found)),
            false => Err(format!("found {} keys; expected at least 2", found.len())),
        }
    }
}

/// Frames of an animation.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(try_from = "i64")]
pub(crate) struct FrameCount(pub(crate) u32);

impl TryFrom<i64> for FrameCount {
    type Error = String;

    fn try_from(found: i64) -> Result<Self, String> {
        match u32::try_from(found) {
            Ok(frames) if (2..=10_000).contains(&frames) => Ok(Self(frames)),
            _ => Err(format!("found {found}; expected 2..=10000")),
        }
    }
}

/// A set of lights under a name.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LightsEntry {
    pub(crate) name: String,
    pub(crate) lights: LightsSpec,
}

/// A method under a name.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MethodEntry {
    pub(crate) name: String,
    pub(crate) method: MethodSpec,
}

/// How the pictures are made that all others are measured against.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct ReferenceSpec {
    /// An unbiased one that is not compared itself, when not given.
    pub(crate) method: Option<MethodSpec>,
    pub(crate) seed: u64,
    /// Relative standard error that is good enough: the root of the `relmse` that noise alone gives.
    pub(crate) standard_error: Level,
    pub(crate) max_spp: Samples,
    /// Seconds after which a reference is taken as it is.
    pub(crate) max_seconds: Level,
}

impl Default for ReferenceSpec {
    fn default() -> Self {
        Self {
            method: None,
            seed: 1_000_003,
            standard_error: Level(0.01),
            max_spp: Samples(65_536),
            max_seconds: Level(3600.0),
        }
    }
}

/// A finite number above 0.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "f64")]
pub(crate) struct Level(pub(crate) f64);

impl TryFrom<f64> for Level {
    type Error = String;

    fn try_from(found: f64) -> Result<Self, String> {
        match found.is_finite() && found > 0.0 {
            true => Ok(Self(found)),
            false => Err(format!("found {found}; expected a finite number above 0")),
        }
    }
}

/// What tables and plots call an entry of a list.
pub(crate) trait Labelled {
    fn label(&self) -> String;
}

impl Labelled for SceneEntry {
    fn label(&self) -> String {
        self.name.clone()
    }
}

impl Labelled for LightsEntry {
    fn label(&self) -> String {
        self.name.clone()
    }
}

impl Labelled for MethodEntry {
    fn label(&self) -> String {
        self.name.clone()
    }
}

impl Labelled for Builder {
    fn label(&self) -> String {
        format!("{self:?}")
    }
}

impl Labelled for Budget {
    fn label(&self) -> String {
        self.to_string()
    }
}

impl Labelled for u64 {
    fn label(&self) -> String {
        self.to_string()
    }
}

/// A list that is not empty, with entries of different labels.
#[derive(Debug, Clone, Deserialize)]
#[serde(
    try_from = "Vec<T>",
    bound(deserialize = "T: Deserialize<'de> + Labelled")
)]
pub(crate) struct List<T>(pub(crate) Vec<T>);

impl<T: Labelled> TryFrom<Vec<T>> for List<T> {
    type Error = String;

    fn try_from(found: Vec<T>) -> Result<Self, String> {
        if found.is_empty() {
            return Err("found an empty list; expected at least one entry".into());
        }
        let mut labels: Vec<String> = found.iter().map(Labelled::label).collect();
        if labels.iter().any(|label| label.trim().is_empty()) {
            return Err("found an entry without a name; expected a name for each".into());
        }
        labels.sort_unstable();
        match labels.windows(2).find(|pair| pair[0] == pair[1]) {
            Some(pair) => Err(format!(
                "found {} twice; expected entries that differ",
                pair[0]
            )),
            None => Ok(Self(found)),
        }
    }
}

impl<T: Labelled> List<T> {
    /// The list after `change`; entries that become alike are one.
    fn reduced(self, change: impl FnMut(T) -> T) -> Self {
        let mut kept: Vec<T> = Vec::new();
        for entry in self.0.into_iter().map(change) {
            if kept.iter().all(|other| other.label() != entry.label()) {
                kept.push(entry);
            }
        }
        Self(kept)
    }
}

/// Limits of the quick form: a cell takes about a second.
mod quick {
    pub(super) const WIDTH: u32 = 160;
    pub(super) const LIGHTS: usize = 20_000;
    pub(super) const FRAMES: u32 = 4;
    pub(super) const STANDARD_ERROR: f64 = 0.05;
    pub(super) const REFERENCE_SECONDS: f64 = 10.0;
}

impl Spec {
    /// The quick form, which shows in minutes that an experiment works: small pictures, one seed, few lights,
    /// few frames, small budgets and rough references. Its figures mean little.
    pub(crate) fn quick(mut self) -> Self {
        let (width, height) = (self.image.width.0, self.image.height.0);
        if width > quick::WIDTH {
            let height = (height * quick::WIDTH).div_ceil(width).max(1);
            self.image = ImageSize {
                width: Extent(quick::WIDTH),
                height: Extent(height),
            };
        }
        self.seeds.0.truncate(1);
        self.budgets = self.budgets.reduced(Budget::quick);
        // Sets that become alike are one.
        let mut kept: Vec<LightsEntry> = Vec::new();
        for mut entry in self.lights.0 {
            if let LightsSpec::Virtual(spec) = &mut entry.lights
                && spec.count.0 > quick::LIGHTS
            {
                spec.count = LightCount(quick::LIGHTS);
                entry.name = format!("{}, here {}", entry.name, quick::LIGHTS);
            }
            if kept.iter().all(|other| other.lights != entry.lights) {
                kept.push(entry);
            }
        }
        self.lights = List(kept);
        for scene in &mut self.scenes.0 {
            if let Some(animation) = &mut scene.animation {
                animation.frames.0 = animation.frames.0.min(quick::FRAMES);
            }
        }
        let reference = &mut self.reference;
        reference.standard_error.0 = reference.standard_error.0.max(quick::STANDARD_ERROR);
        reference.max_seconds.0 = reference.max_seconds.0.min(quick::REFERENCE_SECONDS);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Spec, ron_file::RonError> {
        let bare = crate::job::BARE.iter().chain(MethodSpec::VARIANTS);
        let bare: Vec<&str> = bare.copied().collect();
        ron_file::parse("experiment.ron", text, &[], &bare)
    }

    #[test]
    fn the_annotated_experiment_says_what_the_types_hold() {
        let parse = |text: &str| read(text).map(|_| ()).map_err(|error| error.to_string());
        let found = verify::annotated(ANNOTATED, crate::job::ANNOTATED, &parse);
        assert_eq!(found.complaints, Vec::<String>::new(), "complaints");
        assert!(found.forms.len() >= 8, "{} forms", found.forms.len());
        let bare = "(
            title: \"Two methods\", image: (width: 320, height: 180),
            scenes: [(name: \"nave\", scene: \"scene.ron\")],
            methods: [
                (name: \"lightcuts\", method: Lightcuts(cut: 10)),
                (name: \"stochastic\", method: StochasticLightcuts(cut: 10)),
            ],
            budgets: [Spp(16)],
        )";
        let [shown, bare] =
            [ANNOTATED, bare].map(|text| read(text).unwrap_or_else(|e| panic!("{e}")));
        assert_eq!(format!("{shown:?}"), format!("{bare:?}"), "defaults");
    }

    #[test]
    fn the_ready_experiments_are_sound_and_say_what_they_show() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/experiments");
        let mut count = 0;
        for entry in std::fs::read_dir(folder).expect("the folder") {
            let path = entry.expect("an entry").path();
            let text = std::fs::read_to_string(&path).expect("reads");
            let spec = read(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            assert!(
                text.starts_with("// "),
                "{}: what does it show?",
                path.display()
            );
            assert!(!spec.about.is_empty(), "{}: about", path.display());
            count += 1;
        }
        assert!(count >= 8, "{count} experiments");
    }
}
