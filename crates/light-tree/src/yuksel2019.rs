//! Eq. (3) of Yuksel 2019, for one pair of siblings or several at once.

use crate::bounds::{Receiver, ReceiverLanes, SeenLanes, lesser};
use crate::pair_lanes::PairLanes;
use crate::tree::{LightTree, NodeId};
use crate::weight::{PairWeights, sound};

impl LightTree {
    /// Weighs the children `first` and `first + 1` for the receiver.
    #[inline]
    pub(crate) fn weigh_yuksel2019(&self, receiver: &Receiver, first: NodeId) -> PairWeights {
        let pair = &self.pairs[(first.0 >> 1) as usize];
        let lanes = PairLanes::<1, 2>::of([pair]);
        let seen = ReceiverLanes::splat(receiver).see(&lanes.boxes);
        if !self.directional.is_empty() {
            let lit = [0, 1].map(|k| seen.cos[k] * lanes.intensity[k]);
            return self.with_parallel(receiver, first, lit, seen.least2, seen.diagonal2);
        }
        let [[a], [b]] = self.weigh_seen(&seen, &lanes.intensity, &[first.0 >> 1]);
        [a, b]
    }

    /// Weights of the first and of the second of `PAIRS` pairs of siblings, whose places are `pairs`, where no light is without
    /// falloff. What is seen of them lies as in [`PairLanes`].
    ///
    /// The same operations in the same order for any number of pairs, and so the same bits.
    #[inline(always)]
    pub(crate) fn weigh_seen<const PAIRS: usize, const NODES: usize>(
        &self,
        seen: &SeenLanes<NODES>,
        intensity: &[f32; NODES],
        pairs: &[u32; PAIRS],
    ) -> [[f32; PAIRS]; 2] {
        let mut lit = [0.0f32; NODES];
        let mut is_near = [false; NODES];
        for k in 0..NODES {
            lit[k] = seen.cos[k] * intensity[k];
            // A light alone in its box, at the receiver, is near as well.
            is_near[k] = seen.least2[k] <= seen.diagonal2[k];
        }
        let mut is_close = false;
        for k in 0..PAIRS {
            let least2 = lesser(seen.least2[k], seen.least2[PAIRS + k]);
            is_close |= (least2 < self.greatest_dist2) & !(is_near[k] | is_near[PAIRS + k]);
        }
        let mut least2 = seen.least2;
        if is_close {
            least2 = self.floored(least2, pairs);
        }
        let mut weights = [[0.0f32; PAIRS]; 2];
        let mut is_sound = true;
        for k in 0..PAIRS {
            let other = PAIRS + k;
            // Only the ratio of the distances matters. Not near means not 0.
            let ratio = least2[k] / least2[other];
            let ratio = if is_near[k] | is_near[other] {
                1.0
            } else {
                ratio
            };
            weights[0][k] = lit[k];
            weights[1][k] = lit[other] * ratio;
            let sum = weights[0][k] + weights[1][k];
            // Not finite, or nothing though something is lit.
            let is_dark = (lit[k] == 0.0) & (lit[other] == 0.0);
            is_sound &= (sum < f32::INFINITY) & ((sum > 0.0) | is_dark);
        }
        if !is_sound {
            weights = all_sound(weights, lit);
        }
        weights
    }

    /// Squared distances, where they are less than what tells the lights of a node apart, that.
    #[inline(never)]
    fn floored<const PAIRS: usize, const NODES: usize>(
        &self,
        mut all: [f32; NODES],
        pairs: &[u32; PAIRS],
    ) -> [f32; NODES] {
        for (lane, least2) in all.iter_mut().enumerate() {
            if *least2 < self.greatest_dist2 {
                let node = NodeId(2 * pairs[lane % PAIRS] + (lane / PAIRS) as u32);
                *least2 = least2.max(self.least_dist2(node));
            }
        }
        all
    }

    /// The weights of a pair where there are lights without falloff.
    #[cold]
    fn with_parallel(
        &self,
        receiver: &Receiver,
        first: NodeId,
        mut lit: PairWeights,
        mut nearest2: [f32; 2],
        mut diagonal2: [f32; 2],
    ) -> PairWeights {
        let pair = self.pair(first);
        for k in (0..2).filter(|&k| !pair[k].has_positions()) {
            // An empty box: dark, and far from everything.
            (lit[k], nearest2[k], diagonal2[k]) = (0.0, f32::INFINITY, 0.0);
        }
        let near = (nearest2[0] <= diagonal2[0]) | (nearest2[1] <= diagonal2[1]);
        let floor2 = [first, NodeId(first.0 + 1)].map(|id| self.least_dist2(id));
        let dist2 = match near {
            true => [diagonal2[0].max(diagonal2[1]).max(floor2[0]).max(floor2[1]); 2],
            false => [nearest2[0].max(floor2[0]), nearest2[1].max(floor2[1])],
        };
        self.weigh_with_parallel(receiver, first, lit, dist2)
    }
}

/// [`sound`] of each pair.
#[cold]
fn all_sound<const PAIRS: usize, const NODES: usize>(
    mut weights: [[f32; PAIRS]; 2],
    lit: [f32; NODES],
) -> [[f32; PAIRS]; 2] {
    for k in 0..PAIRS {
        let [a, b] = sound([weights[0][k], weights[1][k]], [lit[k], lit[PAIRS + k]]);
        (weights[0][k], weights[1][k]) = (a, b);
    }
    weights
}
