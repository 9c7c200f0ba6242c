//! The record of one cell of an experiment's matrix.

use film::{Bias, Interval, Metrics};
use serde::{Deserialize, Serialize};

/// What tells a cell from the others of its experiment: labels, as tables and plots show them.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Coordinates {
    /// Name of the scene.
    pub scene: String,
    /// Name of the light set.
    pub lights: String,
    /// Name of the method.
    pub method: String,
    /// Builder of the light tree; empty where the method has none.
    pub tree: String,
    /// What ended the render, such as `16 spp` or `10 s`.
    pub budget: String,
    /// Seed of eye paths and light choices.
    pub seed: u64,
    /// Frame of an animation, from 0; 0 for a still.
    pub frame: u32,
}

/// One cell: what it was, and how it came out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Which cell.
    #[serde(flatten)]
    pub coordinates: Coordinates,
    /// The method with all its settings.
    pub settings: String,
    /// How it came out.
    pub outcome: Outcome,
}

/// How a cell came out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// It was rendered and measured.
    Done(Box<Figures>),
    /// It was not, for this reason.
    Failed(String),
}

impl Cell {
    /// The figures, if there are any.
    pub fn figures(&self) -> Option<&Figures> {
        match &self.outcome {
            Outcome::Done(figures) => Some(figures),
            Outcome::Failed(_) => None,
        }
    }
}

/// What one render cost and how far off it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Hash of all that decides the render, in hexadecimal: the name of its files.
    pub key: String,
    /// Name of the reference's files.
    pub reference: String,
    /// Whether the method claims that its expected value is the exact answer.
    pub unbiased: bool,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples a pixel.
    pub spp: u32,
    /// Lights in use.
    pub light_count: usize,
    /// Triangles of the scene.
    pub triangles: usize,
    /// Wall-clock seconds.
    pub seconds: Seconds,
    /// Processor seconds of the render, all threads; `None` where the system does not say.
    pub cpu_seconds: Option<f64>,
    /// Where the render's thread time went.
    pub phases: Phases,
    /// Rays from the camera, and along eye paths.
    pub camera_rays: u64,
    /// Shadow rays.
    pub shadow_rays: u64,
    /// Lights evaluated.
    pub light_samples: u64,
    /// Samples refused because a number in them was not finite.
    pub nonfinite: u64,
    /// Most bytes that the process has had resident up to then; `None` where the system does not say.
    pub peak_rss_bytes: Option<u64>,
    /// Error figures of the final picture.
    pub error: Error,
    /// Error after passes, in order of samples; not all of them, each at least a quarter further on.
    pub passes: Vec<Pass>,
}

/// Wall-clock seconds by what was done.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Seconds {
    /// Reading the scene; shared by all cells of the scene.
    pub load: f64,
    /// Building its ray hierarchy; shared as well.
    pub bvh: f64,
    /// Tracing virtual lights; shared by all cells of the light set.
    pub lights: f64,
    /// Building the light tree, 0 for methods without; shared by all cells of light set and builder.
    pub tree: f64,
    /// The passes.
    pub render: f64,
}

/// Thread seconds by phase of the render, summed over threads; cut, select and evaluate are sampled.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Phases {
    /// Eye paths.
    pub eye: f64,
    /// Choosing clusters.
    pub cut: f64,
    /// Choosing lights in clusters.
    pub select: f64,
    /// Evaluating lights.
    pub evaluate: f64,
    /// Tracing shadow rays.
    pub shadow: f64,
}

impl Phases {
    /// Names and values, in the order of a render.
    pub fn parts(&self) -> [(&'static str, f64); 5] {
        [
            ("eye paths", self.eye),
            ("cut", self.cut),
            ("selection", self.select),
            ("evaluation", self.evaluate),
            ("shadow rays", self.shadow),
        ]
    }
}

/// Error figures; `None` where a figure is infinite or is not known.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Error {
    /// [`Metrics::mse`].
    pub mse: Option<f64>,
    /// [`Metrics::rmse`].
    pub rmse: Option<f64>,
    /// [`Metrics::relmse`].
    pub relmse: Option<f64>,
    /// [`Metrics::mape`].
    pub mape: Option<f64>,
    /// Mean HDR-FLIP.
    pub hdr_flip: Option<f64>,
    /// Mean LDR-FLIP of the tone-mapped pictures, exposed as the reference asks for.
    pub flip: Option<f64>,
    /// [`Metrics::mean_ratio`].
    pub mean_ratio: Option<f64>,
    /// [`Bias::mean`] and half its 95 % confidence interval.
    pub bias: Option<f64>,
    /// Half the width of `bias`'s interval.
    pub bias_95: Option<f64>,
    /// [`Bias::local`] and half its 95 % confidence interval.
    pub local_bias: Option<f64>,
    /// Half the width of `local_bias`'s interval.
    pub local_bias_95: Option<f64>,
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

impl Error {
    /// The figures of a picture: `metrics` with HDR-FLIP, mean LDR-FLIP, and bias where one could be estimated.
    pub fn new(metrics: &Metrics, flip: f64, bias: Option<Bias>) -> Self {
        let estimate = |pick: fn(&Bias) -> Interval| bias.as_ref().map(pick);
        let (mean, local) = (estimate(|b| b.mean), estimate(|b| b.local));
        Self {
            mse: finite(metrics.mse),
            rmse: finite(metrics.rmse),
            relmse: finite(metrics.relmse),
            mape: finite(metrics.mape),
            hdr_flip: metrics.flip.and_then(finite),
            flip: finite(flip),
            mean_ratio: finite(metrics.mean_ratio),
            bias: mean.and_then(|b| finite(b.estimate)),
            bias_95: mean.and_then(|b| finite(b.half_width)),
            local_bias: local.and_then(|b| finite(b.estimate)),
            local_bias_95: local.and_then(|b| finite(b.half_width)),
        }
    }
}

/// Cost and error after a pass.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pass {
    /// Samples a pixel so far.
    pub spp: u32,
    /// Wall-clock seconds of rendering so far.
    pub seconds: f64,
    /// Processor seconds so far; `None` where the system does not say.
    pub cpu_seconds: Option<f64>,
    /// Shadow rays so far.
    pub shadow_rays: u64,
    /// `None` where infinite.
    pub relmse: Option<f64>,
    /// `None` where infinite.
    pub mse: Option<f64>,
}

impl Pass {
    /// Whether a pass of `spp` samples is far enough beyond this one to be recorded as well.
    pub fn is_passed_by(&self, spp: u32) -> bool {
        u64::from(spp) * 4 >= u64::from(self.spp) * 5
    }
}
