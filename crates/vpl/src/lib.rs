//! Virtual lights: what indirect light becomes when it is traced from the lights first.
//!
//! Particles leave the scene's lights and bounce; wherever one is reflected it leaves a virtual light that
//! sends on what arrived. The sum over all virtual lights is the indirect light, up to the chosen number
//! of bounces; light straight from the sources is not in it.
//!
//! ```
//! use manylight_vpl::{VirtualLightSpec, set_local_radii, source_lights, trace};
//! use scene::trace::Tracer;
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("scene.ron");
//! # std::fs::write(folder.path().join("floor.obj"), "v -5 0 -5\nv -5 0 5\nv 5 0 5\nv 5 0 -5\nf 1 2 3 4\n")?;
//! # std::fs::write(&path, "(
//! #     geometry: [\"floor.obj\"],
//! #     camera: (origin: (0, 3, 8), target: (0, 0, 0), up: (0, 1, 0), fov_y_deg: 45.0),
//! #     lights: [Point(position: (0, 2, 0), intensity: (4, 4, 4))],
//! # )")?;
//! let scene = scene::load::load(&path)?;
//! let tracer = Tracer::build(&scene);
//! let mut lights = source_lights(&scene);
//! let spec = VirtualLightSpec { count: 1000, max_bounces: 8, keep_bounces: false, seed: 1 };
//! let stats = trace(&scene, &tracer, &spec, &mut lights);
//! set_local_radii(&mut lights);
//! assert!(lights.virtual_count() > 900 && lights.virtual_count() < 1100);
//! assert!(stats.virtual_flux[0] < stats.source_flux[0], "nothing reflects more than it gets");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Source: Keller, "Instant Radiosity", 1997; Hašan et al., "Virtual Spherical Lights", 2009.

mod emit;
mod radius;
mod walk;

pub use emit::source_lights;
pub use radius::set_local_radii;
pub use walk::{VirtualLightSpec, VirtualLightStats, gloss, trace};
