//! What each point has of its own: weights of nodes, a cut, a light from each of its clusters.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion};
use manylight_light_tree::{
    Cut, Cuts, DeadBranch, LightTree, NodeId, NodeWeights, Receiver, Start,
};
use sampling::{Purpose, Rng};

use crate::hall::{Hall, glossy_receivers, receivers};

/// Clusters of a cut, and lights drawn.
const CUT: usize = 10;
/// Points whose cuts are refined, and lights drawn, side by side.
const TOGETHER: usize = 500;

pub(crate) fn bench(c: &mut Criterion, hall: &Hall) {
    weights(c, hall);
    cut(c, hall);
}

/// One step of a descent: a pair of nodes weighed, and one chosen.
fn weights(c: &mut Criterion, hall: &Hall) {
    let mut group = c.benchmark_group("weights");
    for weights in NodeWeights::ALL {
        let name = format!("{weights:?}");
        group.bench_function(BenchmarkId::new(name, hall.count), |b| {
            let tree = hall.tree();
            let receivers = match weights {
                NodeWeights::MinMaxGlossy => glossy_receivers(),
                _ => receivers(),
            };
            let steps = steps(tree, &receivers);
            let mut steps = steps.iter().cycle();
            b.iter(|| {
                let (receiver, node) = steps.next().expect("the list begins again");
                tree.choose_child(weights, receiver, *node, 0.5)
            });
        });
    }
    group.finish();
}

/// Nodes that descents pass through, and for whom.
fn steps<'a>(tree: &LightTree, receivers: &'a [Receiver]) -> Vec<(&'a Receiver, NodeId)> {
    let mut rng = Rng::new(3, 0, 0, Purpose::Lights);
    let mut steps = Vec::new();
    for receiver in receivers.iter().step_by(16) {
        let (mut node, mut u) = (tree.root(), rng.f64());
        while let Some(chosen) = tree.choose_child(NodeWeights::MinMax, receiver, node, u) {
            steps.push((receiver, node));
            (node, u) = (chosen.child, chosen.u);
        }
    }
    steps
}

fn cut(c: &mut Criterion, hall: &Hall) {
    let mut group = c.benchmark_group("point");
    group.bench_function(BenchmarkId::new("cut", hall.count), |b| {
        let tree = hall.tree();
        let receivers = receivers();
        let mut receivers = receivers.iter().cycle();
        let mut cut = Cut::default();
        b.iter(|| {
            let x = receivers.next().expect("the list begins again");
            cut.refine(tree, NodeWeights::Yuksel2019, x, CUT);
            black_box(cut.len())
        });
    });
    for weights in [NodeWeights::Yuksel2019, NodeWeights::MinMax] {
        let name = format!("cut and select, {weights:?}");
        group.bench_function(BenchmarkId::new(name, hall.count), |b| {
            let tree = hall.tree();
            let receivers = receivers();
            let receivers: Vec<&Receiver> = receivers.iter().collect();
            let mut chunks = receivers.chunks_exact(TOGETHER).cycle();
            let mut rng = Rng::new(3, 0, 0, Purpose::Lights);
            let (mut cuts, mut starts, mut drawn) = (Cuts::default(), Vec::new(), Vec::new());
            b.iter(|| {
                let some = chunks.next().expect("the list begins again");
                cuts.refine(tree, weights, some, CUT);
                starts.clear();
                for i in 0..TOGETHER {
                    starts.extend(cuts.of(i).iter().map(|&node| Start {
                        receiver: i as u32,
                        node,
                        u: rng.f64(),
                    }));
                }
                drawn.clear();
                tree.select_each(weights, DeadBranch::Stop, some, &starts, &mut drawn);
                black_box(drawn.len())
            });
        });
    }
    group.finish();
}
