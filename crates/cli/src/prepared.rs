//! What is made before the first sample, in parts that many renders can share.

use std::path::Path;
use std::time::Instant;

use gather::{Inputs, Render, RenderSpec, Shard};
use light_tree::LightSet;
use scene::Scene;
use scene::trace::Tracer;
use vpl::{VirtualLightSpec, VirtualLightStats};

use crate::error::CliError;
use crate::job::{Job, LightsSpec, VirtualKind, VirtualSpec};
use crate::limits::MemoryLimit;
use crate::progress::Progress;

/// Threads to render with; all processors for `None`.
///
/// # Errors
/// When the system does not give them.
pub(crate) fn threads(count: Option<u16>) -> Result<rayon::ThreadPool, CliError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(count.map_or(0, usize::from))
        .build()
        .map_err(|e| CliError::Input(format!("--threads: cannot start threads: {e}")))
}

/// A scene and its ray hierarchy: the same for all lights, methods and cameras.
pub(crate) struct LoadedScene {
    pub(crate) scene: Scene,
    pub(crate) tracer: Tracer,
    pub(crate) load_seconds: f64,
    pub(crate) bvh_seconds: f64,
}

impl LoadedScene {
    /// Reads `scene.ron` at `path` and builds the ray hierarchy.
    ///
    /// # Errors
    /// When the scene cannot be used, or its pictures or the hierarchy would need more memory than the limit.
    pub(crate) fn load(
        path: &Path,
        limit: MemoryLimit,
        progress: &Progress,
    ) -> Result<Self, CliError> {
        let started = Instant::now();
        let scene = scene::load::load_within(path, &|bytes| limit.refuse(bytes))?;
        let load_seconds = started.elapsed().as_secs_f64();
        progress.line(&format!(
            "{}: {} triangles, {} lights, {load_seconds:.2} s",
            path.display(),
            scene.mesh.len(),
            scene.emitters.len(),
        ));
        limit
            .refuse_triangles(scene.mesh.len())
            .map_err(|message| CliError::Input(format!("{}: {message}", path.display())))?;
        let started = Instant::now();
        let tracer = Tracer::build(&scene);
        Ok(Self {
            scene,
            tracer,
            load_seconds,
            bvh_seconds: started.elapsed().as_secs_f64(),
        })
    }
}

/// The lights in use and what methods build over them: the same for all methods and cameras.
pub(crate) struct PreparedLights {
    pub(crate) inputs: Inputs,
    pub(crate) virtual_lights: VirtualLightStats,
    pub(crate) seconds: f64,
}

impl PreparedLights {
    /// The scene's own lights, and virtual ones where the job wants them.
    pub(crate) fn trace(job: &Job, loaded: &LoadedScene, progress: &Progress) -> Self {
        let started = Instant::now();
        let mut lights = vpl::source_lights(&loaded.scene);
        let mut virtual_lights = VirtualLightStats::default();
        if let LightsSpec::Virtual(spec) = job.lights {
            virtual_lights = add_virtual_lights(job, &spec, loaded, &mut lights);
        }
        let seconds = started.elapsed().as_secs_f64();
        if lights.virtual_count() > 0 {
            progress.line(&format!(
                "{} virtual lights from {} paths, median radius {:.3}, {seconds:.2} s",
                lights.virtual_count(),
                virtual_lights.paths,
                lights.median_radius(),
            ));
        }
        Self {
            inputs: Inputs::new(lights, job.tree.builder.into()),
            virtual_lights,
            seconds,
        }
    }
}

fn add_virtual_lights(
    job: &Job,
    spec: &VirtualSpec,
    loaded: &LoadedScene,
    lights: &mut LightSet,
) -> VirtualLightStats {
    let trace = VirtualLightSpec {
        count: spec.count.0,
        max_bounces: spec.max_bounces.0,
        keep_bounces: job.lights.compensates(),
        seed: spec.seed.unwrap_or(job.seed),
    };
    let stats = vpl::trace(&loaded.scene, &loaded.tracer, &trace, lights);
    if let VirtualKind::Vsl(vsl) = spec.kind {
        match vsl.radius {
            Some(radius) => lights.set_radius(radius.0),
            None => vpl::set_local_radii(lights),
        }
    }
    stats
}

/// Everything that one render needs.
pub(crate) struct Prepared {
    pub(crate) loaded: LoadedScene,
    pub(crate) lights: PreparedLights,
}

impl Prepared {
    /// A render of `job`, which is of this scene and these lights; nothing of it is done yet.
    pub(crate) fn render<'a>(&'a self, job: &'a Job, shard: Shard) -> Render<'a> {
        render(&self.loaded, &self.lights.inputs, job, shard)
    }
}

/// A render of `job` with `loaded`'s camera; nothing of it is done yet.
pub(crate) fn render<'a>(
    loaded: &'a LoadedScene,
    inputs: &'a Inputs,
    job: &'a Job,
    shard: Shard,
) -> Render<'a> {
    Render::new(
        &loaded.scene,
        &loaded.tracer,
        inputs,
        &job.method,
        RenderSpec {
            width: job.width,
            height: job.height,
            spp: job.spp,
            seed: job.seed,
            shape: job.shape(),
            integrator: job.integrator,
            shard,
        },
    )
}
