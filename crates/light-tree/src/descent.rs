//! Descents through an eight-way tree: one light from each of many clusters.

use crate::block::{Lanes, Seen, WIDTH};
use crate::bounds::Receiver;
use crate::draws::{Drawn, Draws, Pick};
use crate::prefetch::prefetch;
use crate::select::BELOW_ONE;
use crate::wide::{WideTree, by_width};

/// Descents under way; memory is kept from receiver to receiver.
#[derive(Debug, Default)]
pub(crate) struct Descents {
    /// Where clusters are weighed.
    near: Vec<Pick>,
    /// Where only intensities tell lights apart.
    far: Vec<Pick>,
    shares: Vec<Shares>,
    chosen: Vec<Chosen>,
}

/// What lights of a block's clusters are drawn by.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shares {
    pub(crate) weights: Lanes,
    /// As [`Weighed::alike`](crate::block::Weighed::alike).
    pub(crate) alike: Lanes,
}

/// A lane of a block that was chosen.
#[derive(Debug, Clone, Copy)]
struct Chosen {
    lane: usize,
    /// No number, or 0, where the block is dark.
    pmf: f64,
    /// What is left of the random number, in [0, 1).
    u: f64,
}

impl WideTree {
    /// Draws one light for each of the picks, all descending side by side so that the memory latencies of one hide
    /// behind the others'. A cluster of weight `step` is picked once on average.
    pub(crate) fn descend_all(&self, receiver: &Receiver, step: f64, draws: &mut Draws) {
        by_width!(
            self.descend_all_avx2(receiver, step, draws),
            self.descend_all_with(receiver, step, draws)
        )
    }

    /// The same code and the same bits, eight lanes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn descend_all_avx2(&self, receiver: &Receiver, step: f64, draws: &mut Draws) {
        self.descend_all_with(receiver, step, draws);
    }

    #[inline(always)]
    fn descend_all_with(&self, receiver: &Receiver, step: f64, draws: &mut Draws) {
        let Draws {
            picks,
            lights,
            dead,
            descents,
            ..
        } = draws;
        let Descents {
            near,
            far,
            shares,
            chosen,
        } = descents;
        near.clear();
        far.clear();
        for &pick in picks.iter() {
            match pick.cluster.light() {
                Some(light) => lights.push(pick.drawn(light, step)),
                None => self.go_on(pick, near, far),
            }
        }
        let seen = self.seen(receiver);
        while !near.is_empty() {
            // All are weighed, then all choose, before any branch: the processor works on several at once.
            shares.clear();
            for pick in near.iter() {
                shares.push(self.shares(pick.cluster.0 as usize, receiver, &seen, false));
            }
            chosen.clear();
            for (pick, shares) in near.iter().zip(shares.iter()) {
                chosen.push(choose(&shares.weights, pick.u));
            }
            let count = near.len();
            let mut kept = 0;
            for i in 0..count {
                let Chosen { lane, .. } = chosen[i];
                let mut pick = near[i];
                pick.is_far = shares[i].alike[lane] > 0.0;
                if self.step(&mut pick, chosen[i], step, lights, dead) {
                    match pick.is_far {
                        true => self.go_on(pick, near, far),
                        false => {
                            prefetch(self.blocks.get(pick.cluster.0 as usize));
                            near[kept] = pick;
                            kept += 1;
                        }
                    }
                }
            }
            near.truncate(kept);
        }
        while !far.is_empty() {
            chosen.clear();
            for pick in far.iter() {
                chosen.push(choose(
                    &self.blocks[pick.cluster.0 as usize].intensity,
                    pick.u,
                ));
            }
            let mut kept = 0;
            for i in 0..far.len() {
                let mut pick = far[i];
                if self.step(&mut pick, chosen[i], step, lights, dead) {
                    let next = self.blocks.get(pick.cluster.0 as usize);
                    prefetch(next.map(|block| &block.intensity));
                    far[kept] = pick;
                    kept += 1;
                }
            }
            far.truncate(kept);
        }
    }

    /// Adds a pick of a block to those under way, and asks for what its next step reads.
    #[inline(always)]
    fn go_on(&self, pick: Pick, near: &mut Vec<Pick>, far: &mut Vec<Pick>) {
        let block = self.blocks.get(pick.cluster.0 as usize);
        if pick.is_far {
            prefetch(block.map(|block| &block.intensity));
            far.push(pick);
        } else {
            prefetch(block);
            near.push(pick);
        }
    }

    /// Takes a pick to the chosen cluster of its block. Whether it goes on from there: else it has led to a light, or to nothing.
    #[inline(always)]
    fn step(
        &self,
        pick: &mut Pick,
        chosen: Chosen,
        step: f64,
        lights: &mut Vec<Drawn>,
        dead: &mut u32,
    ) -> bool {
        let block = &self.blocks[pick.cluster.0 as usize];
        pick.expected *= chosen.pmf;
        pick.u = chosen.u;
        pick.cluster = block.clusters[chosen.lane];
        // Nothing is lit, or a product of hundreds of tiny probabilities has underflowed: such a light cannot be told from none.
        if !(pick.expected > 0.0) {
            *dead += 1;
            return false;
        }
        match pick.cluster.light() {
            Some(light) => {
                lights.push(pick.drawn(light, step));
                false
            }
            None => true,
        }
    }

    /// What lights of a block's clusters are drawn by: their weights, or where all that the block holds is far off, their
    /// intensities.
    #[inline(always)]
    pub(crate) fn shares(
        &self,
        block: usize,
        receiver: &Receiver,
        seen: &Seen,
        is_far: bool,
    ) -> Shares {
        if is_far {
            return Shares {
                weights: self.blocks[block].intensity,
                alike: [1.0; WIDTH],
            };
        }
        let weighed = self.weights::<false>(block, receiver, seen);
        Shares {
            weights: weighed.weights,
            alike: weighed.alike,
        }
    }
}

/// Running sums of weights, the sum of all last.
#[inline(always)]
pub(crate) fn running_sums(weights: &Lanes) -> [f64; WIDTH] {
    let mut w = [0.0f64; WIDTH];
    for k in 0..WIDTH {
        w[k] = f64::from(weights[k]);
    }
    // In four steps rather than seven.
    let (a, b, c, d) = (w[0] + w[1], w[2] + w[3], w[4] + w[5], w[6] + w[7]);
    let (half, most) = (a + b, (a + b) + c);
    [
        w[0],
        a,
        a + w[2],
        half,
        half + w[4],
        most,
        most + w[6],
        half + (c + d),
    ]
}

/// The lane in which `at` lies along the weights, whose running sums are `to`: lane, weight, and how far into it, in [0, 1).
/// Never a lane of weight 0 but where all are; then what is returned means nothing.
#[inline(always)]
pub(crate) fn lane_at(weights: &Lanes, to: &[f64; WIDTH], at: f64) -> (usize, f64, f64) {
    let mut lane = 0;
    for upper in &to[..WIDTH - 1] {
        lane += usize::from(*upper <= at);
    }
    let mut w = f64::from(weights[lane]);
    if w <= 0.0 {
        // Rounding has led past the last one.
        lane = weights.iter().rposition(|&w| w > 0.0).unwrap_or(lane);
        w = f64::from(weights[lane]);
    }
    let from = to[lane] - w;
    (lane, w, ((at - from) / w).clamp(0.0, BELOW_ONE))
}

/// Chooses a lane by its weight with `u`.
#[inline(always)]
fn choose(weights: &Lanes, u: f64) -> Chosen {
    let to = running_sums(weights);
    let sum = to[WIDTH - 1];
    let (lane, w, u) = lane_at(weights, &to, u * sum);
    Chosen {
        lane,
        pmf: w / sum,
        u,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extreme_numbers_never_choose_a_lane_of_weight_zero() {
        let tiny = f32::from_bits(1);
        for weights in [
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, tiny, 0.0, 1.0, 0.0, tiny, 0.0, 0.0],
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-38],
            [1e38, 0.0, 0.0, tiny, 0.0, 0.0, 0.0, 0.0],
        ] {
            for u in [0.0, 1e-300, 0.5, 1.0 - 1e-9, BELOW_ONE] {
                let Chosen { lane, pmf, u: rest } = choose(&weights, u);
                assert!(
                    weights[lane] > 0.0 && pmf > 0.0,
                    "{weights:?} {u}: lane {lane}"
                );
                assert!((0.0..1.0).contains(&rest), "{weights:?} {u}: {rest}");
            }
        }
        let dark = choose(&[0.0; WIDTH], 0.5);
        assert!(dark.pmf.is_nan() && dark.lane < WIDTH, "{dark:?}");
    }

    #[test]
    fn a_number_past_the_last_weight_leads_to_it() {
        let weights = [1.0, 3.0, 0.5, 2.0, 0.25, 1e-9, 0.0, 0.0];
        let to = running_sums(&weights);
        for at in [to[WIDTH - 1], to[WIDTH - 1] * 1.000_001] {
            let (lane, _, u) = lane_at(&weights, &to, at);
            assert_eq!((lane, u), (5, BELOW_ONE), "at {at}");
        }
    }
}
