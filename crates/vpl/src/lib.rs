//! Virtual lights: what indirect light becomes when it is traced from the lights first.
//!
//! Particles leave the scene's lights and bounce; wherever one is reflected it leaves a virtual light that
//! sends on what arrived. The sum over all virtual lights is the indirect light, up to the chosen number
//! of bounces; light straight from the sources is not in it.
//!
//! Source: Keller, "Instant Radiosity", 1997; Hašan et al., "Virtual Spherical Lights", 2009.

mod emit;
mod radius;
mod walk;

pub use emit::source_lights;
pub use radius::set_local_radii;
pub use walk::{VirtualLightSpec, VirtualLightStats, gloss, trace};
