//! The methods, one a file, and the list of them.

mod adaptive_splitting;
mod ahead;
mod all_lights;
mod count;
mod fraction;
mod importance;
mod lightcuts;
mod multidimensional;
mod patches;
mod power;
mod probes;
mod refinement;
mod running_total;
mod shared_cuts;
mod stochastic_lightcuts;
mod stratified_lightcuts;
mod uniform;

use sampling::Rng;
use serde::de::DeserializeOwned;

use crate::Inputs;
use crate::learned::Learned;
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;
use crate::tile_points::{TILE, TilePoints};

pub use adaptive_splitting::{AdaptiveSplitting, AdaptiveSplittingSpec};
pub use all_lights::AllLights;
pub use count::Count;
pub use fraction::Fraction;
pub use importance::{Importance, ImportanceSpec, LightWeights};
pub use lightcuts::{Lightcuts, LightcutsSpec};
pub use multidimensional::{Multidimensional, MultidimensionalSpec};
pub use power::{Power, PowerSpec};
pub use shared_cuts::BlockEdge;
pub use stochastic_lightcuts::{
    DeadBranches, RunningTotalSpec, StochasticLightcuts, StochasticLightcutsSpec, Stopping, Weights,
};
pub use stratified_lightcuts::{StratifiedLightcuts, StratifiedLightcutsSpec};
pub use uniform::{Uniform, UniformSpec};

/// A way to estimate the light of many lights at a point with few evaluations.
pub trait Method<'a>: Sized + Sync {
    /// Its fields in a run file; all have defaults.
    type Spec: DeserializeOwned + Default + Clone;
    /// Memory kept from point to point.
    type Scratch: Default + Send;
    /// Whether the gather points of all of a pixel's samples are handed to [`pixel`](Self::pixel) together.
    /// Otherwise they go to [`point`](Self::point) one by one.
    const WHOLE_PIXEL: bool = false;
    /// Whether it wants [`TilePoints::centres`].
    const CENTRES: bool = false;
    /// Whether the samples of a pixel are stratified jointly, places in the pixel included, rather than independent.
    const STRATIFIED: bool = false;

    /// Builds what the method needs for a render: no tree is built unless a method asks for it.
    fn prepare(spec: &Self::Spec, inputs: &'a Inputs) -> Self;

    /// Whether the expected value is that of [`AllLights`].
    fn is_unbiased(&self) -> bool;

    /// Most bytes that it keeps of a tile from pass to pass, in `Learned`.
    fn most_learned_bytes(_spec: &Self::Spec) -> u64 {
        0
    }

    /// Begins one pass over a tile, with all gather points that will be handed over: for methods that do something for
    /// many of them at once. A method must do without it where it is not called.
    ///
    /// `learned` is empty at first, and what the method leaves in it is there again in the next pass over the tile, with
    /// what came of the trials since. It may take those in only where [`TilePoints::is_milestone`] says so: samples must
    /// not depend on how they are split into passes.
    fn begin_tile<E: LightEval>(
        &self,
        _tile: &TilePoints<'_>,
        _eval: &mut E,
        _learned: &mut Learned,
        _scratch: &mut Self::Scratch,
    ) {
    }

    /// Adds the light of all lights at `x`, or an estimate of it.
    fn point<E: LightEval>(
        &self,
        x: &GatherPoint,
        eval: &mut E,
        rng: &mut Rng,
        scratch: &mut Self::Scratch,
    );

    /// Adds the light of all lights at each of the gather points `xs` of one pixel, or an estimate of it.
    fn pixel<E: LightEval>(
        &self,
        xs: &[GatherPoint],
        eval: &mut E,
        rng: &mut Rng,
        scratch: &mut Self::Scratch,
    ) {
        for x in xs {
            self.point(x, eval, rng, scratch);
        }
    }
}

/// Calls a closure-like block with the method that a spec names: the choice is made once a render.
pub(crate) trait Visitor {
    /// What the visit gives.
    type Output;
    /// Visits the chosen method.
    fn visit<'a, M: Method<'a>>(self, method: M) -> Self::Output;
}

/// The list: a file with a [`Method`] and a line here is all that a new method needs.
macro_rules! methods {
    ($($variant:ident($type:ident, $spec:ty, $name:literal, $about:literal)),+ $(,)?) => {
        /// A method and its settings, as a run file gives them.
        #[derive(Debug, Clone, PartialEq, serde::Deserialize)]
        pub enum MethodSpec {
            $(
                #[doc = concat!("`--method ", $name, "`; see [`", stringify!($type), "`].")]
                $variant($spec),
            )+
        }

        impl MethodSpec {
            /// Every method with its default settings.
            pub fn all() -> Vec<Self> {
                vec![$(Self::$variant(<$spec>::default())),+]
            }

            /// Names of the variants in a run file.
            pub const VARIANTS: &'static [&'static str] = &[$(stringify!($variant)),+];

            /// The name of the variant in a run file.
            pub fn variant(&self) -> &'static str {
                match self { $(Self::$variant(_) => stringify!($variant)),+ }
            }

            /// The name on the command line.
            pub fn name(&self) -> &'static str {
                match self { $(Self::$variant(_) => $name),+ }
            }

            /// What it does, in a few words.
            pub fn about(&self) -> &'static str {
                match self { $(Self::$variant(_) => $about),+ }
            }

            /// [`Method::WHOLE_PIXEL`] of the method.
            pub(crate) fn whole_pixel(&self) -> bool {
                match self { $(Self::$variant(_) => <$type as Method<'_>>::WHOLE_PIXEL),+ }
            }

            /// Most bytes that it keeps of a picture of this size from pass to pass.
            pub fn most_learned_bytes(&self, width: u32, height: u32) -> u64 {
                let of_tile = match self {
                    $(Self::$variant(spec) => <$type as Method<'_>>::most_learned_bytes(spec)),+
                };
                u64::from(width.div_ceil(TILE)) * u64::from(height.div_ceil(TILE)) * of_tile
            }

            pub(crate) fn visit<V: Visitor>(&self, inputs: &Inputs, visitor: V) -> V::Output {
                match self { $(Self::$variant(spec) => visitor.visit($type::prepare(spec, inputs))),+ }
            }
        }
    };
}

methods! {
    AllLights(AllLights, all_lights::AllLightsSpec, "all-lights",
        "every light at every point: exact, and slowest"),
    Uniform(Uniform, UniformSpec, "uniform",
        "every light alike"),
    Power(Power, PowerSpec, "power",
        "lights in proportion to their power"),
    Importance(Importance, ImportanceSpec, "importance",
        "every light weighed at every point (Shirley, Wang, Zimmerman 1996)"),
    Lightcuts(Lightcuts, LightcutsSpec, "lightcuts",
        "clusters until none can be off by much (Walter et al. 2005); a little biased"),
    Multidimensional(Multidimensional, MultidimensionalSpec, "multidimensional",
        "the same for all of a pixel's samples at once (Walter et al. 2006)"),
    AdaptiveSplitting(AdaptiveSplitting, AdaptiveSplittingSpec, "adaptive-splitting",
        "a descent by importance, split where lights differ (Conty Estevez, Kulla 2018)"),
    StochasticLightcuts(StochasticLightcuts, StochasticLightcutsSpec, "stochastic-lightcuts",
        "one light, drawn by importance, of each cluster of a cut (Yuksel 2019)"),
    StratifiedLightcuts(StratifiedLightcuts, StratifiedLightcutsSpec, "stratified-lightcuts",
        "all of a pixel's lights drawn from a shared cut so that they complement each other"),
}

/// Asks a method whether it is unbiased.
struct Honesty;

impl Visitor for Honesty {
    type Output = bool;

    fn visit<'a, M: Method<'a>>(self, method: M) -> bool {
        method.is_unbiased()
    }
}

impl MethodSpec {
    /// [`Method::is_unbiased`] of the method with these settings.
    pub fn is_unbiased(&self) -> bool {
        // It depends on settings alone, so no light is needed.
        let nothing = Inputs::new(
            light_tree::LightSet::default(),
            light_tree::TreeBuilder::Binned,
        );
        self.visit(&nothing, Honesty)
    }

    /// Whether it asks for a light tree.
    pub fn uses_tree(&self) -> bool {
        use MethodSpec::{AllLights, Importance, Power, Uniform};
        !matches!(self, AllLights(_) | Uniform(_) | Power(_) | Importance(_))
    }
}

impl Default for MethodSpec {
    fn default() -> Self {
        Self::StratifiedLightcuts(StratifiedLightcutsSpec::default())
    }
}

#[cfg(test)]
mod agreement;
#[cfg(test)]
pub(crate) mod conformance;
#[cfg(test)]
mod extremes;
#[cfg(test)]
pub(crate) mod fixtures;
#[cfg(test)]
pub(crate) mod shining_room;
