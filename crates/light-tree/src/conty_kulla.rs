//! The node importance of Conty Estevez and Kulla.
//!
//! Source: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting", §5.3:
//! a cluster is seen as its bounding sphere, about the centre of its box with the radius R of half its diagonal.
//! With d the distance of the centre and θ_u = asin(R / d) the half angle under which the sphere is seen, angles
//! that are known for the centre are known for every light up to θ_u.

use crate::bounds::{Receiver, RelativeBox, widened_by};
use crate::cone::Cone;
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
    /// lies in the cone of half angle θ_o; h = 1 for lights that shine everywhere.
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
                let cone = self.cone(NodeId(first.0 + k as u32));
                lit[k] = node.intensity * sphere.cosines(receiver, &seen, cone);
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
    fn cosines(&self, receiver: &Receiver, seen: &RelativeBox, cone: Cone) -> f32 {
        if !receiver.sees_above_horizon(seen) {
            return 0.0;
        }
        // Rounded up: for a sphere that all but touches the receiver the cosine of θ_u comes from a difference.
        let sin2 = self.radius2 * (1.0 + 1e-6) / self.dist2;
        // The receiver inside the sphere, or at its centre: nothing is known of angles.
        if !(sin2 < 1.0) {
            return 1.0;
        }
        let (sin_u, cos_u) = (sin2.sqrt(), (1.0 - sin2).sqrt());
        let toward = seen.centre() / self.dist2.sqrt();
        let at_receiver = widened_by(receiver.normal().dot(toward), cos_u, sin_u).max(LEAST_COS);
        if cone.cos <= -1.0 {
            return at_receiver;
        }
        let from_axis = widened_by(-toward.dot(cone.axis.into()), cos_u, sin_u);
        let sin_o = ((1.0 - cone.cos) * (1.0 + cone.cos)).max(0.0).sqrt();
        at_receiver * widened_by(from_axis, cone.cos, sin_o).max(0.0)
    }
}
