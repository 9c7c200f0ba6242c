//! A cut that the points of a tile share. Each of a point's steps needs the ones before: their times are those up to it.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion};
use manylight_light_tree::{Descents, Draws, Receiver, SharedCut, WideTree};
use sampling::{Purpose, Rng};

use crate::hall::{Hall, tile};

/// Clusters of the cut.
const CLUSTERS: usize = 128;
/// Points that it is made for.
const PILOTS: usize = 16;
/// Lights drawn.
const SAMPLES: u32 = 10;
/// Tiles that take turns, and points of each.
const TILES: usize = 64;
const POINTS: usize = 64;

pub(crate) fn bench(c: &mut Criterion, hall: &Hall) {
    let mut group = c.benchmark_group("shared cut");
    group.bench_function(BenchmarkId::new("refine", hall.count), |b| {
        let tree = hall.wide_tree();
        let mut rng = Rng::new(4, 0, 0, Purpose::Build);
        let tiles = [(); TILES].map(|()| tile::<PILOTS>(&mut rng));
        let mut tiles = tiles.iter().cycle();
        let mut cut = SharedCut::default();
        b.iter(|| {
            let pilots = tiles.next().expect("the list begins again");
            cut.refine(tree, pilots, CLUSTERS);
            black_box(cut.len())
        });
    });
    for (name, last) in [
        ("weigh", Step::Weigh),
        ("weigh, open", Step::Open),
        ("weigh, open, draw", Step::Draw),
    ] {
        group.bench_function(BenchmarkId::new(name, hall.count), |b| {
            let tree = hall.wide_tree();
            let tiles = tiles(tree);
            let points = tiles.iter().flat_map(|(cut, points)| {
                let cut = std::iter::repeat(cut);
                cut.zip(points)
            });
            let mut points = points.cycle();
            let mut rng = Rng::new(3, 0, 0, Purpose::Lights);
            let (mut draws, mut descents) = (Draws::default(), Descents::default());
            b.iter(|| {
                let (cut, x) = points.next().expect("the list begins again");
                cut.weigh(tree, x, &mut draws);
                if last >= Step::Open {
                    cut.open(tree, x, SAMPLES, 1, &mut draws);
                }
                if last == Step::Draw {
                    cut.settle(tree, SAMPLES, &mut draws);
                    let drawn = cut.draw(tree, x, rng.f64(), &mut draws, &mut descents);
                    black_box(drawn.len());
                }
                black_box(draws.weight(0))
            });
        });
    }
    group.finish();
}

#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Step {
    Weigh,
    Open,
    Draw,
}

/// Cuts, and the points that each is for.
fn tiles(tree: &WideTree) -> Vec<(SharedCut, [Receiver; POINTS])> {
    let mut rng = Rng::new(4, 0, 0, Purpose::Build);
    let mut of_tile = || {
        let points = tile::<POINTS>(&mut rng);
        let mut cut = SharedCut::default();
        cut.refine(tree, &points[..PILOTS], CLUSTERS);
        (cut, points)
    };
    (0..TILES).map(|_| of_tile()).collect()
}
