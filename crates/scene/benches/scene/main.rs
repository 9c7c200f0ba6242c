//! Rays in the built-in nave, and where `MANYLIGHT_SCENES` is set in the paper's scenes.
//!
//!     cargo bench -p manylight-scene
//!     cargo bench -p manylight-scene -- sponza

#[path = "../../../../tests/peers/rays.rs"]
mod rays;
mod scenes;

use std::cell::LazyCell;
use std::hint::black_box;

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use manylight_scene::load::load;
use manylight_scene::trace::{OcclusionScratch, Ray, Tracer};
use rays::rays_of;
use scenes::{Place, scenes};

/// Rays that are handed to the queue together, as a render does.
const BATCH: usize = 1024;
/// Rays of one iteration: fewer than any of the scenes has.
const EXTRACT: usize = 1 << 16;

fn all(c: &mut Criterion) {
    for place in scenes() {
        scene(c, &place);
    }
}

fn scene(c: &mut Criterion, place: &Place) {
    // Made for the first bench that a filter lets through.
    let scene = LazyCell::new(|| load(&place.path).unwrap_or_else(|e| panic!("{e}")));
    let tracer = LazyCell::new(|| Tracer::build(&scene));
    let rays = LazyCell::new(|| rays_of(&scene, &tracer));
    let mut group = c.benchmark_group(place.name);
    // An iteration takes from milliseconds up to a second.
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    group.bench_function("load", |b| b.iter_with_large_drop(|| load(&place.path)));
    group.bench_function("build", |b| {
        let scene = &*scene;
        b.iter_with_large_drop(|| Tracer::build(scene));
    });
    group.throughput(Throughput::Elements(EXTRACT as u64));
    group.bench_function("shadow rays, queued", |b| {
        let (tracer, rays) = (&*tracer, extract(&rays.shadow));
        let mut answers = [false; BATCH];
        let mut scratch = OcclusionScratch::default();
        b.iter(|| {
            for rays in rays.chunks(BATCH) {
                tracer.occluded(rays, &mut answers[..rays.len()], &mut scratch);
            }
            answers
        });
    });
    group.bench_function("shadow rays, single", |b| {
        let (tracer, rays) = (&*tracer, extract(&rays.shadow));
        b.iter(|| rays.iter().filter(|ray| tracer.is_occluded(ray)).count());
    });
    group.bench_function("closest hit", |b| {
        let (tracer, rays) = (&*tracer, extract(&rays.bounce));
        b.iter(|| {
            for ray in rays {
                black_box(tracer.closest(ray));
            }
        });
    });
    group.finish();
}

/// Those of the middle of the picture, in the order in which a render traces them.
fn extract(rays: &[Ray]) -> &[Ray] {
    let first = (rays.len() - EXTRACT) / 2;
    &rays[first..first + EXTRACT]
}

criterion_group!(benches, all);
criterion_main!(benches);
