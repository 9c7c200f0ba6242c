//! The tree, and its eight-way form.

use criterion::{BenchmarkId, Criterion, SamplingMode, Throughput};
use manylight_light_tree::{LightTree, TreeBuilder, WideTree};

use crate::hall::Hall;

pub(crate) fn bench(c: &mut Criterion, hall: &Hall) {
    let mut group = c.benchmark_group("build");
    // Ten is the least: the greatest tree takes seconds.
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    group.throughput(Throughput::Elements(hall.count as u64));
    group.bench_function(BenchmarkId::new("tree", hall.count), |b| {
        let lights = hall.lights();
        b.iter_with_large_drop(|| LightTree::build(lights, TreeBuilder::Binned));
    });
    group.bench_function(BenchmarkId::new("collapse", hall.count), |b| {
        let (tree, lights) = (hall.tree(), hall.lights());
        b.iter_with_large_drop(|| WideTree::collapse(tree, lights));
    });
    group.finish();
}
