//! What one light adds to one gather point, visibility apart.

use glam::Vec3;
use light_tree::{LightId, LightKind, LightSet};
use sampling::Rng;
use scene::trace::Ray;

use crate::point::GatherPoint;
use crate::sender::GlossySender;
use crate::sphere::sphere;
use crate::vsl::Subtended;

/// How virtual lights shine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VirtualShape {
    /// As spheres of their radius.
    Sphere,
    /// As points whose geometry term cos cos / d² is clamped to this value, in 1/scene unit².
    ClampedPoint(f32),
}

/// Light that arrives if nothing is in the way.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Unoccluded {
    /// Radiance toward the viewer.
    pub(crate) radiance: Vec3,
    /// What must be free.
    pub(crate) shadow_ray: Ray,
}

/// Radiance that light `id` sends by way of `x` to the viewer; `None` when it is below a horizon or black.
///
/// `rng` is drawn from only where a virtual light has no closed form.
pub(crate) fn unoccluded(
    lights: &LightSet,
    shape: VirtualShape,
    x: &GatherPoint,
    id: LightId,
    rng: &mut Rng,
) -> Option<Unoccluded> {
    unoccluded_of(lights, shape, x, id, lights.intensity(id), rng)
}

/// As [`unoccluded`], were the light's intensity `intensity`.
pub(crate) fn unoccluded_of(
    lights: &LightSet,
    shape: VirtualShape,
    x: &GatherPoint,
    id: LightId,
    intensity: Vec3,
    rng: &mut Rng,
) -> Option<Unoccluded> {
    if lights.kind(id) == LightKind::Directional {
        return parallel(lights, x, id, intensity);
    }
    let position = lights.position(id);
    let offset = position - x.position;
    // The horizon rule of the tree's bounds: the shading normal and the light's centre. A light below the
    // geometric horizon only is dark as well: the surface itself is in the way.
    if x.ns.dot(offset) <= 0.0 || x.ng.dot(offset) <= 0.0 {
        return None;
    }
    let radiance = match lights.kind(id) {
        LightKind::Omni => point(x, intensity, offset),
        LightKind::Virtual => {
            let normal = lights.axis(id);
            if normal.dot(offset) >= 0.0 {
                return None;
            }
            let sender = GlossySender::of(lights, id);
            let reflected = match shape {
                VirtualShape::Sphere => {
                    let cone = Subtended::new(offset, lights.radius(id), x.ns);
                    sphere(&cone, x, normal, sender.as_ref(), rng)
                }
                VirtualShape::ClampedPoint(clamp) => {
                    clamped_point(x, sender.as_ref(), offset, normal, clamp)
                }
            };
            intensity * reflected
        }
        LightKind::Directional => Vec3::ZERO,
    };
    (radiance != Vec3::ZERO).then(|| Unoccluded {
        radiance,
        shadow_ray: Ray::between(x.position, position),
    })
}

/// Inverse-square light. The caller has seen that `offset` is above both horizons, so it is not zero.
fn point(x: &GatherPoint, intensity: Vec3, offset: Vec3) -> Vec3 {
    let dist2 = offset.length_squared();
    let wi = offset / dist2.sqrt();
    x.brdf.eval(x.ns, x.wo, wi) * intensity * (x.ns.dot(wi) / dist2)
}

fn clamped_point(
    x: &GatherPoint,
    sender: Option<&GlossySender>,
    offset: Vec3,
    normal: Vec3,
    clamp: f32,
) -> Vec3 {
    let dist2 = offset.length_squared();
    let wi = offset / dist2.sqrt();
    let geometry = (x.ns.dot(wi) * -normal.dot(wi) / dist2).min(clamp);
    let emitted = sender.map_or(Vec3::ONE, |sender| sender.emitted(-wi));
    x.brdf.eval(x.ns, x.wo, wi) * emitted * geometry
}

/// Parallel light: no attenuation, the shadow ray leaves the scene.
fn parallel(
    lights: &LightSet,
    x: &GatherPoint,
    id: LightId,
    intensity: Vec3,
) -> Option<Unoccluded> {
    let wi = -lights.axis(id);
    let cos = x.ns.dot(wi);
    if cos <= 0.0 || x.ng.dot(wi) <= 0.0 {
        return None;
    }
    let radiance = x.brdf.eval(x.ns, x.wo, wi) * intensity * cos;
    let shadow_ray = Ray {
        origin: x.position,
        direction: wi,
        t_max: f32::INFINITY,
    };
    (radiance != Vec3::ZERO).then_some(Unoccluded {
        radiance,
        shadow_ray,
    })
}
