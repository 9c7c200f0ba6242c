//! The command line.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use gather::{MethodSpec, Shard};
use ron_file::Override;

use crate::help::{self, examples};
use crate::job::{Extent, Samples};
use crate::limits::Bytes;

/// A many-light renderer: a million virtual lights, one light tree, and every method that draws from it.
#[derive(Debug, Parser)]
#[command(version, about, arg_required_else_help = true, after_help = examples::ALL, max_term_width = 120)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Render a picture: writes NAME.exr, NAME.png and NAME.json
    #[command(after_help = examples::RENDER)]
    Render(RenderArgs),
    /// Show the picture refining on a page on this machine, from any camera and by any method
    #[command(after_help = examples::VIEW)]
    View(ViewArgs),
    /// Read everything a render would read and say what it needs, without rendering
    #[command(after_help = examples::CHECK)]
    Check(CheckArgs),
    /// Render a matrix of scenes, lights, methods, budgets and seeds: writes tables, plots and a page
    #[command(after_help = examples::EXPERIMENT)]
    Experiment(ExperimentArgs),
    /// Print error figures of an EXR against a reference
    #[command(after_help = examples::COMPARE)]
    Compare(CompareArgs),
    /// Combine the shards of one render into the whole picture
    #[command(after_help = examples::MERGE)]
    Merge(MergeArgs),
    /// Write a built-in scene as files
    #[command(after_help = examples::SCENE)]
    Scene(SceneArgs),
    /// Print a file with every field, its default, its range and what it means
    #[command(after_help = examples::CONFIG)]
    Config(ConfigArgs),
    /// Print a script that completes command lines
    #[command(after_help = examples::COMPLETIONS)]
    Completions(CompletionsArgs),
    /// Print the man page, or write one for each command
    #[command(after_help = examples::MAN)]
    Man(ManArgs),
}

const PICTURE: &str = "What is rendered";
const RESULTS: &str = "Results";
const COURSE: &str = "Limits, and going on";

/// A run file and what overrides it.
#[derive(Debug, Args)]
pub(crate) struct JobArgs {
    /// Run file (RON), or a scene: scene.ron, .glb, .gltf
    pub(crate) config: PathBuf,
    /// Method, with its default settings
    #[arg(long, value_name = "NAME", value_parser = method(), help_heading = PICTURE)]
    pub(crate) method: Option<MethodSpec>,
    /// Picture size in pixels, such as 480x270
    #[arg(long, value_name = "WxH", value_parser = parse_size, help_heading = PICTURE)]
    pub(crate) size: Option<[u32; 2]>,
    /// Samples a pixel
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse_samples, help_heading = PICTURE)]
    pub(crate) spp: Option<u32>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse_seed, help_heading = PICTURE)]
    pub(crate) seed: Option<u64>,
    /// Set any field of the run file to a RON value, such as lights.count=2000; repeatable
    #[arg(long = "set", value_name = "PATH=VALUE", help_heading = PICTURE)]
    pub(crate) overrides: Vec<Override>,
    /// Refuse to begin what would need more memory than this, such as 8GB; what is free when not given
    #[arg(long, value_name = "SIZE", allow_negative_numbers = true, help_heading = COURSE)]
    pub(crate) max_memory: Option<Bytes>,
}

#[derive(Debug, Args)]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    pub(crate) job: JobArgs,
    /// Stop after the pass in which this many seconds of rendering fall, those before --resume included
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = parse_seconds, help_heading = COURSE)]
    pub(crate) max_seconds: Option<f64>,
    /// Threads; all processors when not given
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse_threads, help_heading = COURSE)]
    pub(crate) threads: Option<u16>,
    /// Folder for the results
    #[arg(long, value_name = "DIR", default_value = "out", help_heading = RESULTS)]
    pub(crate) out: PathBuf,
    /// Name of the results; the run file's when not given
    #[arg(long, value_name = "NAME", value_parser = parse_name, help_heading = RESULTS)]
    pub(crate) name: Option<String>,
    /// Render only the I-th of N parts, from 1; `manylight merge` puts them together
    #[arg(long, value_name = "I/N", value_parser = parse_shard, help_heading = COURSE)]
    pub(crate) shard: Option<Shard>,
    /// Go on from NAME.state, which an interrupted or time-limited render left in the folder for results; the
    /// bits are those of a render without interruption. Without such a file, begin from the start
    #[arg(long, help_heading = COURSE)]
    pub(crate) resume: bool,
    /// Say nothing but errors
    #[arg(long, help_heading = RESULTS)]
    pub(crate) quiet: bool,
    /// Picture to measure the error against, after every pass
    #[arg(long, value_name = "R.exr", help_heading = RESULTS)]
    pub(crate) reference: Option<PathBuf>,
    /// Write NAME.denoised.exr and .png as well, by Intel Open Image Denoise: for a program built with `--features
    /// denoise`, where that library is
    #[arg(long, conflicts_with = "shard", help_heading = RESULTS)]
    pub(crate) denoise: bool,
    /// Show the picture in the tev viewer that listens there, after every pass
    #[arg(long, value_name = "HOST:PORT", help_heading = RESULTS)]
    pub(crate) tev: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    #[command(flatten)]
    pub(crate) job: JobArgs,
    /// Port of this machine that the page is at; 0 for any that is free
    #[arg(long, value_name = "N", default_value_t = 8420)]
    pub(crate) port: u16,
    /// Threads; all processors when not given
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse_threads)]
    pub(crate) threads: Option<u16>,
    /// Picture to measure the error against, from the scene's own camera
    #[arg(long, value_name = "R.exr")]
    pub(crate) reference: Option<PathBuf>,
    /// Say nothing but where the page is, and errors
    #[arg(long)]
    pub(crate) quiet: bool,
}

#[derive(Debug, Args)]
pub(crate) struct CheckArgs {
    #[command(flatten)]
    pub(crate) job: JobArgs,
}

#[derive(Debug, Args)]
pub(crate) struct ExperimentArgs {
    /// Experiment (RON)
    pub(crate) config: PathBuf,
    /// Folder for the results, and where an ended run goes on; out/NAME when not given
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Small pictures, few lights, one seed: shows in minutes that it works
    #[arg(long)]
    pub(crate) quick: bool,
    /// Fail cells that would need more memory than this, such as 8GB; what is free when not given
    #[arg(long, value_name = "SIZE", allow_negative_numbers = true)]
    pub(crate) max_memory: Option<Bytes>,
    /// Threads of each render; all processors when not given
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse_threads)]
    pub(crate) threads: Option<u16>,
    /// Say nothing but results and errors
    #[arg(long)]
    pub(crate) quiet: bool,
}

#[derive(Debug, Args)]
pub(crate) struct CompareArgs {
    /// Picture
    pub(crate) image: PathBuf,
    /// What it should be
    pub(crate) reference: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    /// Exit with 1 when relmse is above this
    #[arg(long, value_name = "X", allow_negative_numbers = true, value_parser = parse_limit)]
    pub(crate) max_relmse: Option<f64>,
}

#[derive(Debug, Args)]
pub(crate) struct MergeArgs {
    /// Shards, as `manylight render --shard` wrote them
    #[arg(required = true)]
    pub(crate) shards: Vec<PathBuf>,
    /// Where the whole picture goes; a PNG is written beside it
    #[arg(long, value_name = "OUT.exr")]
    pub(crate) out: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct SceneArgs {
    /// Name of the scene
    #[arg(required_unless_present = "list", value_parser = PossibleValuesParser::new(procedural::NAMES))]
    pub(crate) name: Option<String>,
    /// Folder to write it to
    #[arg(long, value_name = "DIR", required_unless_present = "list")]
    pub(crate) out: Option<PathBuf>,
    /// List the built-in scenes
    #[arg(long)]
    pub(crate) list: bool,
}

#[derive(Debug, Args)]
pub(crate) struct ConfigArgs {
    /// Which kind of file
    pub(crate) kind: FileKind,
}

/// A kind of RON file.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum FileKind {
    /// How a scene is rendered: `manylight render`
    Run,
    /// Geometry, camera and lights: `scene.ron`
    Scene,
    /// A matrix of renders: `manylight experiment`
    Experiment,
}

#[derive(Debug, Args)]
pub(crate) struct CompletionsArgs {
    /// Whose script
    pub(crate) shell: Shell,
}

#[derive(Debug, Args)]
pub(crate) struct ManArgs {
    /// Folder for manylight.1, manylight-render.1 and so on
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

/// The method of a name, with a suggestion where there is none.
fn method() -> impl TypedValueParser<Value = MethodSpec> {
    PossibleValuesParser::new(help::methods()).map(|name| {
        let named = MethodSpec::all().into_iter().find(|m| m.name() == name);
        // The only other name is `best`.
        named.unwrap_or_default()
    })
}

/// `480x270`.
fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let (w, h) = text
        .split_once(['x', 'X'])
        .ok_or_else(|| format!("found {text}; expected WIDTHxHEIGHT, such as 480x270"))?;
    let extent = |what: &str, text| match whole(text, Extent::RANGE) {
        Ok(extent) => Ok(extent),
        Err(message) => Err(format!("{what}: {message}")),
    };
    Ok([extent("width", w)?, extent("height", h)?])
}

fn parse_samples(text: &str) -> Result<u32, String> {
    whole(text, Samples::RANGE)
}

fn parse_seed(text: &str) -> Result<u64, String> {
    whole(text, 0..=u64::MAX)
}

fn parse_threads(text: &str) -> Result<u16, String> {
    // More threads than any machine has only cost memory, and the system may not give them.
    whole(text, 1..=4096)
}

/// A whole number in a range.
fn whole<T>(text: &str, range: RangeInclusive<T>) -> Result<T, String>
where
    T: FromStr + PartialOrd + Display,
{
    match text.parse::<T>() {
        Ok(number) if range.contains(&number) => Ok(number),
        _ => Err(format!(
            "found {text}; expected a whole number, {}..={}",
            range.start(),
            range.end()
        )),
    }
}

/// A file name without folders.
fn parse_name(text: &str) -> Result<String, String> {
    let plain = !matches!(text, "" | "." | "..") && !text.contains(['/', '\\', '\0']);
    // The file system allows 255 bytes, endings among them.
    match plain && text.len() <= 240 {
        true => Ok(text.to_owned()),
        false => Err(format!(
            "found {text:?}; expected a file name of 1 to 240 bytes without folders (see --out)"
        )),
    }
}

/// Finite and not negative.
fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(t) if t.is_finite() && t >= 0.0 => Ok(t),
        _ => Err(format!(
            "found {text}; expected a number of seconds, 0 or more"
        )),
    }
}

/// A number that a figure can be above: not NaN, not negative.
fn parse_limit(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x >= 0.0 => Ok(x),
        _ => Err(format!("found {text}; expected a number, 0 or more")),
    }
}

/// `2/3`: the second of three.
pub(crate) fn parse_shard(text: &str) -> Result<Shard, String> {
    let parts = text
        .split_once('/')
        .and_then(|(i, n)| Some((i.parse::<u32>().ok()?, n.parse::<u32>().ok()?)));
    match parts {
        Some((i, n)) if (1..=n).contains(&i) => Ok(Shard {
            index: i - 1,
            count: n,
        }),
        _ => Err(format!(
            "found {text}; expected I/N with 1 <= I <= N, such as 2/3"
        )),
    }
}
