//! Virtual lights of the built-in nave, and where `MANYLIGHT_SCENES` is set of the paper's scenes.
//!
//!     cargo bench -p manylight-vpl

#[path = "../../../scene/benches/scene/scenes.rs"]
mod scenes;

use std::cell::LazyCell;

use criterion::{
    BenchmarkId, Criterion, SamplingMode, Throughput, criterion_group, criterion_main,
};
use light_tree::LightSet;
use manylight_vpl::{VirtualLightSpec, set_local_radii, source_lights, trace};
use scene::Scene;
use scene::load::load;
use scene::trace::Tracer;
use scenes::{Place, scenes};

/// Virtual lights that are asked for.
const COUNTS: [usize; 3] = [10_000, 100_000, 1_000_000];

fn all(c: &mut Criterion) {
    for place in scenes() {
        scene(c, &place);
    }
}

fn scene(c: &mut Criterion, place: &Place) {
    // Made for the first bench that a filter lets through.
    let scene = LazyCell::new(|| load(&place.path).unwrap_or_else(|e| panic!("{e}")));
    let tracer = LazyCell::new(|| Tracer::build(&scene));
    let mut group = c.benchmark_group(place.name);
    // An iteration takes up to a second.
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    for count in COUNTS {
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(BenchmarkId::new("trace", count), |b| {
            let (scene, tracer) = (&*scene, &*tracer);
            b.iter_with_large_drop(|| traced(scene, tracer, count));
        });
        group.bench_function(BenchmarkId::new("radii", count), |b| {
            let mut lights = traced(&scene, &tracer, count);
            b.iter(|| set_local_radii(&mut lights));
        });
    }
    group.finish();
}

fn traced(scene: &Scene, tracer: &Tracer, count: usize) -> LightSet {
    let mut lights = source_lights(scene);
    let spec = VirtualLightSpec {
        count,
        max_bounces: 8,
        keep_bounces: false,
        seed: 1,
    };
    trace(scene, tracer, &spec, &mut lights);
    lights
}

criterion_group!(benches, all);
criterion_main!(benches);
