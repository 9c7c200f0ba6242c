//! `manylight check`.

use gather::{BOUNCES, Integrator, Plan};
use light_tree::{LightKind, LightSet};
use scene::trace::Tracer;

use crate::answer::Answer;
use crate::args::CheckArgs;
use crate::error::CliError;
use crate::job::{Job, LightsSpec};
use crate::machine::{available_memory, human};

pub(crate) fn run(arguments: &CheckArgs) -> Result<(), CliError> {
    let job = Job::read(&arguments.job)?;
    let scene = scene::load::load_within(&job.scene, &|bytes| job.limit.refuse(bytes))?;
    job.limit
        .refuse_triangles(scene.mesh.len())
        .map_err(|message| CliError::Input(format!("{}: {message}", job.scene.display())))?;
    let tracer = Tracer::build(&scene);
    let lights = vpl::source_lights(&scene);
    let notes = &scene.notes;
    let mut answer = Answer::default();

    answer.line(format_args!("scene      {}", job.scene.display()));
    answer.line(format_args!(
        "triangles  {} ({} can be hit)",
        scene.mesh.len(),
        tracer.triangle_count()
    ));
    answer.line(format_args!(
        "materials  {}, textures {}",
        scene.materials.len(),
        scene.textures.len()
    ));
    answer.line(format_args!("lights     {}", described(&lights)));
    if let LightsSpec::Virtual(v) = job.lights {
        answer.line(format_args!(
            "           and about {} virtual ones, up to {} bounces",
            v.count.0, v.max_bounces.0
        ));
    }
    answer.line(format_args!(
        "camera     {:?}",
        scene.camera.moved_by(scene.origin)
    ));
    answer.line(format_args!(
        "picture    {}x{}, {} samples a pixel",
        job.width, job.height, job.spp
    ));
    answer.line(format_args!("paths      {:?}", job.integrator));
    answer.line(format_args!("method     {:?}", job.method));
    for (count, what) in [
        (notes.degenerate_triangles, "triangles without area dropped"),
        (
            notes.duplicate_triangles,
            "triangles that repeat another dropped",
        ),
        (notes.zero_normals, "normals of length zero replaced"),
        (notes.zero_power_lights, "lights without power dropped"),
        (notes.black_environments, "black environments dropped"),
        (
            notes.dark_emissive_triangles,
            "emissive triangles that are black all over, or too large, dropped from the lights",
        ),
        (
            notes.ignored_emissive_materials,
            "emissive materials not among the scene's lights",
        ),
    ] {
        if count > 0 {
            answer.line(format_args!("note       {count} {what}"));
        }
    }
    for remark in &notes.remarks {
        answer.line(format_args!("note       {remark}"));
    }
    if lights.is_empty() {
        answer.line(format_args!(
            "note       no lights: the picture will be black"
        ));
    }
    let uses_tree = job.method.uses_tree() && !lights.is_empty();
    let mut plan = Plan::of(&scene, &lights, uses_tree);
    if matches!(job.lights, LightsSpec::Virtual(_)) && !lights.is_empty() {
        plan.need("virtual lights");
    }
    if job.integrator != Integrator::Direct {
        plan.need(BOUNCES);
    }
    answer.line(format_args!("needs      {}", plan.needs().join(", ")));
    answer.line(format_args!("skips      {}", plan.skipped().join(", ")));
    let free = available_memory().map_or(String::new(), |m| format!(" of {} free", human(m)));
    answer.line(format_args!(
        "memory     about {}{free}",
        human(job.memory() + tracer.bytes() as u64)
    ));
    answer.print()?;
    job.refuse_too_large()
}

/// The number of lights of each kind that is there.
fn described(lights: &LightSet) -> String {
    let kinds = [
        (LightKind::Omni, "point"),
        (LightKind::Spot, "spot"),
        (LightKind::Triangle, "triangle"),
        (LightKind::Directional, "directional"),
        (LightKind::Environment, "of the environment"),
    ];
    let counts = kinds.map(|(kind, name)| (lights.count(kind), name));
    let there = counts.iter().filter(|(count, _)| *count > 0);
    let parts: Vec<_> = there
        .map(|(count, name)| format!("{count} {name}"))
        .collect();
    match parts.is_empty() {
        true => "0".to_owned(),
        false => parts.join(", "),
    }
}
