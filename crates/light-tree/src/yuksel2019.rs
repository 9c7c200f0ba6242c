//! Eq. (3) of Yuksel 2019, for one pair of siblings or several at once.

use crate::bounds::{Boxes, Receiver};
use crate::tree::{LightTree, NodeId};
use crate::weight::{PairWeights, sound};

impl LightTree {
    /// Weighs the children `first` and `first + 1` for the receiver.
    #[inline]
    pub(crate) fn weigh_yuksel2019(&self, receiver: &Receiver, first: NodeId) -> PairWeights {
        let [[a], [b]] = self.weigh_pairs::<1, 2>(receiver, [first]);
        [a, b]
    }

    /// Weights of the first child and of the second of `PAIRS` nodes, whose children are `firsts` and those behind them; `NODES` is
    /// twice as much.
    ///
    /// The same operations in the same order for any number of pairs, and so the same bits.
    #[inline(always)]
    pub(crate) fn weigh_pairs<const PAIRS: usize, const NODES: usize>(
        &self,
        receiver: &Receiver,
        firsts: [NodeId; PAIRS],
    ) -> [[f32; PAIRS]; 2] {
        const { assert!(NODES == 2 * PAIRS, "two nodes a pair") };
        let mut boxes = Boxes {
            lo: [[0.0f32; NODES]; 3],
            hi: [[0.0f32; NODES]; 3],
        };
        let mut intensity = [0.0f32; NODES];
        for k in 0..PAIRS {
            let pair = self.pair(firsts[k]);
            for c in 0..2 {
                for axis in 0..3 {
                    boxes.lo[axis][c * PAIRS + k] = pair[c].lo[axis];
                    boxes.hi[axis][c * PAIRS + k] = pair[c].hi[axis];
                }
                intensity[c * PAIRS + k] = pair[c].intensity;
            }
        }
        let seen = receiver.relative_boxes(&boxes);
        let mut lit = receiver.cos_bounds_over(&seen);
        for k in 0..NODES {
            lit[k] *= intensity[k];
        }
        let (nearest2, diagonal2) = (seen.least2(), seen.diagonal2());
        let mut weights = [[0.0f32; PAIRS]; 2];
        if !self.directional.is_empty() {
            for k in 0..PAIRS {
                let of = |lanes: &[f32; NODES]| [lanes[k], lanes[PAIRS + k]];
                let [a, b] = self.with_parallel(
                    receiver,
                    firsts[k],
                    of(&lit),
                    of(&nearest2),
                    of(&diagonal2),
                );
                (weights[0][k], weights[1][k]) = (a, b);
            }
            return weights;
        }
        let mut least2 = nearest2;
        let mut is_sound = true;
        let mut is_close = false;
        for nearest2 in &nearest2 {
            is_close |= *nearest2 < self.greatest_dist2;
        }
        if is_close {
            for (k, first) in firsts.iter().enumerate() {
                for c in 0..2 {
                    let floor2 = self.least_dist2(NodeId(first.0 + c as u32));
                    let lane = c * PAIRS + k;
                    least2[lane] = least2[lane].max(floor2);
                }
            }
        }
        for k in 0..PAIRS {
            let other = PAIRS + k;
            // A light alone in its box, at the receiver, is near as well.
            let near = (nearest2[k] <= diagonal2[k]) | (nearest2[other] <= diagonal2[other]);
            // Only the ratio of the distances matters. Not near means not 0.
            let ratio = least2[k] / least2[other];
            let ratio = if near { 1.0 } else { ratio };
            weights[0][k] = lit[k];
            weights[1][k] = lit[other] * ratio;
            let sum = weights[0][k] + weights[1][k];
            // Not finite, or nothing though something is lit.
            let is_dark = (lit[k] == 0.0) & (lit[other] == 0.0);
            is_sound &= (sum < f32::INFINITY) & ((sum > 0.0) | is_dark);
        }
        if !is_sound {
            for k in 0..PAIRS {
                let lit = [lit[k], lit[PAIRS + k]];
                let [a, b] = sound([weights[0][k], weights[1][k]], lit);
                (weights[0][k], weights[1][k]) = (a, b);
            }
        }
        weights
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
