//! How the two children of a node are weighed against each other.

use crate::bounds::{Receiver, RelativeBox};
use crate::tree::{Directions, LightTree, NodeId};

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
    /// As [`MinMax`](Self::MinMax), where lights point is not looked at.
    MinMaxWithoutCones,
    /// As [`MinMax`](Self::MinMax), F at a glossy receiver being a bound of BRDF × cosine: lights in the mirror direction
    /// are found.
    MinMaxGlossy,
    /// Conty Estevez and Kulla 2018: greatest cosines, at the receiver and at the lights, over the bounding sphere
    /// of a cluster, and the distance of its centre.
    ContyKulla2018,
}

impl NodeWeights {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Yuksel2019,
        Self::MinMax,
        Self::MinMaxWithoutCones,
        Self::MinMaxGlossy,
        Self::ContyKulla2018,
    ];
}

impl NodeWeights {
    /// Whether where lights point is looked at, in cuts as well as on the way down.
    pub(crate) fn bounds_emission(self) -> bool {
        self.directions() == Directions::Kept
    }

    /// What they ask of a tree.
    pub fn directions(self) -> Directions {
        match self {
            Self::MinMax | Self::MinMaxGlossy | Self::ContyKulla2018 => Directions::Kept,
            Self::Yuksel2019 | Self::MinMaxWithoutCones => Directions::Dropped,
        }
    }

    /// Greatest reflection of light from the box that is looked at, up to a factor of the receiver.
    #[inline]
    pub(crate) fn reflection(self, receiver: &Receiver, seen: &RelativeBox) -> f32 {
        match self {
            Self::MinMaxGlossy => receiver.reflection_bound_over(seen),
            _ => receiver.cos_bound_over(seen),
        }
    }
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
            NodeWeights::MinMax | NodeWeights::MinMaxGlossy => {
                self.weigh_min_max::<true>(weights, receiver, first)
            }
            NodeWeights::MinMaxWithoutCones => {
                self.weigh_min_max::<false>(weights, receiver, first)
            }
            NodeWeights::ContyKulla2018 => self.weigh_conty_kulla(receiver, first),
        }
    }

    /// F ‖I‖ / d² + Fᴰ ‖Iᴰ‖ of two children, for squared distances `dist2` in one unit with the intensities.
    ///
    /// Where the distance is dropped `dist2` is the same for both: only parallel light notices its value.
    pub(crate) fn weigh_with_parallel(
        &self,
        receiver: &Receiver,
        first: NodeId,
        lit: PairWeights,
        dist2: [f32; 2],
    ) -> PairWeights {
        let falloff = |k: usize| match lit[k] {
            0.0 => 0.0,
            _ if dist2[k] > 0.0 => lit[k] / dist2[k],
            _ => f32::MAX,
        };
        self.finish(receiver, first, [falloff(0), falloff(1)], lit)
    }

    #[inline]
    fn weigh_min_max<const CONES: bool>(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        first: NodeId,
    ) -> PairWeights {
        let pair = self.pair(first);
        let mut lit = [0.0f32; 2];
        let mut least2 = [f32::INFINITY; 2];
        let mut greatest2 = [f32::INFINITY; 2];
        for (k, node) in pair.iter().enumerate() {
            if !node.has_positions() {
                continue;
            }
            let seen = receiver.relative(node);
            lit[k] = weights.reflection(receiver, &seen) * node.intensity;
            if CONES {
                lit[k] *= seen.emission_bound(self.emission(NodeId(first.0 + k as u32)));
            }
            let range = seen.distances();
            let floor2 = self.least_dist2(NodeId(first.0 + k as u32));
            least2[k] = range.least2.max(floor2);
            greatest2[k] = range.greatest2.max(floor2);
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
        sound(w, lit)
    }
}

/// The weights, or where they overflowed, or vanished though something is lit, others in their place.
#[inline]
pub(crate) fn sound(weights: PairWeights, lit: PairWeights) -> PairWeights {
    let sum = weights[0] + weights[1];
    if sum.is_finite() && (sum > 0.0 || lit == [0.0; 2]) {
        weights
    } else {
        rescue(weights, lit)
    }
}

/// Scales weights, and if that does not help, weighs by intensity and cosine alone.
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

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::build::TreeBuilder;
    use crate::lights::LightSet;
    use crate::tree::Floor;

    fn pair_share(lights: &[(Vec3, f32)], x: &Receiver, weights: NodeWeights) -> f64 {
        let mut set = LightSet::default();
        for &(p, i) in lights {
            set.push_point(p, Vec3::splat(i));
        }
        let tree = LightTree::build(&set, TreeBuilder::Binned).expect("has lights");
        let first = tree.node(tree.root()).first_child().expect("two lights");
        let w = tree.weigh(weights, x, first).map(f64::from);
        let own = if tree.node(first).lo == lights[0].0 {
            0
        } else {
            1
        };
        w[own] / (w[0] + w[1])
    }

    #[test]
    fn two_single_lights_are_weighed_by_equation_three() {
        let x = Receiver::new(Vec3::ZERO, Vec3::Y);
        let (a, b) = (Vec3::new(0.0, 2.0, 0.0), Vec3::new(3.0, 4.0, 0.0));
        // F I / d²: cosines 1 and 0.8, squared distances 4 and 25.
        let (wa, wb) = (1.0 * 5.0 / 4.0, 0.8 * 7.0 / 25.0);
        let share = pair_share(&[(a, 5.0), (b, 7.0)], &x, NodeWeights::Yuksel2019);
        assert!((share - wa / (wa + wb)).abs() < 1e-5, "{share}");
    }

    #[test]
    fn the_distance_is_dropped_near_a_box() {
        // Four lights in two clusters; the receiver is nearer to the first than its diagonal.
        let mut set = LightSet::default();
        for p in [
            [-1.0, 0.5, 0.0],
            [1.0, 0.5, 0.0],
            [40.0, 30.0, 0.0],
            [41.0, 30.0, 0.0],
        ] {
            set.push_point(Vec3::from(p), Vec3::ONE);
        }
        let tree = LightTree::build(&set, TreeBuilder::Binned).expect("has lights");
        let x = Receiver::new(Vec3::ZERO, Vec3::Y);
        let first = tree.node(tree.root()).first_child().expect("two clusters");
        let w = tree.weigh(NodeWeights::Yuksel2019, &x, first);
        let f = [tree.node(first), tree.node(NodeId(first.0 + 1))]
            .map(|n| x.cos_bound(n) * n.intensity);
        assert!(
            (w[0] / w[1] - f[0] / f[1]).abs() < 1e-4 * f[0] / f[1],
            "{w:?} against {f:?}"
        );
    }

    #[test]
    fn scaling_the_scene_by_powers_of_two_keeps_every_probability() {
        let lights = [
            (Vec3::new(0.3, 2.0, 0.1), 5.0),
            (Vec3::new(3.0, 4.0, -0.2), 7.0),
        ];
        let x = Receiver::new(Vec3::ZERO, Vec3::Y);
        for weights in NodeWeights::ALL {
            let share = pair_share(&lights, &x, weights);
            // At 2^60 a power times a squared distance is beyond f32, at 2^-60 it is none.
            for k in [-60, -20, -7, 9, 20, 60] {
                let s = 2.0f32.powi(k);
                let scaled = lights.map(|(p, i)| (p * s, i * s * s));
                assert_eq!(
                    pair_share(&scaled, &x, weights),
                    share,
                    "{weights:?} at 2^{k}"
                );
            }
        }
    }

    #[test]
    fn the_radius_of_virtual_lights_is_none_of_the_lamps_beside_them() {
        // A lamp of that distance from everything would hardly ever be drawn where there is parallel light as well.
        let mut set = LightSet::default();
        for i in 0..4u8 {
            set.push_point(Vec3::X * f32::from(i), Vec3::ONE);
        }
        for i in 0..16u8 {
            set.push_virtual(&crate::light::VirtualLight {
                position: Vec3::new(f32::from(i), 100.0, 0.3),
                normal: Vec3::Y,
                intensity: Vec3::ONE,
                gloss: None,
            });
        }
        let mut own = set.clone();
        own.set_radii(vec![1e5; 16]);
        set.set_radius(1e5);
        for set in [set, own] {
            let tree = LightTree::build(&set, TreeBuilder::Binned).expect("has lights");
            let group = |id: NodeId| id.0 as usize / (2 * Floor::PAIRS);
            let mut has_lamps = [false; 5];
            for id in tree.nodes_below(tree.root()) {
                has_lamps[group(id)] |= tree.lights_below(id).any(|l| l.index() < 4);
            }
            assert!(has_lamps[0] && !has_lamps[4], "{has_lamps:?}");
            for id in tree.nodes_below(tree.root()) {
                let lamps = has_lamps[group(id)];
                let least = if lamps { 0.0 } else { 1.5e10 };
                let own = tree.least_dist2(id);
                let is_close = own <= least && own >= least * (127.0 / 128.0);
                assert!(is_close, "node {}, lamps: {lamps}: {own}", id.0);
            }
        }
    }

    #[test]
    fn a_light_at_the_receiver_and_one_far_off_leave_finite_weights() {
        let x = Receiver::new(Vec3::ONE, Vec3::Y);
        for weights in NodeWeights::ALL {
            for lights in [
                [(Vec3::ONE, 1.0), (Vec3::ONE * 2.0, 1.0)],
                [(Vec3::ONE, 1.0), (Vec3::ONE, 1e30)],
                // 10³⁵ times the ratio of the squared distances is beyond f32.
                [
                    (Vec3::new(-500.0, 100.0, 100.0), 1.0),
                    (Vec3::new(1.0, 3.0, 1.0), 1e35),
                ],
            ] {
                let mut set = LightSet::default();
                for (p, i) in lights {
                    set.push_point(p, Vec3::splat(i));
                }
                let tree = LightTree::build(&set, TreeBuilder::Binned).expect("has lights");
                let first = tree.node(tree.root()).first_child().expect("two lights");
                let w = tree.weigh(weights, &x, first);
                let sound = w.iter().all(|w| w.is_finite() && *w >= 0.0);
                assert!(sound, "{weights:?} {lights:?}: {w:?}");
            }
        }
    }
}
