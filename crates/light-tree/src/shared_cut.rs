//! A cut that many receivers share: its clusters are weighed all at once, and lights drawn from them in one sweep.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::block::{Block, Cluster, Lanes, Seen, WIDTH};
use crate::bounds::Receiver;
use crate::descent::{Descents, Drawn, Pick};
use crate::draws::Draws;
use crate::opening::Row;
use crate::wide::WideTree;

/// A partition of all lights into clusters, good for receivers near each other.
///
/// Unlike a [`Cut`](crate::Cut) it leaves no light out: what is dark for the receivers it was refined for may be lit
/// for others. Clusters lie in the tree's order, so that neighbours in the list are neighbours in space.
#[derive(Debug, Default)]
pub struct SharedCut {
    pub(crate) blocks: Vec<Block>,
    /// ‖Iᴰ‖ of each block's clusters; empty when there is none.
    pub(crate) parallel: Vec<Lanes>,
    len: usize,
    growth: Growth,
}

/// Memory of a cut while it grows.
#[derive(Debug, Default)]
struct Growth {
    clusters: Vec<Grown>,
    candidates: BinaryHeap<Candidate>,
    seen: Vec<Seen>,
    stack: Vec<u32>,
}

/// A cluster of a growing cut: what it was split into, or itself.
#[derive(Debug)]
struct Grown {
    /// The block that holds it, and where.
    block: u32,
    lane: u32,
    /// Position of the first child, and how many; none for a cluster of the cut.
    first: u32,
    children: u32,
}

/// A cluster that may be split.
#[derive(Debug, PartialEq)]
struct Candidate {
    bound: f32,
    /// Position in the list that grows.
    at: u32,
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound
            .total_cmp(&other.bound)
            .then(other.at.cmp(&self.at))
    }
}

impl SharedCut {
    /// Splits the tree, always the cluster of greatest error bound summed over `receivers`, until there are `size` ≥ 1
    /// clusters or up to seven more, or nothing is left to split. Without receivers only the root is split.
    pub fn refine(&mut self, tree: &WideTree, receivers: &[Receiver], size: usize) {
        let growth = &mut self.growth;
        growth.clusters.clear();
        growth.candidates.clear();
        growth.seen.clear();
        growth.seen.extend(receivers.iter().map(|r| tree.seen(r)));
        let roots = growth.open(tree, receivers, 0);
        let mut count = roots as usize;
        while count < size {
            // What brings nothing to any of the receivers stays whole.
            let Some(worst) = growth.candidates.pop().filter(|c| c.bound > 0.0) else {
                break;
            };
            let Grown { block, lane, .. } = growth.clusters[worst.at as usize];
            let Some(child) = tree.blocks[block as usize].clusters[lane as usize].block() else {
                continue;
            };
            let first = growth.clusters.len() as u32;
            let children = growth.open(tree, receivers, child);
            let split = &mut growth.clusters[worst.at as usize];
            (split.first, split.children) = (first, children);
            count += children as usize - 1;
        }
        self.collect(tree, roots);
    }

    /// Copies the clusters of the grown cut, in the tree's order.
    fn collect(&mut self, tree: &WideTree, roots: u32) {
        let Self {
            blocks,
            parallel,
            len,
            growth,
        } = self;
        blocks.clear();
        parallel.clear();
        *len = 0;
        growth.stack.clear();
        growth.stack.extend((0..roots).rev());
        while let Some(at) = growth.stack.pop() {
            let grown = &growth.clusters[at as usize];
            if grown.children > 0 {
                let children = grown.first..grown.first + grown.children;
                growth.stack.extend(children.rev());
                continue;
            }
            let (block, from) = (grown.block as usize, grown.lane as usize);
            let to = *len % WIDTH;
            if to == 0 {
                blocks.push(Block::EMPTY);
                if !tree.parallel.is_empty() {
                    parallel.push([0.0; WIDTH]);
                }
            }
            if let Some(last) = blocks.last_mut() {
                last.take(to, &tree.blocks[block].unpack(), from);
            }
            if let Some(last) = parallel.last_mut() {
                last[to] = tree.parallel[block][from];
            }
            *len += 1;
        }
    }

    /// The `i`-th cluster, `i` below [`len`](Self::len).
    pub fn cluster(&self, i: usize) -> Cluster {
        self.blocks[i / WIDTH].clusters[i % WIDTH]
    }

    /// Number of clusters; 0 before the first refinement.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no cluster.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Works out how much each cluster is expected to bring to `receiver` if nothing is in the way: > 0 wherever any of
    /// its lights brings anything to any point of its [`Region`](crate::Region).
    pub fn weigh(&self, tree: &WideTree, receiver: &Receiver, draws: &mut Draws) {
        tree.weigh_all(&self.blocks, receiver, draws);
        let parallel = self.blocks.iter().zip(&self.parallel);
        let weighed = draws.weights.iter_mut().zip(&mut draws.alike);
        for ((block, parallel), (weights, alike)) in parallel.zip(weighed) {
            block.add_parallel(0, receiver, parallel, weights, alike);
        }
        draws.factors.clear();
        draws.near = 0;
        draws.rows.clear();
        let rows = draws.alike.iter().enumerate();
        draws
            .rows
            .extend(rows.map(|(b, alike)| Row::of_cut(b, alike)));
    }

    /// Draws one light from each of these clusters, with a random number in [0, 1) each, for a point that `draws` was weighed for:
    /// one more in `descents`.
    pub fn pick_within(
        &self,
        tree: &WideTree,
        receiver: &Receiver,
        clusters: impl Iterator<Item = (usize, f64)>,
        draws: &Draws,
        descents: &mut Descents,
    ) {
        descents.add_point(tree, receiver);
        for (i, u) in clusters {
            let pick = Pick {
                cluster: self.cluster(i),
                of: i as u32,
                is_far: draws.rows[i / WIDTH].is_far(i % WIDTH),
                expected: 1.0,
                step: draws.weight(i).into(),
                u,
            };
            descents.pick(tree, pick);
        }
    }

    /// Sees to what all points of the receiver's region have in common when `samples` ≥ 1 lights are drawn for each.
    ///
    /// After [`weigh`](Self::weigh), and after [`Draws::scale`] and [`open`](Self::open) where those are wanted.
    pub fn settle(&self, tree: &WideTree, samples: u32, draws: &mut Draws) {
        draws.settle(self, tree, samples);
    }

    /// Draws so many lights as were [`settled`](Self::settle), or a few more or less, in proportion to their weights, for one more
    /// point in `descents`. `receiver` is the point that was weighed, or one of its region, without a region of its own.
    ///
    /// A light that would be drawn at least once is taken once for certain; the others are drawn at even distances along
    /// the clusters, from a start that `u` in [0, 1) chooses. So numbers `u` that are spread evenly over [0, 1) spread
    /// the lights that they draw evenly over the tree.
    pub fn pick(
        &self,
        tree: &WideTree,
        receiver: &Receiver,
        u: f64,
        draws: &mut Draws,
        descents: &mut Descents,
    ) {
        draws.pick(self, tree, receiver, u, descents);
    }

    /// [`pick`](Self::pick) for one point alone, to the end.
    pub fn draw<'a>(
        &self,
        tree: &WideTree,
        receiver: &Receiver,
        u: f64,
        draws: &mut Draws,
        descents: &'a mut Descents,
    ) -> &'a [Option<Drawn>] {
        descents.clear();
        self.pick(tree, receiver, u, draws, descents);
        descents.descend(tree);
        descents.drawn(0)
    }
}

impl Growth {
    /// Adds the clusters of a block; returns how many.
    fn open(&mut self, tree: &WideTree, receivers: &[Receiver], block: usize) -> u32 {
        let bounds = tree.bounds(block, receivers, &self.seen);
        let clusters = &tree.blocks[block].clusters;
        let count = tree.blocks[block].len();
        for (lane, bound) in bounds.into_iter().enumerate().take(count) {
            if clusters[lane].block().is_some() {
                self.candidates.push(Candidate {
                    bound,
                    at: self.clusters.len() as u32,
                });
            }
            self.clusters.push(Grown {
                block: block as u32,
                lane: lane as u32,
                first: 0,
                children: 0,
            });
        }
        count as u32
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sampling::{Purpose, Rng};

    use super::*;
    use crate::lights::LightSet;
    use crate::select::BELOW_ONE;
    use crate::test_lights::{
        any_lights, any_receiver, contribution, lights_on_walls, receiver, wide,
    };

    const PLACES: [(Vec3, Vec3); 3] = [
        (Vec3::new(0.1, -0.9, 0.2), Vec3::Y),
        (Vec3::new(-1.0, 0.3, 0.3), Vec3::X),
        (Vec3::new(0.2, 0.97, -0.8), Vec3::NEG_Z),
    ];

    #[test]
    fn a_cut_leaves_no_light_out() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let Some(tree) = wide(&lights) else {
                return Ok(());
            };
            let receivers: Vec<_> = (0..u.int_in_range(0..=3)?)
                .map(|_| Ok(receiver(any_receiver(u, &lights)?)))
                .collect::<verify::arbitrary::Result<_>>()?;
            let mut cut = SharedCut::default();
            let size = u.int_in_range(1..=40)?;
            cut.refine(&tree, &receivers, size);
            assert!(cut.len() < size + WIDTH, "{} clusters of {size}", cut.len());
            let mut seen = vec![0; lights.len()];
            for i in 0..cut.len() {
                for light in tree.lights_below(cut.cluster(i)) {
                    seen[light.index()] += 1;
                }
            }
            assert!(seen.iter().all(|&times| times == 1), "{seen:?}");
            Ok(())
        });
    }

    #[test]
    fn lights_are_drawn_as_often_as_expected() {
        let lights = lights_on_walls(150);
        let tree = wide(&lights).expect("has lights");
        let rounds = 20_000;
        for at in PLACES {
            for (size, samples) in [(1, 3), (20, 10), (150, 40)] {
                let mut cut = SharedCut::default();
                cut.refine(&tree, &[receiver(PLACES[0])], size);
                let (mut draws, mut descents) = (Draws::default(), Descents::default());
                let mut rng = Rng::new(1, 0, 0, Purpose::Lights);
                let mut times = vec![0u32; lights.len()];
                let mut expected = vec![None; lights.len()];
                for _ in 0..rounds {
                    cut.weigh(&tree, &receiver(at), &mut draws);
                    cut.settle(&tree, samples, &mut draws);
                    let drawn =
                        cut.draw(&tree, &receiver(at), rng.f64(), &mut draws, &mut descents);
                    for drawn in drawn.iter().flatten() {
                        times[drawn.light.index()] += 1;
                        let known = expected[drawn.light.index()].get_or_insert(drawn.expected);
                        assert!(
                            (*known / drawn.expected - 1.0).abs() < 1e-9,
                            "{drawn:?} and {known}"
                        );
                    }
                }
                for (id, (&times, expected)) in times.iter().zip(expected).enumerate() {
                    let Some(expected) = expected else { continue };
                    // A count of this mean whose variance is at most binomial; 5.5 sigma for 1350 counts, false alarm 5e-5.
                    let mean = expected * f64::from(rounds);
                    let z = (f64::from(times) - mean) / mean.sqrt().max(1.0);
                    assert!(
                        z.abs() < 5.5,
                        "light {id} at {at:?}: {times} times instead of {mean}"
                    );
                }
            }
        }
    }

    #[test]
    fn sums_over_drawn_lights_average_to_the_sum_over_all() {
        let lights = lights_on_walls(400);
        let tree = wide(&lights).expect("has lights");
        for at in PLACES {
            let exact: f64 = lights
                .ids()
                .map(|id| contribution(&lights, id, at.0, at.1))
                .sum();
            for size in [1, 60] {
                let mut cut = SharedCut::default();
                cut.refine(&tree, &[receiver(PLACES[1])], size);
                let (mut draws, mut descents) = (Draws::default(), Descents::default());
                let mut rng = Rng::new(2, 0, 0, Purpose::Lights);
                let (mut sum, mut squares) = (0.0, 0.0);
                let rounds = 20_000;
                for _ in 0..rounds {
                    cut.weigh(&tree, &receiver(at), &mut draws);
                    cut.settle(&tree, 5, &mut draws);
                    let estimate: f64 = cut
                        .draw(&tree, &receiver(at), rng.f64(), &mut draws, &mut descents)
                        .iter()
                        .flatten()
                        .map(|d| contribution(&lights, d.light, at.0, at.1) / d.expected)
                        .sum();
                    sum += estimate;
                    squares += estimate * estimate;
                }
                let n = f64::from(rounds);
                let mean = sum / n;
                let deviation = ((squares / n - mean * mean) / n).sqrt();
                // 4.5 sigma over 6 cases: false alarm 4e-5.
                let z = (mean - exact) / deviation;
                assert!(
                    z.abs() < 4.5,
                    "{mean} instead of {exact} at {at:?}, z = {z}"
                );
            }
        }
    }

    #[test]
    fn as_many_samples_as_lights_draw_each_light_once() {
        let mut lights = LightSet::default();
        for i in 0..10 {
            let power = 10.0f32.powi(i % 5 - 2);
            lights.push_point(Vec3::new(i as f32, 2.0, 0.5), Vec3::splat(power));
        }
        let tree = wide(&lights).expect("has lights");
        let at = receiver((Vec3::ZERO, Vec3::Y));
        let mut cut = SharedCut::default();
        cut.refine(&tree, &[at], 64);
        let (mut draws, mut descents) = (Draws::default(), Descents::default());
        for u in [0.0, 0.3, BELOW_ONE] {
            cut.weigh(&tree, &at, &mut draws);
            cut.settle(&tree, 10, &mut draws);
            let drawn = cut.draw(&tree, &at, u, &mut draws, &mut descents);
            let mut ids: Vec<_> = drawn.iter().flatten().map(|d| d.light.0).collect();
            ids.sort_unstable();
            assert_eq!(ids, (0..10).collect::<Vec<_>>(), "u = {u}");
            assert!(
                drawn.iter().flatten().all(|d| d.expected == 1.0),
                "all for certain"
            );
        }
    }

    #[test]
    fn a_dominating_light_is_drawn_once_and_leaves_the_samples_to_the_others() {
        let mut lights = lights_on_walls(0);
        lights.push_point(Vec3::new(0.0, 1.0, 0.0), Vec3::splat(1e4));
        for i in 0..100 {
            lights.push_point(Vec3::new(i as f32, 2.0, 0.5), Vec3::ONE);
        }
        let tree = wide(&lights).expect("has lights");
        let at = receiver((Vec3::ZERO, Vec3::Y));
        let mut cut = SharedCut::default();
        cut.refine(&tree, &[at], 128);
        let (mut draws, mut descents) = (Draws::default(), Descents::default());
        cut.weigh(&tree, &at, &mut draws);
        cut.settle(&tree, 10, &mut draws);
        let drawn = cut.draw(&tree, &at, 0.5, &mut draws, &mut descents);
        let bright = drawn.iter().flatten().filter(|d| d.light.0 == 0).count();
        assert_eq!(bright, 1, "{drawn:?}");
        assert!(drawn.len() >= 10, "{drawn:?}");
    }

    #[test]
    fn evenly_spread_numbers_spread_the_lights() {
        let lights = lights_on_walls(2000);
        let tree = wide(&lights).expect("has lights");
        let at = PLACES[0];
        let mut cut = SharedCut::default();
        cut.refine(&tree, &[receiver(at)], 100);
        let (mut draws, mut descents) = (Draws::default(), Descents::default());
        let mut rng = Rng::new(3, 0, 0, Purpose::Lights);
        let mut estimate = |u: f64| -> f64 {
            cut.weigh(&tree, &receiver(at), &mut draws);
            cut.settle(&tree, 10, &mut draws);
            cut.draw(&tree, &receiver(at), u, &mut draws, &mut descents)
                .iter()
                .flatten()
                .map(|d| contribution(&lights, d.light, at.0, at.1) / d.expected)
                .sum()
        };
        let exact: f64 = lights
            .ids()
            .map(|id| contribution(&lights, id, at.0, at.1))
            .sum();
        let (mut even, mut random) = (0.0, 0.0);
        for _ in 0..200 {
            let shift = rng.f64();
            let mean = |sum: f64| (sum / 64.0 / exact - 1.0).powi(2);
            even += mean(
                (0..64)
                    .map(|i| estimate((f64::from(i) + shift) / 64.0))
                    .sum(),
            );
            random += mean((0..64).map(|_| estimate(rng.f64())).sum());
        }
        assert!(even * 4.0 < random, "squared errors {even} and {random}");
    }
}
