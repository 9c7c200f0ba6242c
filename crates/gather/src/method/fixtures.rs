//! What tests of single methods share: many points, many lights, and a method's answer.

use glam::{DVec3, Vec3};
use light_tree::LightSet;
use sampling::{Purpose, Rng};
use scene::trace::{Hit, Tracer};
use scene::{Emitter, Scene};

use super::{AllLights, Method};
use crate::Inputs;
use crate::contribution::VirtualShape;
use crate::counters::Counters;
use crate::point::GatherPoint;
use crate::shadow_queue::{QueueScratch, ShadowQueue};

/// What a method finds at `x`, with points on virtual lights drawn from stream `sample`.
pub(crate) fn at<'m, M: Method<'m>>(
    method: &M,
    inputs: &Inputs,
    tracer: &Tracer,
    shape: VirtualShape,
    x: &GatherPoint,
    sample: u64,
) -> (DVec3, Counters) {
    let mut scratch = QueueScratch::default();
    // Lights without extent ask for nothing of the scene.
    let scene = Scene::default();
    let lights = &inputs.lights;
    let mut queue = ShadowQueue::new(&scene, lights, tracer, shape, 1, &mut scratch);
    let stream = |purpose| Rng::new(3, 0, sample, purpose);
    queue.begin_point(stream(Purpose::LightSurface));
    method.point(
        x,
        &mut queue,
        &mut stream(Purpose::Lights),
        &mut M::Scratch::default(),
    );
    queue.end_point();
    let (counters, sums) = queue.finish();
    (sums[0].radiance, counters)
}

pub(crate) fn all_lights(inputs: &Inputs) -> AllLights<'_> {
    Method::prepare(&Default::default(), inputs)
}

/// Points all over the room.
pub(crate) fn many_points(scene: &Scene) -> Vec<GatherPoint> {
    let mut rng = Rng::new(8, 0, 0, Purpose::Eye);
    let mut points = Vec::new();
    while points.len() < 300 {
        let hit = Hit {
            t: 1.0,
            triangle: (rng.f32() * 8.0) as u32,
            u: rng.f32(),
            v: rng.f32(),
        };
        let toward = Vec3::new(0.3, 1.5, 3.0);
        let place = scene.surface(&hit, Vec3::NEG_Y).position;
        let direction = (place - toward).normalize();
        if hit.u + hit.v < 1.0 {
            let surface = scene.surface(&hit, direction);
            points.push(GatherPoint::new(&surface, -direction, Vec3::ONE, 0));
        }
    }
    points
}

/// Two thousand lights of two kinds, about the room.
pub(crate) fn many_lights(scene: &Scene, tracer: &Tracer) -> LightSet {
    let mut rng = Rng::new(9, 0, 0, Purpose::Build);
    let mut lights = LightSet::default();
    let mut emitters = Vec::new();
    for _ in 0..500 {
        let [x, y, z] = [rng.f32(), rng.f32(), rng.f32()];
        let position = Vec3::new(4.0 * x - 2.0, 1.0 + 1.9 * y, 4.0 * z - 1.9);
        let intensity = Vec3::new(rng.f32(), rng.f32(), rng.f32());
        lights.push_point(position, intensity);
        emitters.push(Emitter::Point {
            position,
            intensity,
        });
    }
    let lit = Scene {
        emitters,
        ..scene.clone()
    };
    let spec = vpl::VirtualLightSpec {
        count: 1500,
        max_bounces: 4,
        keep_bounces: false,
        seed: 5,
    };
    vpl::trace(&lit, tracer, &spec, &mut lights);
    lights.set_radius(0.1);
    lights
}
