//! Randomness for rendering: reproducible streams, warps from the unit square, discrete choice.
//!
//! Every random decision draws from a [`Rng`] that is a pure function of (seed, index, sample, purpose),
//! so that a picture is the same for any number of threads and any order of work.

mod alias;
mod discrete;
mod ggx;
mod rng;
mod sequence;
mod warp;

pub use alias::AliasTable;
pub use discrete::Discrete;
pub use ggx::{ggx_density, ggx_reflected, ggx_visibility, ggx_visible_normal};
#[cfg(feature = "extreme")]
pub use rng::Extreme;
pub use rng::{Purpose, Rng};
pub use sequence::Sequence;
pub use warp::{
    Frame, cosine_hemisphere, uniform_cone, uniform_disc, uniform_sphere, uniform_triangle,
};
