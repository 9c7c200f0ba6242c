//! Choosing the lights of a point: by a cut of its own, and by one that its tile shares.

use std::hint::black_box;
use std::iter::repeat;

use criterion::Criterion;
use light_tree::{Cuts, DeadBranch, Descents, Draws, NodeWeights, Receiver, SharedCut, Start};
use manylight_gather::GatherPoint;
use sampling::{Purpose, Rng};

use crate::view::{POINTS_PER_PILOT, View};

/// Lights of a point.
pub(crate) const SAMPLES: usize = 10;
/// Points whose own cuts are refined, and lights drawn, side by side.
const TOGETHER: usize = 512;
/// Clusters of a shared cut.
const CLUSTERS: usize = 128;

pub(crate) fn bench(c: &mut Criterion, view: &View) {
    own_cut(c, view);
    shared_cut(c, view);
}

fn own_cut(c: &mut Criterion, view: &View) {
    let mut group = c.benchmark_group(view.place.name);
    for weights in [NodeWeights::Yuksel2019, NodeWeights::MinMax] {
        group.bench_function(format!("cut and select, {weights:?}"), |b| {
            let tree = view.inputs().tree().expect("has lights");
            let tiles = view.tiles(None);
            let receivers: Vec<&Receiver> = tiles.iter().flatten().map(|x| &x.receiver).collect();
            let mut chunks = receivers.chunks(TOGETHER).cycle();
            let mut rng = Rng::new(3, 0, 0, Purpose::Lights);
            let (mut cuts, mut starts, mut drawn) = (Cuts::default(), Vec::new(), Vec::new());
            b.iter(|| {
                let some = chunks.next().expect("sees something");
                cuts.refine(tree, weights, some, SAMPLES);
                starts.clear();
                for i in 0..some.len() {
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

fn shared_cut(c: &mut Criterion, view: &View) {
    let mut group = c.benchmark_group(view.place.name);
    group.bench_function("shared cut: refine", |b| {
        let tree = view.inputs().wide_tree().expect("has lights");
        let tiles: Vec<_> = receivers(view).iter().map(|x| pilots(x)).collect();
        let mut tiles = tiles.iter().cycle();
        let mut cut = SharedCut::default();
        b.iter(|| {
            cut.refine(tree, tiles.next().expect("sees something"), CLUSTERS);
            black_box(cut.len())
        });
    });
    group.bench_function("shared cut: weigh, open, draw", |b| {
        let tree = view.inputs().wide_tree().expect("has lights");
        let with_cut = |points: Vec<Receiver>| {
            let mut cut = SharedCut::default();
            cut.refine(tree, &pilots(&points), CLUSTERS);
            (cut, points)
        };
        let tiles: Vec<_> = receivers(view).into_iter().map(with_cut).collect();
        let points = tiles
            .iter()
            .flat_map(|(cut, points)| repeat(cut).zip(points));
        let mut points = points.cycle();
        let mut rng = Rng::new(3, 0, 0, Purpose::Lights);
        let (mut draws, mut descents) = (Draws::default(), Descents::default());
        b.iter(|| {
            let (cut, x) = points.next().expect("sees something");
            cut.weigh(tree, x, &mut draws);
            cut.open(tree, x, SAMPLES as u32, 1, &mut draws);
            cut.settle(tree, SAMPLES as u32, &mut draws);
            let drawn = cut.draw(tree, x, rng.f64(), &mut draws, &mut descents);
            black_box(drawn.len())
        });
    });
    group.finish();
}

/// The view's points, tile by tile.
fn receivers(view: &View) -> Vec<Vec<Receiver>> {
    let of_tile = |tile: Vec<GatherPoint>| tile.iter().map(|x| x.receiver).collect();
    view.tiles(None).into_iter().map(of_tile).collect()
}

/// The points of a tile that its cut is made for.
fn pilots(points: &[Receiver]) -> Vec<Receiver> {
    points.iter().step_by(POINTS_PER_PILOT).copied().collect()
}
