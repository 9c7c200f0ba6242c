//! What ten lights bring a point: virtual spheres in the churches, lamps elsewhere.

use criterion::{Criterion, Throughput};
use glam::Vec3;
use light_tree::{Cut, LightId, NodeWeights};
use manylight_gather::{
    GatherPoint, LightEval, LightSample, QueueScratch, ShadowQueue, VirtualShape,
};
use sampling::{Purpose, Rng};
use scene::trace::Tracer;
use scene::{Brdf, Fresnel, Scene};

use crate::select::SAMPLES;
use crate::view::View;

const MATTE: Brdf = Brdf {
    diffuse: Vec3::splat(0.5),
    specular: Vec3::ZERO,
    alpha: 1.0,
    fresnel: Fresnel::Constant,
};
const GLOSSY: Brdf = Brdf {
    specular: Vec3::splat(0.3),
    alpha: 0.2,
    ..MATTE
};

pub(crate) fn bench(c: &mut Criterion, view: &View) {
    let mut group = c.benchmark_group(view.place.name);
    group.throughput(Throughput::Elements(SAMPLES as u64));
    // Where there is nothing, rays cost next to nothing.
    let nothing = Tracer::build(&Scene::default());
    for (name, brdf) in [("matte", MATTE), ("glossy", GLOSSY)] {
        group.bench_function(format!("evaluate 10, {name}"), |b| {
            let (scene, lights) = (&view.scene().0, &view.inputs().lights);
            let drawn = drawn(view, brdf);
            let mut drawn = drawn.iter().cycle();
            let shape = VirtualShape::Sphere;
            let mut scratch = QueueScratch::default();
            let mut queue = ShadowQueue::new(scene, lights, &nothing, shape, 1, &mut scratch);
            let mut point = 0;
            b.iter(|| {
                let (x, lights) = drawn.next().expect("sees something");
                point += 1;
                queue.begin_point(Rng::new(1, point, 0, Purpose::LightSurface));
                for &light in lights {
                    queue.expect(light);
                }
                queue.add(x, lights.map(|light| LightSample::new(light, 1.0)));
                queue.end_point();
            });
        });
    }
    group.finish();
}

/// Points of `brdf`, each with ten lights drawn for it; those that fewer can light are left out.
fn drawn(view: &View, brdf: Brdf) -> Vec<(GatherPoint, [LightId; SAMPLES])> {
    let tree = view.inputs().tree().expect("has lights");
    let mut rng = Rng::new(3, 0, 0, Purpose::Lights);
    let mut cut = Cut::default();
    let weights = NodeWeights::MinMax;
    let draw = |x: GatherPoint| {
        cut.refine(tree, weights, &x.receiver, SAMPLES);
        let lights = cut
            .nodes()
            .filter_map(|node| tree.select(weights, &x.receiver, node, rng.f64()));
        let lights: Vec<_> = lights.map(|drawn| drawn.light).collect();
        Some((x, lights.try_into().ok()?))
    };
    view.tiles(Some(brdf))
        .into_iter()
        .flatten()
        .filter_map(draw)
        .collect()
}
