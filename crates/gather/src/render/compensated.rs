//! Clamped virtual points with and without compensation, against paths.

use glam::Vec3;
use light_tree::TreeBuilder;
use scene::{Emitter, Material};
use verify::{Running, z_test};

use super::analytic::{PATH, add, all_lights, cube, sphere, stochastic};
use super::tests::spec;
use super::*;

/// Few enough for light that has bounced too often to show.
const BOUNCES: u32 = 2;
/// Far below what walls of the cube see of each other where they meet.
const CLAMP: f32 = 0.3;
/// Sets of virtual lights, each of another seed: what pixels share is no error of the mean over them.
const SETS: u64 = 32;

/// A cube with a ball in it, under a lamp: matte, or with a gloss as strong.
fn room(glossy: bool) -> Scene {
    let mut scene = cube(0.7);
    add(&mut scene, sphere(Vec3::new(0.3, -0.5, -0.2), 0.35, 2));
    if glossy {
        scene.materials[0] = Material {
            diffuse: Vec3::splat(0.4),
            specular: Vec3::splat(0.4),
            alpha: 0.4,
            ..Material::default()
        };
    }
    scene.emitters = vec![Emitter::Point {
        position: Vec3::new(0.2, 0.7, 0.1),
        intensity: Vec3::ONE,
    }];
    scene
}

/// Mean green of pictures under `lights_of` each set's seed; one value a set.
fn brightness(
    scene: &Scene,
    method: &MethodSpec,
    integrator: Integrator,
    lights_of: impl Fn(&Tracer, u64) -> light_tree::LightSet,
) -> Running {
    let tracer = Tracer::build(scene);
    let mut sets = Running::default();
    for seed in 0..SETS {
        let inputs = Inputs::new(lights_of(&tracer, seed), TreeBuilder::Binned);
        let spec = RenderSpec {
            width: 16,
            height: 16,
            spp: 4,
            seed,
            shape: VirtualShape::ClampedPoint(CLAMP),
            integrator,
            ..spec()
        };
        let mut render = Render::new(scene, &tracer, &inputs, method, spec);
        while render.pass(&|_| ()).is_some() {}
        assert_eq!(render.counters().nonfinite, 0, "{}", method.name());
        let picture = render.picture();
        let sum: f64 = picture.radiance.iter().map(|c| f64::from(c.y)).sum();
        sets.add(sum / picture.radiance.len() as f64);
    }
    sets
}

fn walked(scene: &Scene) -> Running {
    brightness(scene, &all_lights(), PATH(BOUNCES), |_, _| {
        vpl::source_lights(scene)
    })
}

fn virtually(scene: &Scene, method: &MethodSpec, integrator: Integrator) -> Running {
    brightness(scene, method, integrator, |tracer, seed| {
        let mut lights = vpl::source_lights(scene);
        let traced = vpl::VirtualLightSpec {
            count: 300,
            max_bounces: BOUNCES,
            keep_bounces: true,
            seed,
        };
        vpl::trace(scene, tracer, &traced, &mut lights);
        lights
    })
}

const COMPENSATED: Integrator = Integrator::Compensated {
    max_bounces: BOUNCES,
};

#[test]
fn compensated_clamped_lights_are_as_bright_as_paths() {
    for (glossy, method) in [
        (false, all_lights()),
        (true, all_lights()),
        (false, stochastic()),
    ] {
        let scene = room(glossy);
        let (paths, found) = (walked(&scene), virtually(&scene, &method, COMPENSATED));
        let variance = paths.variance_of_mean() + found.variance_of_mean();
        let z = z_test(found.mean(), variance, paths.mean());
        let deviation = variance.sqrt() / paths.mean();
        // Variances are estimated from 32 sets each: Student's t of 31 to 62 degrees, false alarm 1e-4 to 2e-4 in each of three.
        assert!(
            z.abs() < 4.2 && deviation < 0.01,
            "{} in a room that is glossy: {glossy}: {} instead of {}, z = {z}",
            method.name(),
            found.mean(),
            paths.mean()
        );
    }
}

#[test]
fn without_compensation_clamped_lights_are_darker() {
    let scene = room(false);
    let (paths, found) = (
        walked(&scene),
        virtually(&scene, &all_lights(), Integrator::Direct),
    );
    let ratio = found.mean() / paths.mean();
    assert!(ratio < 0.95, "{ratio} of the light is left");
}
