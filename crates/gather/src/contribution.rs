//! What one light adds to one gather point, visibility apart.

use glam::Vec3;
use light_tree::{LightId, LightKind, LightSet};
use sampling::{Rng, uniform_triangle};
use scene::Scene;
use scene::trace::Ray;

use crate::path::light_share;
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

impl VirtualShape {
    /// What cos cos / d² is clamped to; infinite where nothing is.
    pub(crate) fn clamp(self) -> f32 {
        match self {
            Self::Sphere => f32::INFINITY,
            Self::ClampedPoint(clamp) => clamp,
        }
    }
}

/// Light that arrives if nothing is in the way.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Unoccluded {
    /// Radiance toward the viewer.
    pub(crate) radiance: Vec3,
    /// What must be free.
    pub(crate) shadow_ray: Ray,
}

impl Unoccluded {
    /// What it adds to the pixel sample of `x` if it was chosen and is multiplied by `scale`; `None` where that is not finite.
    pub(crate) fn adds(&self, x: &GatherPoint, scale: f64) -> Option<Vec3> {
        // The product in f64: a tiny probability is no reason to overflow when the contribution is tiny too.
        let value = ((self.radiance * x.strength).as_dvec3() * scale).as_vec3();
        value.is_finite().then_some(value)
    }
}

/// Radiance that light `id` sends by way of `x` to the viewer; `None` when it is below a horizon or black.
///
/// `rng` is drawn from only for lights with an extent, and where a virtual light has no closed form: then the expected
/// value is what the light sends.
pub(crate) fn unoccluded(
    scene: &Scene,
    lights: &LightSet,
    shape: VirtualShape,
    x: &GatherPoint,
    id: LightId,
    rng: &mut Rng,
) -> Option<Unoccluded> {
    unoccluded_of(scene, lights, shape, x, id, lights.intensity(id), rng)
}

/// As [`unoccluded`], were the light's intensity `intensity`.
pub(crate) fn unoccluded_of(
    scene: &Scene,
    lights: &LightSet,
    shape: VirtualShape,
    x: &GatherPoint,
    id: LightId,
    intensity: Vec3,
    rng: &mut Rng,
) -> Option<Unoccluded> {
    match lights.kind(id) {
        LightKind::Triangle => triangle(scene, lights, x, id, intensity, rng),
        LightKind::Environment => environment(scene, lights, x, id, intensity, rng),
        _ => unoccluded_by_place(lights, shape, x, id, intensity, rng),
    }
}

/// As [`unoccluded_of`], for lights of one position or direction: no scene is needed.
pub(crate) fn unoccluded_by_place(
    lights: &LightSet,
    shape: VirtualShape,
    x: &GatherPoint,
    id: LightId,
    intensity: Vec3,
    rng: &mut Rng,
) -> Option<Unoccluded> {
    let kind = lights.kind(id);
    if kind == LightKind::Directional {
        return parallel(x, -lights.axis(id), intensity);
    }
    let position = lights.position(id);
    let offset = position - x.position;
    // The horizon rule of the tree's bounds: the shading normal and the light's centre. A light below the
    // geometric horizon only is dark as well: the surface itself is in the way.
    if x.ns.dot(offset) <= 0.0 || x.ng.dot(offset) <= 0.0 {
        return None;
    }
    let radiance = match kind {
        LightKind::Omni => point(x, intensity, offset),
        LightKind::Spot => spot(lights, x, id, intensity, offset),
        LightKind::Virtual => {
            let normal = lights.axis(id);
            if normal.dot(offset) >= 0.0 || lights.bounces(id) > x.light_bounces {
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
        LightKind::Triangle | LightKind::Directional | LightKind::Environment => {
            debug_assert!(false, "{kind:?} has no one place");
            Vec3::ZERO
        }
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

/// As [`point`], within the light's cone.
fn spot(lights: &LightSet, x: &GatherPoint, id: LightId, intensity: Vec3, offset: Vec3) -> Vec3 {
    let cos = -lights.axis(id).dot(offset) / offset.length();
    match lights.spot(id).falloff(cos) {
        0.0 => Vec3::ZERO,
        falloff => point(x, intensity * falloff, offset),
    }
}

/// A point drawn uniformly from a triangle stands for all of it.
fn triangle(
    scene: &Scene,
    lights: &LightSet,
    x: &GatherPoint,
    id: LightId,
    intensity: Vec3,
    rng: &mut Rng,
) -> Option<Unoccluded> {
    let t = lights.element(id) as usize;
    let [u, v] = uniform_triangle([rng.f32(), rng.f32()]);
    let drawn = scene.emitter_point(t, u, v);
    let normal = drawn.normal_toward(x.position)?;
    let position = drawn.off(normal);
    let offset = position - x.position;
    // The horizon rule, for the point drawn.
    if x.ns.dot(offset) <= 0.0 || x.ng.dot(offset) <= 0.0 || normal.dot(offset) >= 0.0 {
        return None;
    }
    let sent = scene.emitted(t, u, v) * drawn.area();
    let intensity = intensity * relative(sent, lights.intensity(id));
    let dist2 = offset.length_squared();
    let wi = offset / dist2.sqrt();
    let cos = -normal.dot(wi);
    let geometry = x.ns.dot(wi) * cos / dist2;
    let share = share(x, wi, || dist2 / (drawn.area() * cos));
    let radiance = x.brdf.eval(x.ns, x.wo, wi) * intensity * (geometry * share);
    (radiance != Vec3::ZERO).then(|| Unoccluded {
        radiance,
        shadow_ray: Ray::between(x.position, position),
    })
}

/// A direction drawn from a cell in proportion to its light stands for all of it.
fn environment(
    scene: &Scene,
    lights: &LightSet,
    x: &GatherPoint,
    id: LightId,
    intensity: Vec3,
    rng: &mut Rng,
) -> Option<Unoccluded> {
    let cell = lights.element(id) as usize;
    let (u, within) = (rng.f64(), [rng.f32(), rng.f32()]);
    let environment = scene.environment.as_ref()?;
    let drawn = environment.sample_cell(cell, u, within);
    let share = share(x, drawn.direction, || {
        environment.pdf_solid_angle(drawn.direction)
    });
    let intensity = intensity * relative(drawn.power, lights.intensity(id)) * share;
    parallel(x, drawn.direction, intensity)
}

/// What part of a light in direction `wi` of density `pdf_light` is not left to a ray that goes on from `x`.
fn share(x: &GatherPoint, wi: Vec3, pdf_light: impl Fn() -> f32) -> f32 {
    if x.shares_hits {
        light_share(pdf_light(), x.brdf.pdf_solid_angle(x.ns, x.wo, wi))
    } else {
        1.0
    }
}

/// What is sent over its mean, by channel: 1 where the mean is 0 and nothing is sent.
fn relative(sent: Vec3, mean: Vec3) -> Vec3 {
    Vec3::select(mean.cmpgt(Vec3::ZERO), sent / mean, Vec3::ONE)
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

/// Light from beyond the scene, from direction `wi`: no attenuation, the shadow ray leaves the scene.
fn parallel(x: &GatherPoint, wi: Vec3, irradiance: Vec3) -> Option<Unoccluded> {
    let cos = x.ns.dot(wi);
    if cos <= 0.0 || x.ng.dot(wi) <= 0.0 {
        return None;
    }
    let radiance = x.brdf.eval(x.ns, x.wo, wi) * irradiance * cos;
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
