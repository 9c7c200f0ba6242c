//! Stochastic lightcuts against all lights where it matters: the nave under virtual lights.

use std::path::Path;

use light_tree::{LightSet, TreeBuilder};
use rayon::prelude::*;
use scene::trace::{Ray, Tracer};
use scene::{Camera, Scene};
use verify::normal_fit;

use super::conformance::{Estimates, running};
use super::stochastic_lightcuts::{DeadBranches, StochasticLightcutsSpec};
use super::*;

/// The built-in cathedral with its own lights and about `count` virtual ones.
fn nave(count: usize) -> (Scene, Tracer, Inputs) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/nave/scene.ron");
    let scene = scene::load::load(&path).expect("the built-in scene loads");
    let tracer = Tracer::build(&scene);
    let mut lights: LightSet = vpl::source_lights(&scene.emitters);
    let spec = vpl::VirtualLightSpec {
        count,
        max_bounces: 8,
        seed: 1,
    };
    vpl::trace(&scene, &tracer, &spec, &mut lights);
    lights.set_radius(vpl::neighbour_distance(&lights, 10));
    (scene, tracer, Inputs::new(lights, TreeBuilder::Binned))
}

/// What the camera sees through the centres of a `width` × `height` picture's pixels.
fn visible_points(scene: &Scene, tracer: &Tracer, width: u32, height: u32) -> Vec<GatherPoint> {
    let camera = Camera::new(&scene.camera, width, height);
    (0..width * height)
        .filter_map(|i| {
            let direction = camera.direction((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let hit = tracer.closest(&Ray {
                origin: camera.origin(),
                direction,
                t_max: f32::INFINITY,
            })?;
            Some(GatherPoint::new(
                &scene.surface(&hit, direction),
                -direction,
                glam::Vec3::ONE,
                0,
            ))
        })
        .collect()
}

/// Estimates by `method` against all lights, at each point: mean ratio of the sums, and the points' z-scores.
fn compare(method: &StochasticLightcutsSpec, estimates: u32) -> (f64, Vec<f64>) {
    let (scene, tracer, inputs) = nave(2000);
    let points = visible_points(&scene, &tracer, 24, 14);
    assert!(points.len() > 300, "the camera is inside");
    let results: Vec<(f64, f64, f64)> = points
        .par_iter()
        .enumerate()
        .map(|(i, &x)| {
            let run = |method: &MethodSpec, count| {
                let (_, values, _) = method.visit(
                    &inputs,
                    Estimates {
                        inputs: &inputs,
                        tracer: &tracer,
                        x,
                        count,
                        seed: i as u64,
                    },
                );
                running(&values, 1)
            };
            let exact = run(&MethodSpec::AllLights(Default::default()), 16);
            let estimate = run(&MethodSpec::StochasticLightcuts(method.clone()), estimates);
            let variance = estimate.variance_of_mean() + exact.variance_of_mean();
            (
                estimate.mean(),
                exact.mean(),
                verify::z_test(estimate.mean(), variance, exact.mean()),
            )
        })
        .collect();
    let (estimate, exact) = results
        .iter()
        .fold((0.0, 0.0), |sum, r| (sum.0 + r.0, sum.1 + r.1));
    (estimate / exact, results.iter().map(|r| r.2).collect())
}

#[test]
fn stochastic_lightcuts_average_to_all_lights_in_the_nave() {
    // The ratio's own deviation is 0.05 %, estimated from the scores' variances: 4 sigma, false alarm 6e-5.
    let (ratio, z) = compare(&StochasticLightcutsSpec::default(), 4000);
    assert!((ratio - 1.0).abs() < 2e-3, "mean ratio {ratio}");
    // Anderson–Darling at 1e-4.
    assert!(
        normal_fit(&z) > 1e-4,
        "z-scores are not standard normal: p = {}",
        normal_fit(&z)
    );
}

#[test]
fn retry_is_too_bright_in_the_nave() {
    let spec = StochasticLightcutsSpec {
        dead_branches: DeadBranches::Retry,
        ..Default::default()
    };
    let (ratio, _) = compare(&spec, 1000);
    assert!(ratio > 1.005, "mean ratio {ratio}");
}
