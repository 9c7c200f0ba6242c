//! Eq. (3) of Yuksel 2019, for one pair of siblings or several at once.

use std::hint::select_unpredictable;

use crate::bounds::{Receiver, ReceiverLanes, SeenLanes, lesser};
use crate::pair_lanes::PairLanes;
use crate::tree::{LightTree, NodeId};
use crate::weight::{PairWeights, sound};
use crate::wide::by_width;

impl LightTree {
    /// Weighs the children `first` and `first + 1` for the receiver.
    #[inline]
    pub(crate) fn weigh_yuksel2019(&self, receiver: &Receiver, first: NodeId) -> PairWeights {
        by_width!(
            self.weigh_alone_fma(receiver, first),
            self.weigh_alone(receiver, first)
        )
    }

    /// The same code and the same bits, a multiplication and an addition to an instruction rather than a call.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn weigh_alone_fma(&self, receiver: &Receiver, first: NodeId) -> PairWeights {
        self.weigh_alone(receiver, first)
    }

    #[inline(always)]
    fn weigh_alone(&self, receiver: &Receiver, first: NodeId) -> PairWeights {
        let pair = &self.pairs[(first.0 >> 1) as usize];
        let lanes = PairLanes::<1, 2>::of([pair]);
        let mut seen = ReceiverLanes::<1>::splat(receiver).see(&lanes.boxes);
        if self.has_parallel(first) {
            let lit = [0, 1].map(|k| seen.cos(k) * lanes.intensity[k]);
            return self.with_parallel(receiver, first, lit, seen.least2, seen.diagonal2);
        }
        let mut weights = [[0.0]; 2];
        let pair = [first.0 >> 1];
        self.weigh_seen(&mut seen, &lanes.intensity, &pair, &mut weights);
        [weights[0][0], weights[1][0]]
    }

    /// Weights of the first and of the second of `PAIRS` pairs of siblings, whose places are `pairs`, of no meaning where one
    /// [`has_parallel`](Self::has_parallel). What is seen of them lies as in [`PairLanes`].
    ///
    /// The same operations in the same order for any number of pairs, and so the same bits.
    #[inline(always)]
    pub(crate) fn weigh_seen<const PAIRS: usize, const NODES: usize>(
        &self,
        seen: &mut SeenLanes<NODES>,
        intensity: &[f32; NODES],
        pairs: &[u32; PAIRS],
        weights: &mut [[f32; PAIRS]; 2],
    ) {
        // A light alone in its box, at the receiver, is near as well.
        let is_near = |seen: &SeenLanes<NODES>, k: usize| {
            (seen.least2[k] <= seen.diagonal2[k])
                | (seen.least2[PAIRS + k] <= seen.diagonal2[PAIRS + k])
        };
        let mut is_close = false;
        for k in 0..PAIRS {
            let least2 = lesser(seen.least2[k], seen.least2[PAIRS + k]);
            is_close |= (least2 < self.greatest_dist2) & !is_near(seen, k);
        }
        if is_close {
            self.floor(seen, pairs);
        }
        let mut lit = [0.0; NODES];
        for k in 0..NODES {
            lit[k] = seen.cos(k) * intensity[k];
        }
        let mut is_sound = true;
        for k in 0..PAIRS {
            let other = PAIRS + k;
            // Only the ratio of the distances matters. Not near means not 0.
            let ratio = seen.least2[k] / seen.least2[other];
            let ratio = select_unpredictable(is_near(seen, k), 1.0, ratio);
            let [first, second] = [lit[k], lit[other] * ratio];
            (weights[0][k], weights[1][k]) = (first, second);
            let sum = first + second;
            // Not finite, or nothing though something is lit.
            let is_dark = (lit[k] == 0.0) & (lit[other] == 0.0);
            is_sound &= (sum < f32::INFINITY) & ((sum > 0.0) | is_dark);
        }
        if !is_sound {
            make_sound(weights, seen, intensity);
        }
    }

    /// Raises squared distances, where pairs are not near, to what tells the lights of a node apart.
    #[inline(never)]
    fn floor<const PAIRS: usize, const NODES: usize>(
        &self,
        seen: &mut SeenLanes<NODES>,
        pairs: &[u32; PAIRS],
    ) {
        for (k, pair) in pairs.iter().enumerate() {
            let is_near =
                (0..2).any(|c| seen.least2[c * PAIRS + k] <= seen.diagonal2[c * PAIRS + k]);
            for c in (0..2).filter(|_| !is_near) {
                let lane = c * PAIRS + k;
                if seen.least2[lane] < self.greatest_dist2 {
                    let node = NodeId(2 * pair + c as u32);
                    seen.least2[lane] = seen.least2[lane].max(self.least_dist2(node));
                }
            }
        }
    }

    /// Whether there are lights without falloff below `first` or its sibling. Below most pairs there are none, wherever there are any:
    /// they have a subtree of their own.
    #[inline]
    pub(crate) fn has_parallel(&self, first: NodeId) -> bool {
        let of = |id| self.directional_intensity(id) > 0.0;
        !self.directional.is_empty() && (of(first) || of(NodeId(first.0 + 1)))
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
fn make_sound<const PAIRS: usize, const NODES: usize>(
    weights: &mut [[f32; PAIRS]; 2],
    seen: &SeenLanes<NODES>,
    intensity: &[f32; NODES],
) {
    let lit = |lane: usize| seen.cos(lane) * intensity[lane];
    let [first, second] = weights;
    for (k, (a, b)) in first.iter_mut().zip(second).enumerate() {
        [*a, *b] = sound([*a, *b], [lit(k), lit(PAIRS + k)]);
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sampling::{Purpose, Rng};

    use super::*;
    use crate::build::TreeBuilder;
    use crate::cone::Cone;
    use crate::cuts::Cuts;
    use crate::emission::Profile;
    use crate::lights::LightSet;
    use crate::select::{DeadBranch, Start};
    use crate::tree::Floor;
    use crate::weight::NodeWeights;

    #[test]
    fn what_no_light_has_changes_no_bit_where_it_is_asked_for() {
        let mut rng = Rng::new(11, 0, 0, Purpose::Build);
        let mut anywhere = || Vec3::new(rng.f32(), rng.f32(), rng.f32());
        let mut lamps = LightSet::default();
        for _ in 0..300 {
            lamps.push_point(anywhere(), Vec3::splat(0.1) + anywhere());
        }
        let receivers: Vec<Receiver> = (0..40)
            .map(|_| Receiver::new(anywhere(), (anywhere() - Vec3::splat(0.5)).normalize()))
            .collect();
        let receivers: Vec<&Receiver> = receivers.iter().collect();
        let drawn = |tree: &LightTree| {
            let weights = NodeWeights::Yuksel2019;
            let mut cuts = Cuts::default();
            cuts.refine(tree, weights, &receivers, 10);
            let (mut starts, mut drawn) = (Vec::new(), Vec::new());
            for i in 0..receivers.len() {
                let mut rng = Rng::new(12, i as u64, 0, Purpose::Lights);
                starts.extend(cuts.of(i).iter().map(|&node| Start {
                    receiver: i as u32,
                    node,
                    u: rng.f64(),
                }));
            }
            tree.select_each(weights, DeadBranch::Stop, &receivers, &starts, &mut drawn);
            (starts, drawn)
        };
        let plain = LightTree::build(&lamps, TreeBuilder::Binned).expect("has lights");
        let nodes = 2 * plain.pairs.len();
        let beside = [
            plain.cones.len(),
            plain.profiles.len(),
            plain.directional.len(),
            plain.least_dist2_below.len(),
        ];
        assert_eq!(beside, [0; 4], "nothing beside the nodes");
        let without = drawn(&plain);
        let directed = LightTree {
            cones: vec![Cone::SPHERE; nodes],
            profiles: vec![Profile::Cosine; nodes],
            ..plain.clone()
        };
        assert!(drawn(&directed) == without, "with directions");
        let parallel = LightTree {
            directional: vec![0.0; nodes],
            ..plain.clone()
        };
        assert!(drawn(&parallel) == without, "with parallel light");
        // Spheres of another part of the scene.
        let spheres = LightTree {
            least_dist2_below: vec![Floor::ZERO; plain.pairs.len()],
            greatest_dist2: 4.0,
            ..plain.clone()
        };
        assert!(drawn(&spheres) == without, "with spheres");
    }
}
