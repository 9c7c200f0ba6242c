//! How the two children of a node are weighed against each other.

use crate::bounds::Receiver;
use crate::tree::{LightTree, NodeId};

/// The published forms of a node's importance for a receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NodeWeights {
    /// Yuksel 2019, eq. (3): F ‖I‖ / d², d the distance to the nearest point of the box, dropped for both
    /// children when the receiver is nearer to either box than its diagonal. F bounds the cosine at the
    /// receiver; where lights point is not looked at.
    #[default]
    Yuksel2019,
    /// Lin and Yuksel 2020: the mean of the probabilities by nearest and by farthest distance; F also bounds
    /// the cosine at the lights.
    MinMax,
}

/// Weights of a pair of children: finite, ≥ 0, both 0 when neither can light the receiver.
pub(crate) type PairWeights = [f32; 2];

impl LightTree {
    /// Weighs the children `first` and `first + 1` for the receiver.
    #[inline]
    pub(crate) fn weigh(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        first: NodeId,
    ) -> PairWeights {
        match weights {
            NodeWeights::Yuksel2019 => self.weigh_yuksel2019(receiver, first),
            NodeWeights::MinMax => self.weigh_min_max(receiver, first),
        }
    }

    #[inline]
    fn weigh_yuksel2019(&self, receiver: &Receiver, first: NodeId) -> PairWeights {
        let pair = self.pair(first);
        let mut lit = [0.0f32; 2];
        let mut least2 = [f32::INFINITY; 2];
        let mut near = false;
        let mut diagonal2 = 0.0f32;
        for (k, node) in pair.iter().enumerate() {
            if !node.has_positions() {
                continue;
            }
            let (centre, half) = receiver.offset(node);
            let d2 = (centre.abs() - half)
                .max(glam::Vec3A::ZERO)
                .length_squared();
            let node_diagonal2 = 4.0 * half.length_squared();
            lit[k] = receiver.cos_bound_over(centre, half) * node.intensity;
            near |= d2 < node_diagonal2;
            diagonal2 = diagonal2.max(node_diagonal2);
            least2[k] = d2.max(self.least_dist2);
        }
        let falloff = if near {
            // The distance is dropped. Only lights without falloff notice the common unit it leaves.
            [1.0 / diagonal2.max(self.least_dist2); 2]
        } else if least2[0].min(least2[1]) > 0.0 {
            least2.map(|d2| 1.0 / d2)
        } else {
            // A light exactly at the receiver outweighs all that is not.
            least2.map(|d2| if d2 == 0.0 { 1.0 } else { 0.0 })
        };
        self.finish(
            receiver,
            first,
            [lit[0] * falloff[0], lit[1] * falloff[1]],
            lit,
        )
    }

    #[inline]
    fn weigh_min_max(&self, receiver: &Receiver, first: NodeId) -> PairWeights {
        let pair = self.pair(first);
        let mut lit = [0.0f32; 2];
        let mut least2 = [f32::INFINITY; 2];
        let mut greatest2 = [f32::INFINITY; 2];
        for (k, node) in pair.iter().enumerate() {
            if !node.has_positions() {
                continue;
            }
            let cos = receiver.cos_bound(node);
            if cos > 0.0 {
                let cone = self.cone(NodeId(first.0 + k as u32));
                lit[k] = cos * receiver.emission_bound(node, cone) * node.intensity;
            }
            let range = receiver.distances(node);
            least2[k] = range.least2.max(self.least_dist2);
            greatest2[k] = range.greatest2.max(self.least_dist2);
        }
        let near = match least2 {
            // Inside both boxes the nearest distance says nothing.
            [0.0, 0.0] => lit,
            [0.0, _] => [lit[0], 0.0],
            [_, 0.0] => [0.0, lit[1]],
            [a, b] => [lit[0] / a, lit[1] / b],
        };
        let far = if greatest2[0].min(greatest2[1]) > 0.0 {
            [lit[0] / greatest2[0], lit[1] / greatest2[1]]
        } else {
            lit
        };
        let near = self.finish(receiver, first, near, lit);
        let far = self.finish(receiver, first, far, lit);
        // Mean of the two probabilities; a side that is dark by one measure keeps half of the other.
        let share = |w: PairWeights, k: usize| {
            let sum = w[0] + w[1];
            if sum > 0.0 { w[k] / sum } else { 0.0 }
        };
        [
            share(near, 0) + share(far, 0),
            share(near, 1) + share(far, 1),
        ]
    }

    /// Adds the lights without falloff, F ‖Iᴰ‖, and keeps the weights finite and alive where `lit` is.
    #[inline]
    fn finish(
        &self,
        receiver: &Receiver,
        first: NodeId,
        mut w: PairWeights,
        lit: PairWeights,
    ) -> PairWeights {
        if !self.directional.is_empty() {
            for (k, weight) in w.iter_mut().enumerate() {
                let id = NodeId(first.0 + k as u32);
                let parallel = self.directional_intensity(id);
                if parallel > 0.0 {
                    *weight += parallel * receiver.cos_bound_parallel(self.cone(id));
                }
            }
        }
        let sum = w[0] + w[1];
        if sum.is_finite() && (sum > 0.0 || lit == [0.0; 2]) {
            w
        } else {
            rescue(w, lit)
        }
    }
}

/// The weights overflowed or vanished though something is lit: scale them, and if that does not help,
/// weigh by intensity and cosine alone.
#[cold]
fn rescue(w: PairWeights, lit: PairWeights) -> PairWeights {
    let greatest = f64::from(w[0]).max(f64::from(w[1]));
    if greatest.is_finite() && greatest > 0.0 {
        return w.map(|x| (f64::from(x) / greatest) as f32);
    }
    let greatest = lit[0].max(lit[1]);
    if greatest > 0.0 && greatest.is_finite() {
        lit.map(|x| x / greatest)
    } else {
        lit.map(|x| f32::from(u8::from(x > 0.0)))
    }
}
