//! The node importance of Conty Estevez and Kulla.
//!
//! Source: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting", §5.3:
//! a cluster is seen as its bounding sphere, about the centre of its box with the radius R of half its diagonal.
//! With d the distance of the centre and θ_u = asin(R / d) the half angle under which the sphere is seen, angles
//! that are known for the centre are known for every light up to θ_u.

use glam::Vec3;

use crate::bounds::{Receiver, RelativeBox, widened_by};
use crate::emission::Emission;
use crate::tree::{LightTree, Node, NodeId};
use crate::weight::PairWeights;

/// A box as a sphere, seen from the receiver.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SeenSphere {
    /// Squared distance of the centre.
    pub(crate) dist2: f32,
    /// Squared radius.
    pub(crate) radius2: f32,
}

/// Least cosine of a box that reaches above the horizon: rounding must not make it dark.
const LEAST_COS: f32 = 1e-6;

impl LightTree {
    /// E |cos θ'ᵢ| h(θ') / d² of two children, where θ'ᵢ = max(0, θᵢ − θ_u) is the least angle at the receiver, and
    /// h = cos θ' for θ' = max(0, θ − θ_o − θ_u), the least angle at a light of cosine emission (θ_e = π/2) whose axis
    /// lies in the cone of half angle θ_o; h = 1 for lights that shine everywhere. Spot lights (θ_e the angle of their
    /// cone) have h = 1 inside of it, triangles the h of the side that is seen.
    ///
    /// Departures: opaque receivers, so that a box below the horizon weighs 0, not its absolute cosine. The
    /// distance is not less than R/2 (a length, as in later renderers; the paper leaves it open), nor than √1.5 radii
    /// of virtual lights. The BRDF's albedo is the same for both children and left out.
    pub(crate) fn weigh_conty_kulla(&self, receiver: &Receiver, first: NodeId) -> PairWeights {
        let mut lit = [0.0f32; 2];
        let mut dist2 = [f32::INFINITY; 2];
        for (k, node) in self.pair(first).iter().enumerate() {
            if node.has_positions() {
                let seen = receiver.relative(node);
                let sphere = SeenSphere::of(&seen);
                let emission = self.emission(NodeId(first.0 + k as u32));
                lit[k] = node.intensity * sphere.cosines(receiver, &seen, emission);
                dist2[k] = sphere
                    .dist2
                    .max(0.25 * sphere.radius2)
                    .max(self.least_dist2);
            }
        }
        self.weigh_with_parallel(receiver, first, lit, dist2)
    }

    /// The sphere about a node that has positional lights.
    pub(crate) fn sphere(&self, receiver: &Receiver, node: &Node) -> SeenSphere {
        SeenSphere::of(&receiver.relative(node))
    }
}

impl SeenSphere {
    fn of(seen: &RelativeBox) -> Self {
        Self {
            dist2: seen.centre().length_squared(),
            radius2: 0.25 * seen.diagonal2(),
        }
    }

    /// Greatest cosine at the receiver × greatest at a light; 0 only when no light below can light the receiver.
    fn cosines(&self, receiver: &Receiver, seen: &RelativeBox, emission: Emission) -> f32 {
        if !receiver.sees_above_horizon(seen) {
            return 0.0;
        }
        // Rounded up: for a sphere that all but touches the receiver the cosine of θ_u comes from a difference.
        let (radius2, dist2) = (self.radius2 * (1.0 + 1e-6), self.dist2);
        // The receiver inside the sphere, or at its centre: nothing is known of angles.
        if radius2 >= dist2 {
            return 1.0;
        }
        let sin2 = radius2 / dist2;
        let (sin_u, cos_u) = (sin2.sqrt(), (1.0 - sin2).sqrt());
        let toward = seen.centre() / self.dist2.sqrt();
        let at_receiver = widened_by(receiver.normal().dot(toward), cos_u, sin_u).max(LEAST_COS);
        if emission.is_any() {
            return at_receiver;
        }
        let from_axis = |axis: Vec3| widened_by(-toward.dot(axis.into()), cos_u, sin_u);
        at_receiver * emission.bound(from_axis)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::TreeBuilder;
    use crate::light::VirtualLight;
    use crate::lights::LightSet;
    use crate::weight::NodeWeights;

    /// Virtual lights of intensity 1 at positions with normals; a tree over them.
    fn tree(lights: &[(Vec3, Vec3)]) -> LightTree {
        let mut set = LightSet::default();
        for &(position, normal) in lights {
            set.push_virtual(&VirtualLight {
                position,
                normal,
                incoming: normal,
                flux: Vec3::splat(std::f32::consts::PI),
                reflectance: Vec3::ONE,
                material: 0,
            });
        }
        LightTree::build(&set, TreeBuilder::Binned).expect("has lights")
    }

    /// Importances of the lights of a pair, in the order given.
    fn pair(lights: [(Vec3, Vec3); 2], x: &Receiver) -> PairWeights {
        let tree = tree(&lights);
        let first = tree.node(tree.root()).first_child().expect("two lights");
        let w = tree.weigh(NodeWeights::ContyKulla2018, x, first);
        match tree.node(first).light().map(|l| l.0) {
            Some(0) => w,
            _ => [w[1], w[0]],
        }
    }

    const UP: Vec3 = Vec3::Y;
    const DOWN: Vec3 = Vec3::NEG_Y;

    #[test]
    fn single_lights_weigh_what_they_bring() {
        let x = Receiver::new(Vec3::ZERO, UP);
        let tilted = Vec3::new(0.0, -0.6, 0.8);
        let w = pair(
            [(Vec3::Y * 2.0, DOWN), (Vec3::new(3.0, 4.0, 0.0), tilted)],
            &x,
        );
        // cos cos / d²: 1 / 4, and 0.8 · (0.6 · 0.8) / 25.
        let ratio = 0.25 / (0.8 * 0.48 / 25.0);
        assert!((w[0] / w[1] / ratio - 1.0).abs() < 1e-4, "{w:?}");
    }

    #[test]
    fn a_light_that_faces_away_or_lies_below_has_none() {
        let x = Receiver::new(Vec3::ZERO, UP);
        let w = pair([(Vec3::Y, DOWN), (Vec3::Y * 2.0, UP)], &x);
        assert!(w[0] > 0.0 && w[1] == 0.0, "away: {w:?}");
        let w = pair([(Vec3::Y, DOWN), (DOWN, UP)], &x);
        assert!(w[0] > 0.0 && w[1] == 0.0, "below: {w:?}");
    }

    #[test]
    fn edge_on_a_hair_above_the_edge_still_counts() {
        // Axis at a right angle to the direction but for one part in 10⁷, which the renderer lights.
        let x = Receiver::new(Vec3::ZERO, UP);
        let normal = Vec3::new(1.0, -1e-7, 0.0).normalize();
        let w = pair([(Vec3::Y, DOWN), (Vec3::Y, normal)], &x);
        assert!(w[1] > 0.0 && w[1] < 1e-4 * w[0], "{w:?}");
    }

    #[test]
    fn opposite_axes_open_the_cone() {
        let x = Receiver::new(Vec3::ZERO, UP);
        let cluster = [(Vec3::Y, UP), (Vec3::Y, DOWN), (Vec3::Y * 2.0, DOWN)];
        let tree = tree(&cluster);
        let (pmfs, _) = tree.pmf_below(NodeWeights::ContyKulla2018, &x, tree.root());
        for id in [1, 2] {
            let pmf = pmfs.iter().find(|p| p.0.0 == id).map_or(0.0, |p| p.1);
            assert!(pmf > 0.1, "{pmfs:?}");
        }
    }

    #[test]
    fn at_the_centre_of_a_cluster_and_among_coincident_lights_weights_are_finite() {
        let around = [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z].map(|p| (p, -p));
        let here = [(Vec3::ZERO, UP); 4];
        let near = [(Vec3::Y * 1e-30, DOWN); 4];
        for lights in [&around[..], &here, &near] {
            let tree = tree(lights);
            let x = Receiver::new(Vec3::ZERO, UP);
            for id in tree.nodes_below(tree.root()) {
                if let Some(first) = tree.node(id).first_child() {
                    let w = tree.weigh(NodeWeights::ContyKulla2018, &x, first);
                    let sound = w.iter().all(|w| w.is_finite() && *w >= 0.0);
                    assert!(sound, "{w:?} for {lights:?}");
                }
            }
            let (pmfs, dead) = tree.pmf_below(NodeWeights::ContyKulla2018, &x, tree.root());
            let sum: f64 = pmfs.iter().map(|p| p.1).sum::<f64>() + dead;
            assert!((sum - 1.0).abs() < 1e-9, "{sum} for {lights:?}");
        }
    }

    #[test]
    fn both_cosines_of_a_cluster_are_bounds() {
        let mut rng = sampling::Rng::new(12, 0, 0, sampling::Purpose::Build);
        let mut unit = || sampling::uniform_sphere([rng.f32(), rng.f32()]).normalize();
        for _ in 0..2000 {
            let lights: Vec<(Vec3, Vec3)> =
                (0..4).map(|_| (unit() + Vec3::Y * 1.5, unit())).collect();
            let tree = tree(&lights);
            let normal = unit();
            let x = Receiver::new(Vec3::ZERO, normal);
            let seen = x.relative(tree.node(tree.root()));
            let bound = SeenSphere::of(&seen).cosines(&x, &seen, tree.emission(tree.root()));
            for &(p, n) in &lights {
                let d = p.normalize();
                let truth = normal.dot(d).max(0.0) * (-n.dot(d)).max(0.0);
                assert!(bound >= truth - 1e-5, "{bound} below {truth}: {lights:?}");
            }
        }
    }
}
