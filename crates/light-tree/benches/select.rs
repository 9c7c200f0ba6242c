//! Cost of a cut and of drawing from it, over virtual lights on the inner walls of a hall.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use manylight_light_tree::{
    Cut, DeadBranch, LightSet, LightTree, NodeWeights, Receiver, Selector, TreeBuilder,
    VirtualLight,
};
use sampling::{Purpose, Rng};

/// A point on the walls of a hall of 40 × 15 × 20, and the normal there.
fn on_walls(rng: &mut Rng) -> (Vec3, Vec3) {
    let size = Vec3::new(40.0, 15.0, 20.0);
    let axis = (rng.f32() * 3.0) as usize;
    let mut position = Vec3::new(rng.f32(), rng.f32(), rng.f32()) * size;
    let far = rng.f32() < 0.5;
    position[axis] = if far { size[axis] } else { 0.0 };
    let mut normal = Vec3::ZERO;
    normal[axis] = if far { -1.0 } else { 1.0 };
    (position, normal)
}

fn lights(n: usize) -> LightSet {
    let mut rng = Rng::new(1, 0, 0, Purpose::Build);
    let mut set = LightSet::default();
    for _ in 0..n {
        let (position, normal) = on_walls(&mut rng);
        let intensity = Vec3::splat(0.5 + rng.f32());
        set.push_virtual(&VirtualLight {
            position,
            normal,
            intensity,
            gloss: None,
        });
    }
    set
}

fn select(c: &mut Criterion) {
    let mut group = c.benchmark_group("point");
    for n in [1_000, 100_000, 1_000_000] {
        let tree = LightTree::build(&lights(n), TreeBuilder::Binned).expect("has lights");
        let mut rng = Rng::new(2, 0, 0, Purpose::Build);
        let receivers: Vec<Receiver> = (0..1 << 14)
            .map(|_| {
                let (position, normal) = on_walls(&mut rng);
                Receiver::new(position + normal * 0.01, normal)
            })
            .collect();
        let mut next = 0;
        let mut receiver = || {
            next = (next + 1) % receivers.len();
            &receivers[next]
        };
        group.throughput(Throughput::Elements(1));
        let mut cut = Cut::default();
        group.bench_function(format!("cut 10 of {n}"), |b| {
            b.iter(|| {
                cut.refine(&tree, NodeWeights::Yuksel2019, receiver(), 10);
                black_box(cut.len())
            });
        });
        for weights in [NodeWeights::Yuksel2019, NodeWeights::MinMax] {
            let mut selector = Selector::default();
            group.bench_function(format!("cut 10 and select, {weights:?}, of {n}"), |b| {
                b.iter(|| {
                    let x = receiver();
                    cut.refine(&tree, weights, x, 10);
                    let drawn =
                        selector.select(&tree, weights, DeadBranch::Stop, x, cut.nodes(), || {
                            rng.f64()
                        });
                    black_box(drawn.len())
                });
            });
        }
    }
    group.finish();
}

fn build(c: &mut Criterion) {
    let set = lights(1_000_000);
    let mut group = c.benchmark_group("build");
    group.sample_size(10);
    group.bench_function("1000000 lights", |b| {
        b.iter(|| black_box(LightTree::build(&set, TreeBuilder::Binned)))
    });
    group.finish();
}

criterion_group!(benches, select, build);
criterion_main!(benches);
