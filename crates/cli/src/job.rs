//! The run file. A [`JobSpec`] is what is written, a [`Job`] what has been found sound.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use gather::{Integrator, MethodSpec, VirtualShape};
use light_tree::TreeBuilder;
use ron_file::{Override, Place, RonError};
use serde::Deserialize;

use crate::args::JobArgs;
use crate::error::CliError;
use crate::limits::MemoryLimit;

/// A run file with every field, its default, its range and what it means.
pub(crate) const ANNOTATED: &str = include_str!("annotated/run.ron");

/// A run file as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct JobSpec {
    scene: String,
    #[serde(default)]
    image: ImageSpec,
    #[serde(default)]
    lights: LightsSpec,
    #[serde(default)]
    integrator: IntegratorSpec,
    #[serde(default)]
    tree: TreeSpec,
    #[serde(default)]
    method: MethodSpec,
    #[serde(default = "default_seed")]
    seed: u64,
}

fn default_seed() -> u64 {
    1
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ImageSpec {
    width: Extent,
    height: Extent,
    spp: Samples,
}

impl Default for ImageSpec {
    fn default() -> Self {
        Self {
            width: Extent(960),
            height: Extent(540),
            spp: Samples(64),
        }
    }
}

/// Which lights light the scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
pub(crate) enum LightsSpec {
    /// The scene's own.
    #[default]
    AsGiven,
    /// The scene's own for direct light, and virtual ones for all that is reflected.
    Virtual(VirtualSpec),
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct VirtualSpec {
    pub(crate) kind: VirtualKind,
    pub(crate) count: LightCount,
    pub(crate) max_bounces: Bounces,
    /// Seed of the light paths; the run's own when not given.
    pub(crate) seed: Option<u64>,
}

impl Default for VirtualSpec {
    fn default() -> Self {
        Self {
            kind: VirtualKind::default(),
            count: LightCount(1_000_000),
            max_bounces: Bounces(8),
            seed: None,
        }
    }
}

/// How virtual lights shine.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(crate) enum VirtualKind {
    /// Spheres.
    Vsl(VslSpec),
    /// Points, with a clamped geometry term.
    Vpl(VplSpec),
}

impl Default for VirtualKind {
    fn default() -> Self {
        Self::Vsl(VslSpec::default())
    }
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct VslSpec {
    /// Scene units; from the lights' density when not given.
    pub(crate) radius: Option<Length>,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct VplSpec {
    /// Greatest cos cos / d², in 1/scene unit²; no clamp when not given.
    pub(crate) clamp: Option<Clamp>,
    /// Whether light that the clamp takes off is found again by eye paths.
    pub(crate) compensate: bool,
}

impl LightsSpec {
    /// Whether eye paths find again what a clamp takes off.
    pub(crate) fn compensates(&self) -> bool {
        self.points().is_some_and(|vpl| vpl.compensate)
    }

    /// Why lights cannot be used, if they cannot.
    pub(crate) fn conflict(&self) -> Option<&'static str> {
        let vpl = self.points()?;
        (vpl.compensate && vpl.clamp.is_none()).then_some(
            "found compensate: true without a clamp, so that nothing is missing; expected clamp: a number above 0",
        )
    }

    fn points(&self) -> Option<VplSpec> {
        match self {
            Self::Virtual(VirtualSpec {
                kind: VirtualKind::Vpl(vpl),
                ..
            }) => Some(*vpl),
            _ => None,
        }
    }
}

/// The light tree of methods that use one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct TreeSpec {
    /// How clusters are found.
    pub(crate) builder: Builder,
}

/// [`TreeBuilder`] in a run file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
pub(crate) enum Builder {
    /// Top-down over position and direction.
    #[default]
    Binned,
    /// Surface area orientation heuristic.
    Saoh,
    /// Morton code.
    Morton,
    /// Perfect binary tree over Morton order.
    PerfectMorton,
    /// Bottom-up.
    Agglomerative,
}

impl From<Builder> for TreeBuilder {
    fn from(builder: Builder) -> Self {
        match builder {
            Builder::Binned => Self::Binned,
            Builder::Saoh => Self::Saoh,
            Builder::Morton => Self::Morton,
            Builder::PerfectMorton => Self::PerfectMorton,
            Builder::Agglomerative => Self::Agglomerative,
        }
    }
}

/// [`Integrator`] in a run file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
pub(crate) enum IntegratorSpec {
    /// To the first hit, and from there to the lights in use.
    #[default]
    Direct,
    /// On behind it.
    Path(PathSpec),
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct PathSpec {
    max_bounces: PathBounces,
}

impl Default for PathSpec {
    fn default() -> Self {
        Self {
            max_bounces: PathBounces(5),
        }
    }
}

impl IntegratorSpec {
    /// Why paths cannot be followed under these lights, if they cannot.
    pub(crate) fn conflict(self, lights: &LightsSpec) -> Option<&'static str> {
        match (self, lights) {
            (Self::Path(_), LightsSpec::Virtual(_)) => Some(
                "found Path with lights: Virtual, which hold all that is reflected already; expected \
                 integrator: Direct, or lights: AsGiven",
            ),
            _ => None,
        }
    }

    /// What to follow under `lights`, with which there is no [conflict](Self::conflict).
    pub(crate) fn under(self, lights: &LightsSpec) -> Integrator {
        match (self, lights) {
            (Self::Path(path), _) => Integrator::Path {
                max_bounces: path.max_bounces.0,
            },
            (Self::Direct, LightsSpec::Virtual(spec)) if lights.compensates() => {
                Integrator::Compensated {
                    max_bounces: spec.max_bounces.0,
                }
            }
            (Self::Direct, _) => Integrator::Direct,
        }
    }
}

/// A whole number in a range, checked while it is read so that the message knows its place.
macro_rules! whole {
    ($name:ident, $type:ty, $range:expr) => {
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
        // Signed, so that a negative number comes as far as the message.
        #[serde(try_from = "i64")]
        pub(crate) struct $name(pub(crate) $type);

        impl $name {
            pub(crate) const RANGE: RangeInclusive<$type> = $range;
        }

        impl TryFrom<i64> for $name {
            type Error = String;

            fn try_from(value: i64) -> Result<Self, String> {
                let range = Self::RANGE;
                match <$type>::try_from(value) {
                    Ok(v) if range.contains(&v) => Ok(Self(v)),
                    _ => Err(format!(
                        "found {value}; expected {}..={}",
                        range.start(),
                        range.end()
                    )),
                }
            }
        }
    };
}

whole!(Extent, u32, 1..=65_536);
whole!(Samples, u32, 1..=16_777_216);
whole!(LightCount, usize, 0..=1_000_000_000);
whole!(Bounces, u32, 1..=1024);
whole!(PathBounces, u32, 0..=1024);

/// A finite length, 0 or more.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "f32")]
pub(crate) struct Length(pub(crate) f32);

impl TryFrom<f32> for Length {
    type Error = String;

    fn try_from(value: f32) -> Result<Self, String> {
        if value.is_finite() && value >= 0.0 {
            Ok(Self(value))
        } else {
            Err(format!(
                "found {value}; expected a finite length, 0 or more"
            ))
        }
    }
}

/// A finite number above 0.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "f32")]
pub(crate) struct Clamp(pub(crate) f32);

impl TryFrom<f32> for Clamp {
    type Error = String;

    fn try_from(value: f32) -> Result<Self, String> {
        if value.is_finite() && value > 0.0 {
            Ok(Self(value))
        } else {
            Err(format!("found {value}; expected a finite number above 0"))
        }
    }
}

/// Variants with fields that a run file may write without parentheses.
pub(crate) const BARE: &[&str] = &["Virtual", "Vsl", "Vpl", "Path"];

/// A sound job: every number is in range and the scene file is there to be read.
#[derive(Debug, Clone)]
pub(crate) struct Job {
    /// The run file.
    pub(crate) file: PathBuf,
    /// `scene.ron`.
    pub(crate) scene: PathBuf,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) spp: u32,
    pub(crate) lights: LightsSpec,
    pub(crate) integrator: Integrator,
    pub(crate) tree: TreeSpec,
    pub(crate) method: MethodSpec,
    pub(crate) seed: u64,
    /// A run file that says all this by itself, for the picture to carry; empty where there is none.
    pub(crate) config: String,
    /// The run file's stem.
    pub(crate) name: String,
    /// What it may take.
    pub(crate) limit: MemoryLimit,
}

/// The text of the run file; where `file` is a scene, that of a run file that renders it.
fn run_text(file: &Path) -> Result<String, CliError> {
    // What a scene is usually made for: all light, direct and reflected.
    let of_scene = |name: &str| format!("(scene: {name:?}, lights: Virtual)");
    if let Some(name) = scene::load::gltf_name(file) {
        return Ok(of_scene(name));
    }
    let text = ron_file::read_text(file)?;
    match file.file_name().and_then(|name| name.to_str()) {
        Some(name) if ron_file::has_field(&text, "geometry") => Ok(of_scene(name)),
        _ => Ok(text),
    }
}

impl Job {
    /// Reads the run file and applies what the command line overrides. A glTF file or a `scene.ron` in its place is
    /// rendered with virtual lights and else by default.
    pub(crate) fn read(arguments: &JobArgs) -> Result<Self, CliError> {
        let mut overrides = Vec::new();
        if let Some(method) = &arguments.method {
            let value = format!("{}()", method.variant());
            overrides.push(Override {
                path: "method".into(),
                value,
            });
        }
        overrides.extend(arguments.overrides.iter().cloned());
        let bare: Vec<&str> = BARE.iter().chain(MethodSpec::VARIANTS).copied().collect();
        let text = run_text(&arguments.config)?;
        let file = arguments.config.to_string_lossy();
        let spec: JobSpec = ron_file::parse(&file, &text, &overrides, &bare)?;
        if let Some(message) = spec.integrator.conflict(&spec.lights) {
            return Err(field_error(arguments, "integrator", message));
        }
        if let Some(message) = spec.lights.conflict() {
            return Err(field_error(arguments, "lights", message));
        }
        let image = spec.image;
        let [width, height] = arguments.size.unwrap_or([image.width.0, image.height.0]);
        let spp = arguments.spp.unwrap_or(image.spp.0);
        let folder = arguments.config.parent().unwrap_or(Path::new(""));
        let stem = arguments
            .config
            .file_stem()
            .map(|s| s.to_string_lossy().into_owned());
        let scene = find_scene(&spec.scene, folder)
            .map_err(|message| field_error(arguments, "scene", &message))?;
        let seed = arguments.seed.unwrap_or(spec.seed);
        let numbers = [
            arguments.size.map(|size| ("image.width", size[0].into())),
            arguments.size.map(|size| ("image.height", size[1].into())),
            arguments.spp.map(|spp| ("image.spp", spp.into())),
            arguments.seed.map(|seed| ("seed", seed)),
        ];
        overrides.extend(numbers.into_iter().flatten().map(|(path, value)| Override {
            path: path.into(),
            value: value.to_string(),
        }));
        let config = ron_file::overridden(&text, &overrides, &bare)?;
        Ok(Self {
            file: arguments.config.clone(),
            scene,
            width,
            height,
            spp,
            lights: spec.lights,
            integrator: spec.integrator.under(&spec.lights),
            tree: spec.tree,
            method: spec.method,
            seed,
            config,
            name: stem.unwrap_or_else(|| "render".into()),
            limit: MemoryLimit {
                most: arguments.max_memory,
            },
        })
    }

    /// How virtual lights shine.
    pub(crate) fn shape(&self) -> VirtualShape {
        match self.lights.points() {
            Some(vpl) => VirtualShape::ClampedPoint(vpl.clamp.map_or(f32::INFINITY, |c| c.0)),
            None => VirtualShape::Sphere,
        }
    }

    /// Estimated bytes for film and lights; the scene itself is loaded by then.
    pub(crate) fn memory(&self) -> u64 {
        // Per pixel: running statistics and features of the film (155), the finished picture (80), copies of
        // it while it is written (80). Per virtual light, while trees are built: the set (80 where all are glossy),
        // the tree (100), its eight-way form (47) and what that is made by; by any method 270 were measured at
        // most where few are glossy, and 306 where all are.
        const PIXEL: u64 = 315;
        const LIGHT: u64 = 320;
        let lights = match self.lights {
            LightsSpec::AsGiven => 0,
            LightsSpec::Virtual(v) => v.count.0 as u64,
        };
        let film = u64::from(self.width) * u64::from(self.height) * PIXEL;
        film + lights * LIGHT + self.method.most_learned_bytes(self.width, self.height)
    }

    /// Refuses a job that would not fit into memory, before anything large is allocated.
    pub(crate) fn refuse_too_large(&self) -> Result<(), CliError> {
        self.limit.refuse(self.memory()).map_err(|message| {
            CliError::Input(format!(
                "{}: a {}x{} picture and its lights need {message}: lower image.width, image.height or lights.count",
                self.file.display(),
                self.width,
                self.height,
            ))
        })
    }
}

/// The scene file that `found` names in a file in `folder`; else a message.
pub(crate) fn find_scene(found: &str, folder: &Path) -> Result<PathBuf, String> {
    let scene = scene::load::expand(found).map_err(|e| e.to_string())?;
    let scene = folder.join(scene);
    if scene.is_file() {
        return Ok(scene);
    }
    let what = match scene.is_dir() {
        true => "is a folder",
        false => "is not there",
    };
    let expected = match found.strip_prefix('$').and_then(|s| s.split('/').next()) {
        Some(variable) => format!("{variable} to be {}", scene::load::SCENE_FOLDER),
        None => "the path of a scene.ron, relative to this file".into(),
    };
    let file = scene.display();
    Err(format!(
        "found {found:?}: {file} {what}; expected {expected}"
    ))
}

/// An error about a `field` of the run file, at the place it comes from.
fn field_error(arguments: &JobArgs, field: &str, message: &str) -> CliError {
    let is_meant = |set: &&Override| set.path.split('.').next() == Some(field);
    let set = arguments.overrides.iter().rfind(is_meant);
    if let Some(set) = set {
        return CliError::Ron(RonError::Set {
            set: set.to_string(),
            message: message.to_owned(),
        });
    }
    // It was read a moment ago; should it be gone, the error is still about the right file.
    let text = std::fs::read_to_string(&arguments.config).unwrap_or_default();
    let place = ron_file::place(&text, field).unwrap_or(Place { line: 1, column: 1 });
    CliError::Ron(RonError::File {
        file: arguments.config.display().to_string(),
        line: place.line,
        column: place.column,
        message: format!("{field}: {message}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<JobSpec, RonError> {
        let bare: Vec<&str> = BARE.iter().chain(MethodSpec::VARIANTS).copied().collect();
        ron_file::parse("run.ron", text, &[], &bare)
    }

    #[test]
    fn the_annotated_run_file_says_what_the_types_hold() {
        let parse = |text: &str| read(text).map(|_| ()).map_err(|error| error.to_string());
        let found = verify::annotated(ANNOTATED, "", &parse);
        assert_eq!(found.complaints, Vec::<String>::new(), "complaints");
        // Its values are the defaults, and so are those of each choice.
        let shown = read(ANNOTATED).unwrap_or_else(|e| panic!("{e}"));
        let bare = read("(scene: \"scene.ron\")").unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(format!("{shown:?}"), format!("{bare:?}"), "defaults");
        let forms: Vec<JobSpec> = found.forms.iter().filter_map(|f| read(f).ok()).collect();
        for method in MethodSpec::all() {
            let is_shown = forms.iter().any(|form| form.method == method);
            assert!(is_shown, "{} with its defaults", method.variant());
        }
        for lights in [
            LightsSpec::Virtual(VirtualSpec::default()),
            LightsSpec::Virtual(VirtualSpec {
                kind: VirtualKind::Vpl(VplSpec::default()),
                ..VirtualSpec::default()
            }),
        ] {
            assert!(forms.iter().any(|form| form.lights == lights), "{lights:?}");
        }
        let path = IntegratorSpec::Path(PathSpec::default());
        assert!(forms.iter().any(|form| form.integrator == path), "{path:?}");
    }
}
