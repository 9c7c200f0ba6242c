//! Randomness for rendering: reproducible streams, warps from the unit square, discrete choice.
//!
//! Every random decision draws from a [`Rng`] that is a pure function of (seed, index, sample, purpose),
//! so that a picture is the same for any number of threads and any order of work.
//!
//! ```
//! use manylight_sampling::{Discrete, Purpose, Rng, cosine_hemisphere};
//!
//! // Sample 3 of pixel 17 under seed 1, for the choice of lights: the same numbers wherever it is made.
//! let mut rng = Rng::new(1, 17, 3, Purpose::Lights);
//! let powers = Discrete::new([1.0, 0.0, 3.0]).expect("not all are zero");
//! let drawn = powers.sample(rng.f64());
//! assert!(drawn != 1 && powers.pmf(2) == 0.75);
//!
//! // A direction about +z, with its density in sr⁻¹.
//! let (direction, pdf) = cosine_hemisphere([rng.f32(), rng.f32()]);
//! assert!((pdf - direction.z / std::f32::consts::PI).abs() < 1e-6);
//! ```

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
pub use rng::{Numbers, Purpose, Rng};
pub use sequence::Sequence;
pub use warp::{
    Frame, cone_direction, cosine_hemisphere, turn, uniform_cone, uniform_disc, uniform_sphere,
    uniform_triangle,
};
