//! Upper bounds of the light of a cluster, for methods that stop where a bound is small enough.
//!
//! Unlike the bounds of a [`Cut`](crate::Cut), which only decide where samples go, these are never below what
//! any light of the cluster sends: nothing is left out and no distance is floored.
//!
//! Source: Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005, §3.2; for clusters of
//! receivers Walter et al., "Multidimensional Lightcuts", 2006.

use glam::{Vec3, Vec3A};

use crate::bounds::{Receiver, RelativeBox, signed_cos_toward, widened_by, widened_signed_cos};
use crate::cone::Cone;
use crate::tree::{LightTree, NodeId};

/// How the light of a cluster of one kind falls off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Falloff {
    /// Omni and spot lights and the points of triangles: inverse square, without limit.
    Point,
    /// Virtual lights as points with cosine emission, whose cos cos / d² is clamped to this, in 1/scene unit².
    ClampedPoint(f32),
    /// Virtual lights as spheres of this radius ≥ 0 in scene units, dark where their centre is below a horizon.
    Sphere(f32),
    /// Distant light.
    None,
}

/// What a light of a cluster sends at most, per unit of intensity. A cluster's light is at most
/// intensity × `geometry` × the greatest reflection for directions within `lobe_cos`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClusterBound {
    /// Upper bound of cosines × falloff, ≥ 0; 0 only where every light of the cluster is below a horizon, +∞
    /// where a receiver may be at a point light.
    pub geometry: f32,
    /// Upper bound in [0, 1] of cos⁺ between a mirror direction and the direction light comes from; 0 without
    /// mirror directions.
    pub lobe_cos: f32,
}

impl ClusterBound {
    /// Of a cluster that sends nothing.
    pub const DARK: Self = Self {
        geometry: 0.0,
        lobe_cos: 0.0,
    };
}

/// Directions about an axis.
#[derive(Debug, Clone, Copy)]
struct Axes {
    /// Holds the frame about the axis; its place is of no matter.
    about: Receiver,
    /// Cosine of the half angle around the axis.
    cos: f32,
}

impl Axes {
    fn of(cone: Cone) -> Self {
        Self {
            about: Receiver::new(Vec3::ZERO, cone.axis),
            cos: cone.cos,
        }
    }

    /// Upper bound of the signed cosine between any of the directions and any direction to a point of the box.
    fn cos_over(&self, seen: &RelativeBox) -> f32 {
        widened_signed_cos(self.about.signed_cos_bound_over(seen), self.cos)
    }

    /// The same for the directions against `travel`.
    fn cos_against(&self, travel: Cone) -> f32 {
        let cos = -self.about.normal().dot(travel.axis.into());
        widened_signed_cos(widened_signed_cos(cos, travel.cos), self.cos)
    }
}

/// One point that is lit, or a cluster of them, as bounds see it.
#[derive(Debug, Clone, Copy)]
pub struct Receivers {
    lo: Vec3A,
    hi: Vec3A,
    normals: Axes,
    mirrors: Option<Axes>,
}

impl Receivers {
    /// One point, with the unit axis of its specular lobe if it is glossy.
    pub fn at(receiver: &Receiver, mirror: Option<Vec3>) -> Self {
        Self {
            lo: receiver.position(),
            hi: receiver.position(),
            normals: Axes {
                about: *receiver,
                cos: 1.0,
            },
            mirrors: mirror.map(|axis| Axes::of(Cone::of(axis))),
        }
    }

    /// Points in the box from `lo` to `hi`, with normals and, where there are any, mirror directions in cones.
    pub fn within(lo: Vec3, hi: Vec3, normals: Cone, mirrors: Option<Cone>) -> Self {
        Self {
            lo: lo.into(),
            hi: hi.into(),
            normals: Axes::of(normals),
            mirrors: mirrors.map(Axes::of),
        }
    }

    /// Bounds what any light below node `id` of `tree` sends to any of the points. All lights there must be of
    /// the kind that `falloff` is about.
    pub fn bound(&self, tree: &LightTree, id: NodeId, falloff: Falloff) -> ClusterBound {
        let emission = tree.emission(id);
        if falloff == Falloff::None {
            let cone = emission.cone;
            return ClusterBound {
                geometry: self.normals.cos_against(cone).max(0.0),
                lobe_cos: self.mirrors.map_or(0.0, |m| m.cos_against(cone).max(0.0)),
            };
        }
        // Offsets from any of the points to any of the lights: the Minkowski difference of the boxes.
        let node = tree.node(id);
        let seen = RelativeBox {
            lo: Vec3A::from(node.lo) - self.hi,
            hi: Vec3A::from(node.hi) - self.lo,
        };
        let cos = self.normals.cos_over(&seen).max(0.0);
        if cos == 0.0 {
            return ClusterBound::DARK;
        }
        let mut lobe_cos = self.mirrors.map_or(0.0, |m| m.cos_over(&seen));
        let dist2 = seen.least2();
        let emitted = if emission.is_wide() {
            1.0
        } else {
            let mirrored = seen.mirrored();
            emission.bound(|axis| signed_cos_toward(axis, &mirrored))
        };
        if emitted == 0.0 {
            return ClusterBound::DARK;
        }
        let geometry = match falloff {
            Falloff::Sphere(radius) => {
                let sphere = NearestSphere::new(dist2, radius);
                // Light comes from all of the sphere, so by directions off the one to the centre.
                lobe_cos = sphere.widen(lobe_cos);
                sphere.widen(cos).max(0.0) * sphere.widen(emitted).max(0.0) * sphere.spread
            }
            Falloff::ClampedPoint(clamp) => (cos * emitted / dist2).min(clamp),
            Falloff::Point | Falloff::None => cos * emitted / dist2,
        };
        ClusterBound {
            geometry,
            lobe_cos: lobe_cos.max(0.0),
        }
    }
}

/// The sphere of a virtual light that is as near as the box allows.
struct NearestSphere {
    /// Cosine of the half angle under which it appears; 0 inside.
    cos: f32,
    /// Sine of that angle.
    sin: f32,
    /// Its solid angle over πr², 2 / (max(d, r)² (1 + cos)): never less for a sphere farther off.
    spread: f32,
}

impl NearestSphere {
    fn new(dist2: f32, radius: f32) -> Self {
        let dist = dist2.sqrt();
        let sin = if dist > radius { radius / dist } else { 1.0 };
        let cos = (1.0 - sin * sin).max(0.0).sqrt();
        Self {
            cos,
            sin,
            spread: 2.0 / (dist2.max(radius * radius) * (1.0 + cos)),
        }
    }

    /// Upper bound of the signed cosine for directions to any point of the sphere, where `cos` bounds that for
    /// the direction to its centre.
    fn widen(&self, cos: f32) -> f32 {
        widened_by(cos, self.cos, self.sin)
    }
}
