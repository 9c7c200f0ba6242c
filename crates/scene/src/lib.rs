//! Scenes: what is lit, by what, seen from where.
//!
//! [`load`](load::load) turns `scene.ron` and the files it names into a [`Scene`], and checks every
//! number on the way; what holds a `Scene` need not check again.
//!
//! ```
//! use manylight_scene::Camera;
//! use manylight_scene::load::load;
//! use manylight_scene::trace::{Ray, Tracer};
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("scene.ron");
//! # std::fs::write(folder.path().join("floor.obj"), "v -5 0 -5\nv -5 0 5\nv 5 0 5\nv 5 0 -5\nf 1 2 3 4\n")?;
//! # std::fs::write(&path, "(
//! #     geometry: [\"floor.obj\"],
//! #     camera: (origin: (0, 3, 8), target: (0, 0, 0), up: (0, 1, 0), fov_y_deg: 45.0),
//! #     lights: [Point(position: (0, 2, 0), intensity: (4, 4, 4))],
//! # )")?;
//! // A floor of two triangles, and a lamp above it.
//! let scene = load(&path)?;
//! let tracer = Tracer::build(&scene);
//! let camera = Camera::new(&scene.camera, 64, 36);
//! let (origin, direction) = (camera.origin(), camera.direction(32.0, 18.0));
//! let hit = tracer.closest(&Ray { origin, direction, t_max: f32::INFINITY });
//! let surface = scene.surface(&hit.expect("the floor"), direction);
//! assert!(surface.ns.y > 0.99, "it looks up");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod brdf;
mod camera;
mod coat;
mod emitter;
mod environment;
mod error;
pub mod load;
mod material;
mod mesh;
mod prefetch;
mod surface;
mod tagged;
mod texture;
pub mod trace;
mod view;

use glam::Vec3;

pub use brdf::{Brdf, BrdfSample, Fresnel, LobeBound};
pub use camera::CameraSpec;
pub use emitter::{Emitter, EmitterPoint};
pub use environment::{Cell, Environment, EnvironmentSample};
pub use error::SceneError;
pub use material::{Material, MaterialId, alpha_of_exponent};
pub use mesh::{ABSENT, Mesh};
pub use surface::Surface;
pub use texture::{Channel, Texture, TextureId};
pub use view::Camera;

/// Everything a render reads: geometry, materials, lights, camera. World space, scene units, linear RGB.
#[derive(Debug, Default, Clone)]
pub struct Scene {
    /// All geometry files merged.
    pub mesh: Mesh,
    /// Indexed by [`MaterialId`]; index 0 always exists (the default grey for faces without a material).
    pub materials: Vec<Material>,
    /// Indexed by [`TextureId`]; one entry per file, however many materials use it.
    pub textures: Vec<Texture>,
    /// The scene's own lights but for the environment; triangles come last. Empty is legal and renders black.
    pub emitters: Vec<Emitter>,
    /// One a triangle: whether it is among the lights. Empty when none is.
    pub emissive: Vec<bool>,
    /// Light from beyond the scene.
    pub environment: Option<Environment>,
    /// Where the picture is seen from.
    pub camera: CameraSpec,
    /// The point of the files' coordinates that is (0, 0, 0) here: zero, but for scenes that lie far from their origin.
    pub origin: Vec3,
    /// Length of a scene unit in metres; information only, all computation is in scene units.
    pub metres_per_unit: f32,
    /// What loading dropped or noticed.
    pub notes: LoadNotes,
}

/// What loading dropped or noticed; goes into the report, nothing is dropped in silence.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct LoadNotes {
    /// Triangles without area, dropped.
    pub degenerate_triangles: usize,
    /// Triangles that repeat another one exactly (same three positions), dropped.
    pub duplicate_triangles: usize,
    /// Stored normals of length zero, replaced by the face normal.
    pub zero_normals: usize,
    /// Lights of zero power, dropped.
    pub zero_power_lights: usize,
    /// Environments that are black everywhere, dropped.
    pub black_environments: usize,
    /// Triangles of an emissive material that are no lights: black all over by their texture, or so large that their
    /// power is not finite.
    pub dark_emissive_triangles: usize,
    /// Emissive materials (`Ke`) that the scene's `lights` list does not ask for.
    pub ignored_emissive_materials: usize,
    /// Other things worth a line in the report, each a sentence.
    pub remarks: Vec<String>,
}
