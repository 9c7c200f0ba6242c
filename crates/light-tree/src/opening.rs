//! Clusters that are too near, or too much in the mirror direction, for one point to be weighed as a whole.
//!
//! A cut that many points share cannot be fine about each of them. Where a point lies in a cluster's box, or its lobe is
//! narrower than the box, most of the light may come from a few of the cluster's lights, a hundred times what it is expected to
//! be. Such clusters are taken apart for that point alone, and what it draws begins further down.

use crate::block::{Cluster, Lanes, Seen, WIDTH, Weighed};
use crate::bounds::Receiver;
use crate::draws::Draws;
use crate::shared_cut::SharedCut;
use crate::wide::{WideTree, by_width};

/// Blocks that are opened for a point, at most; for many together up to eight times as many.
const MOST: u32 = 64;
/// A cluster is opened from which more lights than this are to be drawn for all points together: what its parts weigh is then
/// worked out once rather than at each descent.
const MANY: f64 = 3.0;
/// Weights that may be so many times too low for another point of the region are worked out for each point.
const NEAR: f32 = 4.0;
/// So much of one sample's worth may be too low without harm.
const HARMLESS: f32 = 0.25;

/// Eight clusters that are weighed together: a block of the cut, or one of the tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Row {
    block: u32,
    /// Of the cut: the only one that a block of the tree is a part of, or the first of a block of the cut.
    cluster: u32,
    /// Clusters whose lights are alike, bit by bit: see [`Weighed::alike`].
    alike: u8,
}

/// Set in the block of a [`Row`] of the tree.
const OF_TREE: u32 = 1 << 31;

impl Row {
    pub(crate) fn of_cut(block: usize, alike: &Lanes) -> Self {
        Self {
            block: block as u32,
            cluster: (block * WIDTH) as u32,
            alike: bits_of(alike),
        }
    }

    /// Whether lights of the cluster in `lane` are drawn by their intensities alone.
    #[inline]
    pub(crate) fn is_far(self, lane: usize) -> bool {
        self.alike >> lane & 1 != 0
    }

    /// The block of the tree that it is, if it is one.
    #[inline]
    fn tree_block(self) -> Option<usize> {
        (self.block & OF_TREE != 0).then_some((self.block & !OF_TREE) as usize)
    }

    /// The cluster of the cut that holds what is in `lane`.
    #[inline]
    pub(crate) fn cluster(self, lane: usize) -> u32 {
        match self.tree_block() {
            None => self.cluster + lane as u32,
            Some(_) => self.cluster,
        }
    }
}

/// Lanes > 0, bit by bit.
#[inline(always)]
fn bits_of(lanes: &Lanes) -> u8 {
    let mut bits = 0;
    for (lane, &value) in lanes.iter().enumerate() {
        bits |= u8::from(value > 0.0) << lane;
    }
    bits
}

/// Memory of the opening.
#[derive(Debug, Default)]
pub(crate) struct Opening {
    far: Vec<(Row, Lanes)>,
    near: Vec<(Row, Lanes)>,
    /// Rows to come.
    stack: Vec<Row>,
    /// How many may be opened yet.
    left: u32,
}

/// When a cluster is opened.
#[derive(Debug, Clone, Copy)]
struct Bar {
    /// Above this were all its lights where they bring most.
    peak: f32,
    /// Above this as it is.
    weight: f32,
}

impl SharedCut {
    /// Opens clusters that would weigh more than one of `samples` ≥ 1 samples is worth, were all their lights where they
    /// bring most to `receiver`, or to any point that it stands for: at the nearest corner, in the middle of its lobe. And
    /// those from which more than a few lights are to be drawn for `points` ≥ 1 points together.
    ///
    /// After [`weigh`](Self::weigh), and after [`Draws::scale`], if at all: what a cluster holds has the factor of the
    /// cluster.
    pub fn open(
        &self,
        tree: &WideTree,
        receiver: &Receiver,
        samples: u32,
        points: u32,
        draws: &mut Draws,
    ) {
        let worth = draws.total() / f64::from(samples.max(1));
        let bar = Bar {
            peak: worth as f32,
            weight: (worth * MANY / f64::from(points.max(1))) as f32,
        };
        if bar.weight > 0.0 {
            tree.open_all(self, receiver, bar, MOST * points.clamp(1, 8), draws);
        }
    }

    /// Weighs the rows that are near anew, for `receiver`.
    pub(crate) fn weigh_near(&self, tree: &WideTree, receiver: &Receiver, draws: &mut Draws) {
        by_width!(
            self.weigh_near_avx512(tree, receiver, draws),
            self.weigh_near_avx2(tree, receiver, draws),
            self.weigh_near_with(tree, receiver, draws)
        )
    }

    /// The same code and the same bits, for wider registers.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn weigh_near_avx512(&self, tree: &WideTree, receiver: &Receiver, draws: &mut Draws) {
        self.weigh_near_with(tree, receiver, draws);
    }

    /// The same code and the same bits, eight lanes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn weigh_near_avx2(&self, tree: &WideTree, receiver: &Receiver, draws: &mut Draws) {
        self.weigh_near_with(tree, receiver, draws);
    }

    #[inline(always)]
    fn weigh_near_with(&self, tree: &WideTree, receiver: &Receiver, draws: &mut Draws) {
        let seen = tree.seen(receiver);
        for i in draws.rows.len() - draws.near..draws.rows.len() {
            let row = draws.rows[i];
            let mut weights = match row.tree_block() {
                Some(block) => tree.weights::<false>(block, receiver, &seen).weights,
                None => self.weights(tree, row.block as usize, receiver, &seen),
            };
            for (lane, weight) in weights.iter_mut().enumerate() {
                // What was opened has rows of its own, and what is dark is so for the whole region.
                if draws.weights[i][lane] == 0.0 {
                    *weight = 0.0;
                }
                if let Some(factor) = draws.factors.get(row.cluster(lane) as usize) {
                    *weight *= factor;
                }
            }
            draws.left[i] = weights;
        }
    }

    /// Weights of the clusters of a block of the cut.
    #[inline(always)]
    fn weights(&self, tree: &WideTree, block: usize, receiver: &Receiver, seen: &Seen) -> Lanes {
        let (own, parallel) = (&self.blocks[block], self.parallel.get(block));
        tree.weigh_whole::<false, false>(own, parallel, receiver, seen)
            .weights
    }

    /// The clusters of a row.
    #[inline(always)]
    pub(crate) fn clusters<'a>(&'a self, tree: &'a WideTree, row: Row) -> &'a [Cluster; WIDTH] {
        match row.tree_block() {
            None => &self.blocks[row.block as usize].clusters,
            Some(block) => &tree.blocks[block].clusters,
        }
    }
}

impl WideTree {
    fn open_all(
        &self,
        cut: &SharedCut,
        receiver: &Receiver,
        bar: Bar,
        most: u32,
        draws: &mut Draws,
    ) {
        by_width!(
            self.open_avx512(cut, receiver, bar, most, draws),
            self.open_avx2(cut, receiver, bar, most, draws),
            self.open(cut, receiver, bar, most, draws)
        )
    }

    /// The same code and the same bits, for wider registers.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn open_avx512(
        &self,
        cut: &SharedCut,
        receiver: &Receiver,
        bar: Bar,
        most: u32,
        draws: &mut Draws,
    ) {
        self.open(cut, receiver, bar, most, draws);
    }

    /// The same code and the same bits, eight lanes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn open_avx2(
        &self,
        cut: &SharedCut,
        receiver: &Receiver,
        bar: Bar,
        most: u32,
        draws: &mut Draws,
    ) {
        self.open(cut, receiver, bar, most, draws);
    }

    /// Rows of children follow the row of their parent, so that neighbours in space stay neighbours in the list. Behind all
    /// others are those that are near.
    #[inline(always)]
    fn open(&self, cut: &SharedCut, receiver: &Receiver, bar: Bar, most: u32, draws: &mut Draws) {
        let seen = self.seen(receiver);
        let opening = &mut draws.opening;
        opening.far.clear();
        opening.near.clear();
        opening.left = most;
        for (b, &weights) in draws.weights.iter().enumerate() {
            let weighed = Weighed {
                weights,
                peaks: draws.peaks[b],
                swings: draws.swings[b],
                alike: draws.alike[b],
            };
            opening.push(draws.rows[b], &cut.blocks[b].clusters, weighed, bar);
            while let Some(mut row) = opening.stack.pop() {
                let Some(block) = row.tree_block() else {
                    continue;
                };
                let mut weighed = match seen.region {
                    Some(_) => self.weights::<true>(block, receiver, &seen),
                    None => self.weights::<false>(block, receiver, &seen),
                };
                if let Some(factor) = draws.factors.get(row.cluster as usize) {
                    for lane in 0..WIDTH {
                        weighed.weights[lane] *= factor;
                        weighed.peaks[lane] *= factor;
                    }
                }
                row.alike = bits_of(&weighed.alike);
                opening.push(row, &self.blocks[block].clusters, weighed, bar);
            }
        }
        draws.near = opening.near.len();
        draws.weights.clear();
        draws.rows.clear();
        for (row, weights) in opening.far.iter().chain(&opening.near) {
            draws.weights.push(*weights);
            draws.rows.push(*row);
        }
    }
}

impl Opening {
    /// Adds a row, without its clusters above the bar: what they hold is added next.
    #[inline(always)]
    fn push(&mut self, row: Row, clusters: &[Cluster; WIDTH], weighed: Weighed, bar: Bar) {
        let Weighed {
            mut weights,
            peaks,
            swings,
            ..
        } = weighed;
        let mut any = false;
        for lane in 0..WIDTH {
            any |= (peaks[lane] > bar.peak) | (weights[lane] > bar.weight);
        }
        if any {
            for lane in (0..WIDTH).rev() {
                if (peaks[lane] > bar.peak || weights[lane] > bar.weight)
                    && let Some(child) = clusters[lane].block()
                    && self.left > 0
                {
                    self.left -= 1;
                    weights[lane] = 0.0;
                    self.stack.push(Row {
                        block: child as u32 | OF_TREE,
                        cluster: row.cluster(lane),
                        alike: 0,
                    });
                }
            }
        }
        let mut is_near = false;
        for lane in 0..WIDTH {
            is_near |=
                (weights[lane] > 0.0) & (swings[lane] > NEAR) & (peaks[lane] > HARMLESS * bar.peak);
        }
        match is_near {
            true => self.near.push((row, weights)),
            false => self.far.push((row, weights)),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sampling::{Purpose, Rng, ggx_density};

    use super::*;
    use crate::descent::Descents;
    use crate::lobe::Lobe;
    use crate::test_lights::{
        any_lights, any_receiver, contribution, lights_on_walls, receiver, wide,
    };

    /// Close to the floor and to a wall, so within the boxes of clusters that hold both.
    const CORNER: (Vec3, Vec3) = (Vec3::new(-0.99, -0.97, 0.2), Vec3::X);

    fn lobe(axis: Vec3, alpha2: f32) -> Lobe {
        Lobe {
            axis,
            diffuse: 0.02,
            near: 0.25,
            far: 0.0,
            far_sin2: 1.0,
            alpha2,
        }
    }

    #[test]
    fn opened_rows_hold_each_light_once() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let Some(tree) = wide(&lights) else {
                return Ok(());
            };
            let at = receiver(any_receiver(u, &lights)?);
            let mut cut = SharedCut::default();
            cut.refine(&tree, &[at], u.int_in_range(1..=8)?);
            let mut draws = Draws::default();
            cut.weigh(&tree, &at, &mut draws);
            let lit = draws.total() > 0.0;
            cut.open(&tree, &at, 10, 1, &mut draws);
            // The other way round it may be: a box reaches above the horizon, and none of its lights does.
            assert!(lit || draws.total() == 0.0, "light out of nothing");
            let rows: Vec<_> = draws
                .rows
                .iter()
                .map(|&row| cut.clusters(&tree, row))
                .collect();
            // What was opened stands in a row of its own.
            let is_opened = |cluster: &&Cluster| {
                let child = cluster.block().map(|block| &tree.blocks[block].clusters);
                child.is_some_and(|child| rows.iter().any(|&row| std::ptr::eq(row, child)))
            };
            let mut seen = vec![0; lights.len()];
            for (row, clusters) in draws.rows.iter().zip(&rows) {
                let used = clusters.iter().enumerate().filter(|(_, c)| !c.is_unused());
                for (lane, cluster) in used.filter(|(_, cluster)| !is_opened(cluster)) {
                    let all = tree.lights_below(cut.cluster(row.cluster(lane) as usize));
                    for light in tree.lights_below(*cluster) {
                        assert!(all.contains(&light), "of another cluster of the cut");
                        seen[light.index()] += 1;
                    }
                }
            }
            assert!(seen.iter().all(|&times| times == 1), "{seen:?}");
            Ok(())
        });
    }

    /// Mean, its standard deviation, and the relative variance of one estimate of what all lights bring.
    fn estimate(
        cut: &SharedCut,
        tree: &WideTree,
        x: &Receiver,
        closely: bool,
        brings: impl Fn(crate::LightId) -> f64,
    ) -> (f64, f64, f64) {
        let rounds = 20_000;
        let (mut draws, mut descents) = (Draws::default(), Descents::default());
        let mut rng = Rng::new(5, 0, 0, Purpose::Lights);
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..rounds {
            cut.weigh(tree, x, &mut draws);
            if closely {
                cut.open(tree, x, 5, 1, &mut draws);
            }
            cut.settle(tree, 5, &mut draws);
            let drawn = cut.draw(tree, x, rng.f64(), &mut draws, &mut descents);
            let drawn = drawn.iter().flatten();
            let value: f64 = drawn.map(|d| brings(d.light) / d.expected).sum();
            sum += value;
            squares += value * value;
        }
        let n = f64::from(rounds);
        let mean = sum / n;
        let variance = squares / n - mean * mean;
        (mean, (variance / n).sqrt(), variance / (mean * mean))
    }

    #[test]
    fn a_point_among_a_clusters_lights_finds_the_near_ones() {
        let lights = lights_on_walls(4000);
        let tree = wide(&lights).expect("has lights");
        let x = receiver(CORNER);
        let brings = |id| contribution(&lights, id, CORNER.0, CORNER.1);
        let exact: f64 = lights.ids().map(brings).sum();
        let mut cut = SharedCut::default();
        // Made for a point far off.
        cut.refine(
            &tree,
            &[receiver((Vec3::new(0.5, 0.9, -0.5), Vec3::NEG_Y))],
            24,
        );
        let [shared, opened] =
            [false, true].map(|closely| estimate(&cut, &tree, &x, closely, brings));
        for (mean, deviation, _) in [shared, opened] {
            // 4.5 sigma for two: false alarm 1.4e-5.
            let z = (mean - exact) / deviation;
            assert!(z.abs() < 4.5, "{mean} instead of {exact}, z = {z}");
        }
        assert!(
            opened.2 * 2.0 < shared.2,
            "variances {} and {}",
            opened.2,
            shared.2
        );
    }

    #[test]
    fn a_lobe_finds_the_lights_that_it_mirrors() {
        let lights = lights_on_walls(4000);
        let tree = wide(&lights).expect("has lights");
        let at = (Vec3::new(0.3, -0.9, 0.1), Vec3::Y);
        for alpha2 in [0.25f32, 0.01, 1e-4] {
            let lobe = lobe(Vec3::new(0.6, 0.8, 0.0), alpha2);
            let x = receiver(at).with_lobe(lobe);
            let brings = |id| {
                let to = (lights.position(id) - at.0).normalize();
                let mirrored =
                    lobe.near * ggx_density(alpha2, to.distance_squared(lobe.axis) / 4.0);
                let cos = at.1.dot(to).max(1e-9);
                contribution(&lights, id, at.0, at.1) * f64::from(lobe.diffuse + mirrored / cos)
            };
            let exact: f64 = lights.ids().map(brings).sum();
            let mut cut = SharedCut::default();
            cut.refine(&tree, &[x], 64);
            let with = estimate(&cut, &tree, &x, true, brings);
            // 4.5 sigma for three: false alarm 2e-5.
            let z = (with.0 - exact) / with.1;
            assert!(z.abs() < 4.5, "{} instead of {exact}, z = {z}", with.0);
            let without = estimate(&cut, &tree, &receiver(at), true, brings);
            assert!(
                with.2 < 0.35 && with.2 < without.2,
                "roughness² {alpha2}: variances {} and {} without the lobe",
                with.2,
                without.2
            );
        }
    }

    #[test]
    fn wide_and_narrow_instructions_open_the_same() {
        let lights = lights_on_walls(3000);
        let tree = wide(&lights).expect("has lights");
        let lobe = lobe(Vec3::new(0.6, 0.0, 0.8), 0.01);
        for x in [receiver(CORNER), receiver(CORNER).with_lobe(lobe)] {
            let mut cut = SharedCut::default();
            cut.refine(&tree, &[x], 16);
            let mut all = [false, true].map(|plain| {
                let mut draws = Draws::default();
                cut.weigh(&tree, &x, &mut draws);
                let peak = draws.total() as f32 / 10.0;
                let bar = Bar {
                    peak,
                    weight: 0.1 * peak,
                };
                match plain {
                    true => tree.open(&cut, &x, bar, 99, &mut draws),
                    false => tree.open_all(&cut, &x, bar, 99, &mut draws),
                }
                draws
            });
            let [plain, fast] = &mut all;
            assert!(
                plain.rows.len() > cut.len().div_ceil(WIDTH),
                "some are opened"
            );
            assert_eq!(plain.rows, fast.rows, "rows");
            assert_eq!(plain.weights, fast.weights, "weights");
        }
    }
}
