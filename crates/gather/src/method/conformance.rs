//! Tests that every listed method must pass, over small scenes made here.
//!
//! A method added to the list is tested without another line.

use glam::{DVec3, Vec3};
use light_tree::{LightKind, LightSet, TreeBuilder, VirtualLight};
use sampling::{Purpose, Rng, Sequence};
use scene::trace::{Hit, Tracer};
use scene::{Emitter, Material, MaterialId, Mesh, Scene};
use verify::{Running, critical_z, sidak, z_test};

use super::shining_room::shining_room;
use super::stochastic_lightcuts::Weights;
use super::*;
use crate::contribution::VirtualShape;
use crate::counters::Counters;
use crate::shadow_queue::{QueueScratch, SampleSum, ShadowQueue};
use crate::side_by_side::LightSample;

/// Probability that a sound method fails [`unbiased_methods_agree_with_all_lights`] for a random seed.
const FALSE_ALARM: f64 = 1e-4;

/// A floor, a wall, and a block that casts shadows; `glossy` adds a Phong lobe.
pub(crate) fn room(glossy: bool) -> Scene {
    let mut mesh = Mesh::default();
    let mut quad = |corners: [[f32; 3]; 4]| {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners.map(Vec3::from));
        mesh.indices
            .extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        mesh.materials.extend([MaterialId(0); 2]);
    };
    quad([
        [-2.0, 0.0, -2.0],
        [-2.0, 0.0, 2.0],
        [2.0, 0.0, 2.0],
        [2.0, 0.0, -2.0],
    ]);
    quad([
        [-2.0, 0.0, -2.0],
        [2.0, 0.0, -2.0],
        [2.0, 3.0, -2.0],
        [-2.0, 3.0, -2.0],
    ]);
    quad([
        [-0.5, 0.8, -0.5],
        [-0.5, 0.8, 0.5],
        [0.5, 0.8, 0.5],
        [0.5, 0.8, -0.5],
    ]);
    quad([
        [0.5, 0.0, -0.5],
        [0.5, 0.8, -0.5],
        [0.5, 0.8, 0.5],
        [0.5, 0.0, 0.5],
    ]);
    let specular = if glossy { 0.3 } else { 0.0 };
    let material = Material {
        diffuse: Vec3::new(0.6, 0.5, 0.4),
        specular: Vec3::splat(specular),
        alpha: 0.3,
        ..Material::default()
    };
    Scene {
        mesh,
        materials: vec![material],
        ..Scene::default()
    }
}

/// The light sets of the suite, by name.
pub(crate) fn light_sets(scene: &Scene, tracer: &Tracer) -> Vec<(&'static str, LightSet)> {
    let mut rng = Rng::new(21, 0, 0, Purpose::Build);
    let mut points = LightSet::default();
    for _ in 0..150 {
        let p = Vec3::new(
            rng.f32() * 4.0 - 2.0,
            0.1 + 2.9 * rng.f32(),
            rng.f32() * 3.9 - 1.9,
        );
        points.push_point(
            p,
            Vec3::new(rng.f32(), rng.f32(), rng.f32()) * 2.0f32.powf(6.0 * rng.f32()),
        );
    }
    let mut one = LightSet::default();
    one.push_point(Vec3::new(0.5, 2.0, 1.0), Vec3::ONE);
    let mut twins = LightSet::default();
    for _ in 0..2 {
        twins.push_point(Vec3::new(-1.0, 2.0, 1.0), Vec3::new(1.0, 0.5, 0.0));
    }
    let mut mixed = LightSet::default();
    for i in 0..20 {
        mixed.push_point(Vec3::new(i as f32 * 0.2 - 2.0, 2.5, 0.0), Vec3::splat(0.3));
    }
    for i in 0..5 {
        let direction = Vec3::new(i as f32 * 0.3 - 0.6, -1.0, -0.4).normalize();
        mixed.push_directional(direction, Vec3::splat(0.2));
    }
    let mut bounced = LightSet::default();
    let source = Emitter::Point {
        position: Vec3::new(1.0, 2.0, 1.0),
        intensity: Vec3::ONE,
    };
    bounced.push_point(Vec3::new(1.0, 2.0, 1.0), Vec3::ONE);
    let lit = Scene {
        emitters: vec![source],
        ..scene.clone()
    };
    let spec = vpl::VirtualLightSpec {
        count: 300,
        max_bounces: 4,
        keep_bounces: false,
        seed: 5,
    };
    vpl::trace(&lit, tracer, &spec, &mut bounced);
    bounced.set_radius(0.2);
    vec![
        ("none", LightSet::default()),
        ("one", one),
        ("two alike", twins),
        ("150 points", points),
        ("points and parallel light", mixed),
        ("virtual lights", bounced),
    ]
}

/// Every scene of the suite with every set of lights in it, by name.
pub(super) fn cases(glossy: bool) -> Vec<(Scene, Tracer, &'static str, LightSet)> {
    let mut cases = Vec::new();
    let scene = room(glossy);
    for (name, lights) in light_sets(&scene, &Tracer::build(&scene)) {
        cases.push((scene.clone(), Tracer::build(&scene), name, lights));
    }
    let all = shining_room(glossy);
    let dark = Scene {
        emitters: Vec::new(),
        environment: None,
        ..all.clone()
    };
    let only = |wanted: fn(&Emitter) -> bool| Scene {
        emitters: all.emitters.iter().copied().filter(wanted).collect(),
        ..dark.clone()
    };
    let sky = Scene {
        environment: all.environment.clone(),
        ..dark.clone()
    };
    let mut with_virtual = all.clone();
    with_virtual.emitters.push(Emitter::Point {
        position: Vec3::new(1.0, 2.0, 1.0),
        intensity: Vec3::ONE,
    });
    with_virtual.emitters.push(Emitter::Directional {
        direction: Vec3::new(0.3, -1.0, -0.2).normalize(),
        irradiance: Vec3::splat(0.4),
    });
    for (name, scene) in [
        ("spots", only(|e| matches!(e, Emitter::Spot { .. }))),
        ("panels", only(|e| matches!(e, Emitter::Triangle { .. }))),
        ("a sky", sky),
        ("every kind", with_virtual),
    ] {
        let tracer = Tracer::build(&scene);
        let mut lights = vpl::source_lights(&scene);
        if name == "every kind" {
            let spec = vpl::VirtualLightSpec {
                count: 200,
                max_bounces: 3,
                keep_bounces: false,
                seed: 5,
            };
            vpl::trace(&scene, &tracer, &spec, &mut lights);
            lights.set_radius(0.2);
            let missing = LightKind::ALL.iter().find(|k| lights.count(**k) == 0);
            assert_eq!(missing, None, "a kind that is not there");
        }
        cases.push((scene, tracer, name, lights));
    }
    cases
}

/// Gather points on floor, wall, block, in a corner, and right beside a light.
pub(crate) fn gather_points(scene: &Scene) -> Vec<GatherPoint> {
    gather_points_of(scene, 1.0)
}

/// The same of a room that is `scale` times as large.
fn gather_points_of(scene: &Scene, scale: f32) -> Vec<GatherPoint> {
    let hits = [
        (0, 0.3, 0.3),
        (1, 0.7, 0.1),
        (1, 0.99, 0.005),
        (2, 0.4, 0.5),
        (3, 0.2, 0.05),
        (4, 0.3, 0.3),
        (7, 0.5, 0.2),
    ];
    hits.into_iter()
        .map(|(triangle, u, v)| {
            let hit = Hit {
                t: 1.0,
                triangle,
                u,
                v,
            };
            let toward = Vec3::new(0.3, 1.5, 3.0) * scale;
            let at = scene.surface(&hit, Vec3::NEG_Y).position;
            let direction = (at - toward).normalize();
            GatherPoint::new(&scene.surface(&hit, direction), -direction, Vec3::ONE, 0)
        })
        .collect()
}

/// Estimates of the light at `x`, one a slot.
pub(super) struct Estimates<'a> {
    pub(super) scene: &'a Scene,
    pub(super) inputs: &'a Inputs,
    pub(super) tracer: &'a Tracer,
    pub(super) x: GatherPoint,
    pub(super) count: u32,
    pub(super) seed: u64,
}

impl Visitor for Estimates<'_> {
    type Output = (bool, Vec<DVec3>, Counters);

    fn visit<'m, M: Method<'m>>(self, method: M) -> Self::Output {
        let mut queue_scratch = QueueScratch::default();
        let mut scratch = M::Scratch::default();
        let slots = self.count as usize;
        let lights = &self.inputs.lights;
        let mut queue = ShadowQueue::new(
            self.scene,
            lights,
            self.tracer,
            VirtualShape::Sphere,
            slots,
            &mut queue_scratch,
        );
        for slot in 0..self.count {
            let stream = |purpose| Rng::new(self.seed, u64::from(slot), 0, purpose);
            queue.begin_point(stream(Purpose::LightSurface));
            // Estimates of one sequence would not be independent.
            let x = GatherPoint {
                slot,
                sequence: Sequence(slot),
                ..self.x
            };
            method.point(&x, &mut queue, &mut stream(Purpose::Lights), &mut scratch);
            queue.end_point();
        }
        let (counters, sums) = queue.finish();
        (method.is_unbiased(), radiances(sums), counters)
    }
}

/// The radiance of all pixel samples.
pub(super) fn radiances(sums: &[SampleSum]) -> Vec<DVec3> {
    sums.iter().map(|sum| sum.radiance).collect()
}

pub(super) fn running(values: &[DVec3], channel: usize) -> Running {
    let mut running = Running::default();
    for v in values {
        running.add(v[channel]);
    }
    running
}

/// Every method with its default settings, and some with others.
pub(super) fn settings() -> Vec<MethodSpec> {
    let mut all = MethodSpec::all();
    let weights = LightWeights::Cheap;
    all.push(MethodSpec::Importance(ImportanceSpec {
        weights,
        ..Default::default()
    }));
    // The number of samples must not change the brightness.
    for samples in [1, 100].map(Count::of) {
        all.push(MethodSpec::Uniform(UniformSpec { samples }));
        all.push(MethodSpec::Power(PowerSpec { samples }));
        all.push(MethodSpec::Importance(ImportanceSpec {
            samples,
            ..Default::default()
        }));
    }
    let splitting = |threshold, max_samples, samples, weights| {
        MethodSpec::AdaptiveSplitting(AdaptiveSplittingSpec {
            threshold: Fraction::of(threshold),
            max_samples: Count::of(max_samples),
            samples: Count::of(samples),
            weights,
        })
    };
    all.extend([
        splitting(0.0, 64, 10, Weights::ContyKulla2018),
        splitting(1.0, 64, 2, Weights::ContyKulla2018),
        splitting(0.9, 3, 1, Weights::MinMax),
        splitting(1.0, 1000, 1, Weights::Yuksel2019),
        splitting(0.7, 16, 3, Weights::MinMaxWithoutCones),
    ]);
    let stochastic = |cut, weights| {
        MethodSpec::StochasticLightcuts(StochasticLightcutsSpec {
            cut: Count::of(cut),
            weights,
            ..Default::default()
        })
    };
    all.extend([
        stochastic(10, Weights::MinMax),
        stochastic(10, Weights::MinMaxWithoutCones),
        stochastic(10, Weights::MinMaxGlossy),
        stochastic(10, Weights::ContyKulla2018),
        stochastic(1, Weights::MinMax),
        stochastic(100, Weights::Yuksel2019),
    ]);
    all.extend([0.3, 1.0].map(|roulette| {
        MethodSpec::StochasticLightcuts(StochasticLightcutsSpec {
            roulette: Fraction::of(roulette),
            ..Default::default()
        })
    }));
    all
}

/// How far a method's mean at a point is from that of all lights.
struct Score {
    /// In standard deviations.
    z: f64,
    method: String,
    lights: &'static str,
    at: Vec3,
    estimate: f64,
    truth: f64,
}

/// Scores of the unbiased ones among `methods`, on trees by `builder`, at each `every`-th of the gather points.
fn scores(methods: &[MethodSpec], builder: TreeBuilder, glossy: bool, every: usize) -> Vec<Score> {
    let mut scores = Vec::new();
    for (scene, tracer, name, lights) in cases(glossy) {
        let inputs = Inputs::new(lights, builder);
        for x in gather_points(&scene).into_iter().step_by(every) {
            let estimates = |method: &MethodSpec, count| {
                let estimates = Estimates {
                    scene: &scene,
                    inputs: &inputs,
                    tracer: &tracer,
                    x,
                    count,
                    seed: 31,
                };
                method.visit(&inputs, estimates)
            };
            let (_, exact, _) = estimates(&MethodSpec::AllLights(Default::default()), 200);
            for method in methods {
                // Of the biased ones only that they are sound.
                let (unbiased, _, few) = estimates(method, 20);
                let (_, values, counters) = match unbiased {
                    true => estimates(method, 4000),
                    false => (false, Vec::new(), few),
                };
                assert_eq!(counters.nonfinite, 0, "{method:?} with {name}");
                if !unbiased {
                    continue;
                }
                for channel in 0..3 {
                    let (estimate, truth) = (running(&values, channel), running(&exact, channel));
                    // All-lights draws a point inside virtual lights that straddle a horizon: it has a variance too.
                    // And a method that is exact up to an f32's rounding may have hardly any.
                    let rounding = 1e-7 * truth.mean();
                    let variance = estimate.variance_of_mean()
                        + truth.variance_of_mean()
                        + rounding * rounding;
                    scores.push(Score {
                        z: z_test(estimate.mean(), variance, truth.mean()),
                        method: format!("{method:?} on {builder:?}"),
                        lights: name,
                        at: x.position,
                        estimate: estimate.mean(),
                        truth: truth.mean(),
                    });
                }
            }
        }
    }
    scores
}

fn assert_agreement(scores: &[Score]) {
    let limit = critical_z(sidak(FALSE_ALARM, scores.len()));
    for score in scores {
        // 4000 estimates whose tail is heavy are not quite normal: a fifth more room.
        let Score {
            z,
            method,
            lights,
            at,
            estimate,
            truth,
        } = score;
        assert!(
            z.abs() < 1.2 * limit,
            "{method}, {lights}, at {at}: {estimate} instead of {truth}, z = {z}"
        );
    }
}

#[test]
fn unbiased_methods_agree_with_all_lights() {
    for glossy in [false, true] {
        let scores = scores(&settings(), TreeBuilder::Binned, glossy, 1);
        assert!(scores.len() > 1000, "only {} comparisons", scores.len());
        assert_agreement(&scores);
    }
}

#[test]
fn methods_that_use_a_tree_agree_with_all_lights_on_a_tree_of_any_builder() {
    let methods: Vec<MethodSpec> = MethodSpec::all()
        .into_iter()
        .filter(MethodSpec::uses_tree)
        .collect();
    for builder in TreeBuilder::ALL {
        let scores = scores(&methods, builder, false, 3);
        assert!(scores.len() > 100, "only {} comparisons", scores.len());
        assert_agreement(&scores);
    }
}

#[test]
fn points_on_lights_and_lights_in_one_place_leave_every_method_finite() {
    let scene = room(true);
    let tracer = Tracer::build(&scene);
    let x = gather_points(&scene)[0];
    let set = |places: &[Vec3]| {
        let mut lights = LightSet::default();
        for place in places {
            lights.push_point(*place, Vec3::ONE);
        }
        // Virtual lights in the same places, seen from their middle.
        for place in places {
            lights.push_virtual(&VirtualLight {
                position: *place,
                normal: -x.ns,
                intensity: Vec3::splat(0.5),
                gloss: None,
            });
        }
        lights
    };
    let p = x.position;
    let (beside, above) = (p + Vec3::X, p + 0.5 * x.ns);
    let cases = [
        // The point on a light, on many, and in the middle of a box.
        set(&[p]),
        set(&[p; 5]),
        set(&[p, p - Vec3::X, beside, above]),
        set(&[above; 7]),
        set(&[p + 1e-30 * x.ns, p + 1e-20 * x.ns, above]),
    ];
    for (case, mut lights) in cases.into_iter().enumerate() {
        for radius in [0.0, 0.3] {
            lights.set_radius(radius);
            let inputs = Inputs::new(lights.clone(), TreeBuilder::Binned);
            for method in settings() {
                let estimates = Estimates {
                    scene: &scene,
                    inputs: &inputs,
                    tracer: &tracer,
                    x,
                    count: 20,
                    seed: 31,
                };
                let (_, values, counters) = method.visit(&inputs, estimates);
                let sound = values
                    .iter()
                    .all(|v| v.is_finite() && v.min_element() >= 0.0);
                assert!(
                    sound && counters.nonfinite == 0,
                    "{method:?}, case {case}, radius {radius}: {values:?}"
                );
            }
        }
    }
}

/// `scene`, everything in it `scale` times as large.
fn scaled_room(scale: f32) -> Scene {
    let mut scene = room(true);
    for p in &mut scene.mesh.positions {
        *p *= scale;
    }
    scene
}

/// `lights`, in that scene: intensities grow with the square of distances.
fn scaled_lights(lights: &LightSet, scale: f32) -> LightSet {
    let mut scaled = LightSet::default();
    for id in lights.ids() {
        let (position, intensity) = (lights.position(id) * scale, lights.intensity(id));
        match (lights.virtual_light(id), lights.kind(id)) {
            (Some(light), _) => scaled.push_virtual(&VirtualLight {
                position,
                intensity: light.intensity * (scale * scale),
                ..light
            }),
            (None, LightKind::Directional) => scaled.push_directional(lights.axis(id), intensity),
            (None, _) => scaled.push_point(position, intensity * (scale * scale)),
        };
    }
    scaled.set_radius(lights.greatest_radius() * scale);
    scaled
}

#[test]
fn the_unit_of_length_changes_no_pick_and_no_bit_of_any_method() {
    let (scene, points) = (room(true), gather_points(&room(true)));
    let tracer = Tracer::build(&scene);
    for scale in [2.0f32.powi(-10), 2.0f32.powi(7)] {
        let large = scaled_room(scale);
        let large_tracer = Tracer::build(&large);
        for (name, lights) in light_sets(&scene, &tracer) {
            let inputs = Inputs::new(lights.clone(), TreeBuilder::Binned);
            let large_inputs = Inputs::new(scaled_lights(&lights, scale), TreeBuilder::Binned);
            for (x, large_x) in points.iter().zip(gather_points_of(&large, scale)) {
                for method in settings() {
                    let run = |inputs, tracer, x| {
                        let estimates = Estimates {
                            scene: &scene,
                            inputs,
                            tracer,
                            x,
                            count: 20,
                            seed: 31,
                        };
                        let (_, values, counters) = method.visit(inputs, estimates);
                        (values, counters.light_samples, counters.shadow_rays)
                    };
                    assert_eq!(
                        run(&inputs, &tracer, *x),
                        run(&large_inputs, &large_tracer, large_x),
                        "{method:?} with {name} at scale {scale}"
                    );
                }
            }
        }
    }
}

#[test]
fn shadow_rays_wait_for_a_batch_without_changing_a_bit() {
    let scene = room(false);
    let tracer = Tracer::build(&scene);
    let (_, lights) = light_sets(&scene, &tracer).swap_remove(3);
    let inputs = Inputs::new(lights, TreeBuilder::Binned);
    for x in gather_points(&scene) {
        let mut scratch = QueueScratch::default();
        let mut queue = ShadowQueue::new(
            &scene,
            &inputs.lights,
            &tracer,
            VirtualShape::Sphere,
            1,
            &mut scratch,
        );
        let mut at_once = DVec3::ZERO;
        for id in inputs.lights.ids() {
            queue.add(&x, [LightSample::new(id, 1.0)]);
            at_once += queue.radiance(&x, id).as_dvec3();
        }
        let lights: Vec<_> = inputs.lights.ids().collect();
        let mut radiances = vec![Vec3::ONE; 3];
        queue.radiances(&x, &lights, &mut radiances);
        assert_eq!(radiances.len(), lights.len(), "one each");
        let together = radiances.iter().map(|r| r.as_dvec3()).sum::<DVec3>();
        let (counters, sums) = queue.finish();
        assert_eq!(sums[0].radiance, at_once, "at {}", x.position);
        assert_eq!(together, at_once, "together at {}", x.position);
        assert_eq!(counters.light_samples, 3 * lights.len() as u64, "all count");
    }
}

#[test]
fn a_method_reports_nothing_where_there_is_nothing_to_see() {
    let scene = room(false);
    let tracer = Tracer::build(&scene);
    let mut behind = LightSet::default();
    behind.push_point(Vec3::new(0.0, -1.0, 0.0), Vec3::ONE);
    let inputs = Inputs::new(behind, TreeBuilder::Binned);
    let x = gather_points(&scene)[0];
    for method in settings() {
        let estimates = Estimates {
            scene: &scene,
            inputs: &inputs,
            tracer: &tracer,
            x,
            count: 10,
            seed: 31,
        };
        let (_, values, counters) = method.visit(&inputs, estimates);
        assert!(
            values.iter().all(|v| *v == DVec3::ZERO),
            "{}: light from below the floor",
            method.name()
        );
        assert_eq!(
            counters.shadow_rays,
            0,
            "{}: a ray to a light below the horizon",
            method.name()
        );
    }
}
