//! `NAME.json` and the attributes of `NAME.exr`.

use std::collections::BTreeMap;
use std::path::Path;

use film::{CameraMatrices, Metadata, Metrics};
use gather::{BOUNCES, Integrator, Plan, Render};
use light_tree::LightKind;
use scene::{Camera, Scene};
use serde::{Deserialize, Deserializer, Serialize};

use crate::error::CliError;
use crate::fingerprint::fingerprint;
use crate::job::Job;
use crate::machine::peak_resident;
use crate::prepared::Prepared;

/// Seconds outside the passes.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct SetUpSeconds {
    pub(crate) load: f64,
    pub(crate) bvh: f64,
    pub(crate) lights: f64,
    pub(crate) tree: f64,
    pub(crate) write: f64,
}

/// Error against the reference after one pass.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct PassError {
    pub(crate) spp: u32,
    pub(crate) seconds: f64,
    #[serde(deserialize_with = "number_or_nan")]
    pub(crate) relmse: f64,
    #[serde(deserialize_with = "number_or_nan")]
    pub(crate) mse: f64,
}

/// JSON has no NaN: it becomes null.
fn number_or_nan<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::NAN))
}

/// What the command measured beside the render itself.
pub(crate) struct Measured {
    pub(crate) seconds: SetUpSeconds,
    pub(crate) passes: Vec<PassError>,
    pub(crate) final_error: Option<Metrics>,
}

#[derive(Serialize)]
struct Report<'a> {
    version: &'static str,
    commit: &'static str,
    scene: String,
    width: u32,
    height: u32,
    spp: u32,
    seed: u64,
    threads: usize,
    method: &'static str,
    method_settings: String,
    seconds: BTreeMap<&'static str, f64>,
    /// Thread seconds by phase of the render; cut, select and evaluate are sampled.
    thread_seconds: BTreeMap<&'static str, f64>,
    rays: BTreeMap<&'static str, u64>,
    light_samples: u64,
    dead_samples: u64,
    shading_points: u64,
    nonfinite: u64,
    peak_rss_bytes: Option<u64>,
    bytes: BTreeMap<&'static str, usize>,
    lights: BTreeMap<&'static str, usize>,
    virtual_lights: Option<VirtualLights>,
    tree: Option<Tree>,
    triangles: usize,
    dropped: BTreeMap<&'static str, usize>,
    remarks: &'a [String],
    needs: Vec<&'static str>,
    skipped: Vec<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error<'a>>,
}

#[derive(Serialize)]
struct VirtualLights {
    paths: u64,
    /// The median.
    radius: f32,
    greatest_radius: f32,
    source_flux: [f64; 3],
    virtual_flux: [f64; 3],
}

#[derive(Serialize)]
struct Tree {
    nodes: usize,
    depth: u32,
}

#[derive(Serialize)]
struct Error<'a> {
    #[serde(flatten)]
    figures: BTreeMap<&'static str, f64>,
    passes: &'a [PassError],
}

/// Writes the report.
pub(crate) fn write(
    path: &Path,
    job: &Job,
    prepared: &Prepared,
    render: &Render<'_>,
    measured: &Measured,
) -> Result<(), CliError> {
    let counters = render.counters();
    let phases = counters.seconds();
    let scene = &prepared.loaded.scene;
    let notes = &scene.notes;
    let inputs = &prepared.lights.inputs;
    let lights = &inputs.lights;
    let tree = inputs.built_tree();
    let wide_tree = inputs.built_wide_tree();
    let tree_size = inputs.tree_size();
    let virtual_lights = &prepared.lights.virtual_lights;
    let mut plan = Plan::of(scene, lights, tree_size.is_some());
    if job.integrator != Integrator::Direct {
        plan.need(BOUNCES);
    }
    let seconds = measured.seconds;
    let report = Report {
        version: env!("CARGO_PKG_VERSION"),
        commit: env!("MANYLIGHT_COMMIT"),
        scene: job.scene.display().to_string(),
        width: job.width,
        height: job.height,
        spp: render.spp(),
        seed: job.seed,
        threads: rayon::current_num_threads(),
        method: job.method.name(),
        method_settings: format!("{:?}", job.method),
        seconds: BTreeMap::from([
            ("load", seconds.load),
            ("bvh", seconds.bvh),
            ("lights", seconds.lights),
            ("tree", seconds.tree),
            ("render", render.seconds()),
            ("write", seconds.write),
        ]),
        thread_seconds: BTreeMap::from([
            ("eye", phases.eye),
            ("cut", phases.cut),
            ("select", phases.select),
            ("evaluate", phases.evaluate),
            ("shadow", phases.shadow),
        ]),
        rays: BTreeMap::from([
            ("camera", counters.camera_rays),
            ("bounce", virtual_lights.rays + counters.bounce_rays),
            ("shadow", counters.shadow_rays),
        ]),
        light_samples: counters.light_samples,
        dead_samples: counters.dead_samples,
        shading_points: counters.shading_points,
        nonfinite: counters.nonfinite,
        peak_rss_bytes: peak_resident(),
        bytes: BTreeMap::from([
            ("mesh", scene.mesh.bytes()),
            (
                "textures",
                scene.textures.iter().map(scene::Texture::bytes).sum(),
            ),
            ("bvh", prepared.loaded.tracer.bytes()),
            ("lights", lights.bytes()),
            ("tree", tree.map_or(0, light_tree::LightTree::bytes)),
            (
                "wide_tree",
                wide_tree.map_or(0, light_tree::WideTree::bytes),
            ),
            ("learned", render.learned_bytes()),
        ]),
        lights: BTreeMap::from([
            ("point", lights.count(LightKind::Omni)),
            ("spot", lights.count(LightKind::Spot)),
            ("triangle", lights.count(LightKind::Triangle)),
            ("directional", lights.count(LightKind::Directional)),
            ("environment", lights.count(LightKind::Environment)),
            ("virtual", lights.virtual_count()),
        ]),
        virtual_lights: (lights.virtual_count() > 0).then(|| VirtualLights {
            paths: virtual_lights.paths,
            radius: lights.median_radius(),
            greatest_radius: lights.greatest_radius(),
            source_flux: virtual_lights.source_flux,
            virtual_flux: virtual_lights.virtual_flux,
        }),
        tree: tree_size.map(|(nodes, depth)| Tree { nodes, depth }),
        triangles: scene.mesh.len(),
        dropped: BTreeMap::from([
            ("degenerate_triangles", notes.degenerate_triangles),
            ("duplicate_triangles", notes.duplicate_triangles),
            ("zero_normals", notes.zero_normals),
            ("zero_power_lights", notes.zero_power_lights),
            ("black_environments", notes.black_environments),
            ("dark_emissive_triangles", notes.dark_emissive_triangles),
        ]),
        remarks: &notes.remarks,
        needs: plan.needs(),
        skipped: plan.skipped(),
        error: measured.final_error.as_ref().map(|metrics| Error {
            figures: metrics.fields().into_iter().collect(),
            passes: &measured.passes,
        }),
    };
    let mut text = serde_json::to_string_pretty(&report).map_err(|e| {
        CliError::Input(format!("{}: cannot write the report: {e}", path.display()))
    })?;
    text.push('\n');
    film::write_atomically(path, |file| file.write_all(text.as_bytes()))?;
    Ok(())
}

/// What the EXR of `spp` samples a pixel says about itself: enough to make it again.
pub(crate) fn metadata(job: &Job, scene: &Scene, spp: u32) -> Metadata {
    let mut texts = attributes(job, scene, spp);
    if !job.config.is_empty() {
        texts.push(("config".to_owned(), job.config.clone()));
    }
    // In the coordinates of the scene's files.
    let spec = scene.camera.moved_by(scene.origin);
    let camera = Camera::new(&spec, job.width, job.height);
    Metadata {
        texts,
        // Its points are rows where ours are columns, and it stores rows where ours stores columns.
        camera: Some(CameraMatrices {
            world_to_camera: camera.world_to_camera().to_cols_array(),
            world_to_ndc: camera.world_to_ndc().to_cols_array(),
        }),
    }
}

/// What decides a picture of `spp` samples a pixel, by name and value, and where its scene was.
pub(crate) fn attributes(job: &Job, scene: &Scene, spp: u32) -> Vec<(String, String)> {
    // Without `..`, so that whoever adds a field decides whether it decides the picture.
    let Job {
        file: _,
        scene: path,
        width: _,
        height: _,
        spp: _,
        lights,
        integrator,
        tree,
        method,
        seed,
        config: _,
        name: _,
        limit: _,
    } = job;
    [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("commit", env!("MANYLIGHT_COMMIT").to_owned()),
        ("scene", path.display().to_string()),
        ("scene_content", format!("{:016x}", fingerprint(scene))),
        (
            "camera",
            format!("{:?}", scene.camera.moved_by(scene.origin)),
        ),
        ("lights", format!("{:?}", lights)),
        ("integrator", format!("{:?}", integrator)),
        ("tree", format!("{:?}", tree)),
        ("method", format!("{:?}", method)),
        ("spp", spp.to_string()),
        ("seed", seed.to_string()),
    ]
    .into_iter()
    .map(|(name, value)| (name.to_owned(), value))
    .collect()
}
