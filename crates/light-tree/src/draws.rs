//! What lights are drawn by.

use std::ops::Range;

use crate::block::{Lanes, WIDTH};
use crate::bounds::Receiver;
use crate::descent::{Descents, Drawn, Pick, lane_at, running_sums};
use crate::opening::{Opening, Row};
use crate::shared_cut::SharedCut;
use crate::wide::{WideTree, by_width};

/// What the lights of one receiver, or of those that it stands for, are drawn by; memory is kept from receiver to receiver.
#[derive(Debug, Default)]
pub struct Draws {
    pub(crate) weights: Vec<Lanes>,
    /// What the weights belong to.
    pub(crate) rows: Vec<Row>,
    /// What the cut's clusters would weigh, were all their lights where they bring most.
    pub(crate) peaks: Vec<Lanes>,
    /// How many times as much they may bring to another point of the receiver's region.
    pub(crate) swings: Vec<Lanes>,
    /// Where lights of the cut's clusters are [alike](crate::block::Weighed::alike).
    pub(crate) alike: Vec<Lanes>,
    /// What the cut's clusters were multiplied by; empty for nothing.
    pub(crate) factors: Vec<f32>,
    pub(crate) opening: Opening,
    /// So many of the rows, the last, are weighed anew for each point.
    pub(crate) near: usize,
    /// Weights of all from which lights are drawn by chance.
    pub(crate) left: Vec<Lanes>,
    /// Running sums of these, row by row.
    sums: Vec<f64>,
    settled: Settled,
}

/// What all points have in common: the rows that are not near.
#[derive(Debug, Default)]
struct Settled {
    /// Lights that are drawn for certain.
    certain: Vec<Drawn>,
    /// Sum of the weights of the others.
    total: f64,
    /// Lights to be drawn besides.
    samples: u32,
}

impl Draws {
    /// What the `i`-th cluster is expected to bring, after [`SharedCut::weigh`].
    pub fn weight(&self, i: usize) -> f32 {
        self.weights[i / WIDTH][i % WIDTH]
    }

    /// Multiplies the weights by `factors`, > 0, one for each cluster, or none at all.
    pub fn scale(&mut self, factors: &[f32]) {
        self.factors.clear();
        self.factors.extend_from_slice(factors);
        let lanes = self.weights.iter_mut().zip(&mut self.peaks);
        for ((weights, peaks), factors) in lanes.zip(factors.chunks(WIDTH)) {
            for (lane, factor) in factors.iter().enumerate() {
                weights[lane] *= factor;
                peaks[lane] *= factor;
            }
        }
    }

    /// Sum of the weights.
    pub(crate) fn total(&self) -> f64 {
        self.weights.iter().map(sum_of).sum()
    }

    /// [`SharedCut::settle`].
    pub(crate) fn settle(&mut self, cut: &SharedCut, tree: &WideTree, samples: u32) {
        self.left.clone_from(&self.weights);
        self.settled.certain.clear();
        self.settled.samples = samples.max(1);
        let far = 0..self.rows.len() - self.near;
        let near: f64 = self.left[far.end..].iter().map(sum_of).sum();
        loop {
            self.settled.total = self.sum(far.clone(), 0.0);
            let Settled {
                certain,
                total,
                samples,
            } = &mut self.settled;
            if *total <= 0.0 {
                return;
            }
            let bar = (*total + near) / f64::from(*samples);
            let rows = self.rows[far.clone()].iter().zip(&mut self.left);
            let taken = take_certain(cut, tree, rows, bar, |drawn| certain.push(drawn));
            if taken == 0 {
                return;
            }
            // Taking some out lowers the bar for the others. What is left has a weight, and so needs a sample.
            *samples = samples.saturating_sub(taken).max(1);
        }
    }

    /// [`SharedCut::pick`].
    pub(crate) fn pick(
        &mut self,
        cut: &SharedCut,
        tree: &WideTree,
        receiver: &Receiver,
        u: f64,
        descents: &mut Descents,
    ) {
        by_width!(
            self.pick_avx512(cut, tree, receiver, u, descents),
            self.pick_avx2(cut, tree, receiver, u, descents),
            self.pick_with(cut, tree, receiver, u, descents)
        )
    }

    /// The same code and the same bits, sixteen picks to two instructions.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn pick_avx512(
        &mut self,
        cut: &SharedCut,
        tree: &WideTree,
        receiver: &Receiver,
        u: f64,
        descents: &mut Descents,
    ) {
        self.pick_with(cut, tree, receiver, u, descents);
    }

    /// The same code and the same bits, sixteen picks to four instructions.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn pick_avx2(
        &mut self,
        cut: &SharedCut,
        tree: &WideTree,
        receiver: &Receiver,
        u: f64,
        descents: &mut Descents,
    ) {
        self.pick_with(cut, tree, receiver, u, descents);
    }

    #[inline(always)]
    pub(crate) fn pick_with(
        &mut self,
        cut: &SharedCut,
        tree: &WideTree,
        receiver: &Receiver,
        u: f64,
        descents: &mut Descents,
    ) {
        descents.add_point(tree, receiver);
        for &certain in &self.settled.certain {
            descents.take(certain);
        }
        let near = self.rows.len() - self.near..self.rows.len();
        if !near.is_empty() {
            cut.weigh_near(tree, receiver, self);
        }
        let mut samples = self.settled.samples;
        loop {
            let total = self.sum(near.clone(), self.settled.total);
            if total <= 0.0 {
                return;
            }
            let step = total / f64::from(samples);
            let rows = self.rows[near.clone()]
                .iter()
                .zip(&mut self.left[near.clone()]);
            let taken = take_certain(cut, tree, rows, step, |drawn| descents.take(drawn));
            if taken == 0 {
                self.pick_evenly(cut, tree, samples, u, step, descents);
                return;
            }
            samples = samples.saturating_sub(taken).max(1);
        }
    }

    /// Sums up what is left of `rows`, on from `sum`, which those before have.
    #[inline(always)]
    fn sum(&mut self, rows: Range<usize>, mut sum: f64) -> f64 {
        self.sums.truncate(rows.start);
        for weights in &self.left[rows] {
            sum += sum_of(weights);
            self.sums.push(sum);
        }
        sum
    }

    /// Picks clusters at distances `step` along their weights.
    #[inline(always)]
    fn pick_evenly(
        &self,
        cut: &SharedCut,
        tree: &WideTree,
        count: u32,
        u: f64,
        step: f64,
        descents: &mut Descents,
    ) {
        // Below the sum also where the product rounds up to it: behind it there may be nothing with a weight.
        let end = self.sums.last().map_or(0.0, |sum| sum.next_down());
        for first in (0..count).step_by(TOGETHER) {
            let mut at = [0.0; TOGETHER];
            for (k, at) in at.iter_mut().enumerate() {
                *at = ((f64::from(first + k as u32) + u) * step).min(end);
            }
            let rows = rows_at(&self.sums, &at);
            let together = TOGETHER.min((count - first) as usize);
            for k in 0..together {
                let block = rows[k] as usize;
                let before = match block {
                    0 => 0.0,
                    _ => self.sums[block - 1],
                };
                let weights = &self.left[block];
                let (lane, w, u) = lane_at(weights, &running_sums(weights), at[k] - before);
                let row = self.rows[block];
                descents.pick(
                    tree,
                    Pick {
                        cluster: cut.clusters(tree, row)[lane],
                        of: row.cluster(lane),
                        is_far: row.is_far(lane),
                        expected: w / step,
                        step,
                        u,
                    },
                );
            }
        }
    }
}

/// Picks that are looked for at once.
const TOGETHER: usize = 16;
/// Rows up to which comparing with all takes less than halving, whose every step waits for the one before.
const FEW: usize = 256;

/// In which row each of these places lies: the first whose running sum is beyond it.
#[inline(always)]
fn rows_at(sums: &[f64], at: &[f64; TOGETHER]) -> [u64; TOGETHER] {
    let mut rows = [0; TOGETHER];
    if sums.len() > FEW {
        for k in 0..TOGETHER {
            rows[k] = sums.partition_point(|&sum| sum <= at[k]) as u64;
        }
        return rows;
    }
    for &sum in sums {
        for k in 0..TOGETHER {
            rows[k] += u64::from(sum <= at[k]);
        }
    }
    rows
}

/// Eight at a time in `f32`: a share of 10⁻⁷ lost in one block is lost for good, but to the same extent in the choice within the
/// block, which is made by the weights themselves.
fn sum_of(weights: &Lanes) -> f64 {
    running_sums(weights)[WIDTH - 1]
}

/// Takes every single light whose weight is at least `bar`, and says how many there were.
fn take_certain<'a>(
    cut: &SharedCut,
    tree: &WideTree,
    rows: impl Iterator<Item = (&'a Row, &'a mut Lanes)>,
    bar: f64,
    mut take: impl FnMut(Drawn),
) -> u32 {
    let mut taken = 0;
    for (row, weights) in rows {
        if weights.iter().all(|&w| f64::from(w) < bar) {
            continue;
        }
        let clusters = cut.clusters(tree, *row);
        for (lane, (w, cluster)) in weights.iter_mut().zip(clusters).enumerate() {
            if f64::from(*w) >= bar
                && let Some(light) = cluster.light()
            {
                taken += 1;
                take(Drawn {
                    light,
                    expected: 1.0,
                    cluster: row.cluster(lane),
                    weight: f64::from(*w),
                });
                *w = 0.0;
            }
        }
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_found_in_the_row_whose_sum_is_the_first_beyond_them() {
        for count in [1, 7, FEW, FEW + 1] {
            // Every other row is empty.
            let sums: Vec<f64> = (0..count).map(|i| (i / 2 + 1) as f64).collect();
            let mut at = [0.0; TOGETHER];
            for (k, at) in at.iter_mut().enumerate() {
                *at = 0.25 * k as f64 * sums[count - 1] / 4.0;
            }
            let found = rows_at(&sums, &at);
            for (at, row) in at.iter().zip(found) {
                let expected = sums.iter().filter(|sum| *sum <= at).count();
                assert_eq!(row as usize, expected, "{at} in {count} rows");
            }
        }
    }
}
