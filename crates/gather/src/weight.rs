//! What one light can bring one point, as a weight: for methods that look at every light.

use std::f32::consts::FRAC_1_PI;

use light_tree::{LightId, LightKind, LightSet};
use sampling::Rng;
use scene::Brdf;

use crate::contribution::{VirtualShape, unoccluded_by_place};
use crate::point::GatherPoint;
use crate::vsl::Subtended;

/// Mean over the channels of what light `id` adds to the pixel sample of `x` if nothing is in the way.
///
/// 0 only where the contribution is. Where a virtual sphere has no closed form, which is when a horizon cuts it or
/// the surface is glossy, the contribution is random and the weight bounds it: BRDF and both cosines at
/// their greatest over the cone that the sphere subtends. A triangle or a cell of an environment, of which a point is drawn,
/// has its [`rough_weight`], which bounds nothing. `rng` is never drawn from.
pub(crate) fn unoccluded_weight(
    lights: &LightSet,
    shape: VirtualShape,
    x: &GatherPoint,
    id: LightId,
    rng: &mut Rng,
) -> f64 {
    if lights.kind(id) == LightKind::Virtual && shape == VirtualShape::Sphere {
        let offset = lights.position(id) - x.position;
        let normal = lights.axis(id);
        if x.ns.dot(offset) <= 0.0 || x.ng.dot(offset) <= 0.0 || normal.dot(offset) >= 0.0 {
            return 0.0;
        }
        let cone = Subtended::new(offset, lights.radius(), x.ns);
        let (cos_x, cos_light) = (x.ns.dot(cone.axis), -normal.dot(cone.axis));
        if x.brdf.is_glossy() || !cone.is_above(cos_x) || !cone.is_above(cos_light) {
            let cosines = cone.greatest_cos(cos_x) * cone.greatest_cos(cos_light);
            let cos_lobe = cone.greatest_cos(Brdf::lobe_axis(x.ns, x.wo).dot(cone.axis));
            let lobe = x.brdf.lobe_peak() * cos_lobe.powf(x.brdf.exponent);
            let brdf = x.brdf.diffuse * FRAC_1_PI + x.brdf.specular * lobe;
            let bound = brdf * lights.intensity(id) * (cosines * cone.spread());
            return mean(bound * x.strength);
        }
    }
    if matches!(
        lights.kind(id),
        LightKind::Triangle | LightKind::Environment
    ) {
        return rough_weight(lights, x, id) * mean(x.strength);
    }
    unoccluded_by_place(lights, shape, x, id, lights.intensity(id), rng)
        .map_or(0.0, |light| mean(light.radiance * x.strength))
}

/// Intensity × cos⁺ at the point / d²: no BRDF, no emission, no geometric normal.
///
/// The distance is not less than √1.5 radii of a virtual light, inside which it says nothing. Distant light has no
/// distance. For lights with an extent the cosine, for triangles with that of their emission, is the greatest that any
/// of their points may have, and the distance that of the middle, not less than half the extent. 0 only where the
/// contribution is.
pub(crate) fn rough_weight(lights: &LightSet, x: &GatherPoint, id: LightId) -> f64 {
    let intensity = mean(lights.intensity(id));
    let kind = lights.kind(id);
    if kind.is_distant() {
        let cone = lights.emission(id).cone;
        return intensity * f64::from(x.receiver.cos_bound_parallel(cone));
    }
    if kind == LightKind::Triangle {
        let leaf = lights.leaf(id);
        let emitted = x.receiver.emission_bound(&leaf, lights.emission(id));
        let cosines = f64::from(x.receiver.cos_bound(&leaf) * emitted);
        let middle = lights.position(id).as_dvec3();
        let extent2 = (leaf.hi - leaf.lo).as_dvec3().length_squared();
        let dist2 = middle.distance_squared(x.position.as_dvec3());
        return intensity * cosines / dist2.max(0.25 * extent2);
    }
    let offset = lights.position(id) - x.position;
    let height = x.ns.dot(offset);
    if height <= 0.0 {
        return 0.0;
    }
    // In f64 no square of a finite offset over- or underflows. The sphere's geometry term at distance 0 is below
    // 1 / (1.5 r²).
    let dist2 = offset.as_dvec3().length_squared();
    let radius = match kind {
        LightKind::Virtual => f64::from(lights.radius()),
        _ => 0.0,
    };
    intensity * f64::from(height) / (dist2.sqrt() * dist2.max(1.5 * radius * radius))
}

/// Mean of the channels in f64: above 0 wherever a channel is.
fn mean(c: glam::Vec3) -> f64 {
    c.as_dvec3().element_sum() / 3.0
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use light_tree::VirtualLight;
    use sampling::{Purpose, uniform_sphere};
    use scene::trace::Hit;
    use scene::{Material, MaterialId, Mesh, Scene};

    use super::*;

    /// Points in and above a plane, seen from all sides.
    fn points(brdf: Brdf, rng: &mut Rng) -> Vec<GatherPoint> {
        let scene = Scene {
            mesh: Mesh {
                positions: vec![Vec3::ZERO, Vec3::Z, Vec3::X],
                indices: vec![[0, 1, 2]],
                materials: vec![MaterialId(0)],
                ..Mesh::default()
            },
            materials: vec![Material::default()],
            ..Scene::default()
        };
        (0..20)
            .map(|_| {
                let wo = uniform_sphere([0.5 * rng.f32(), rng.f32()]);
                let wo = Vec3::new(wo.x, wo.z.abs(), wo.y).normalize();
                let hit = Hit {
                    t: 1.0,
                    triangle: 0,
                    u: 0.2,
                    v: 0.2,
                };
                let mut x = GatherPoint::new(&scene.surface(&hit, -wo), wo, Vec3::ONE, 0);
                x.brdf = brdf;
                x
            })
            .collect()
    }

    /// Virtual lights all about the plane, some cut by its horizon or their own.
    fn lights(radius: f32, rng: &mut Rng) -> LightSet {
        let mut set = LightSet::default();
        for _ in 0..40 {
            let normal = uniform_sphere([rng.f32(), rng.f32()]);
            set.push_virtual(&VirtualLight {
                position: Vec3::new(
                    rng.f32() * 2.0 - 1.0,
                    rng.f32() - 0.1,
                    rng.f32() * 2.0 - 1.0,
                ),
                normal,
                incoming: normal,
                flux: Vec3::new(1.0, 0.5, 0.0),
                reflectance: Vec3::splat(0.7),
                material: 0,
            });
        }
        set.set_radius(radius);
        set
    }

    #[test]
    fn a_contribution_never_exceeds_its_weight() {
        let mut rng = Rng::new(9, 0, 0, Purpose::Build);
        let mut random = 0;
        for (specular, exponent) in [(0.0, 1.0), (0.5, 5.0), (0.5, 300.0)] {
            let brdf = Brdf {
                diffuse: Vec3::new(0.5, 0.2, 0.0),
                specular: Vec3::splat(specular),
                exponent,
            };
            for radius in [1e-3, 0.1, 0.7] {
                let set = lights(radius, &mut rng);
                for shape in [VirtualShape::Sphere, VirtualShape::ClampedPoint(3.0)] {
                    for x in points(brdf, &mut rng) {
                        for id in set.ids() {
                            let weight = unoccluded_weight(&set, shape, &x, id, &mut rng);
                            let mut least = f64::INFINITY;
                            for _ in 0..8 {
                                let intensity = set.intensity(id);
                                let value =
                                    unoccluded_by_place(&set, shape, &x, id, intensity, &mut rng)
                                        .map_or(0.0, |l| mean(l.radiance));
                                assert!(
                                    value <= weight * (1.0 + 1e-4),
                                    "{value} above {weight}: {shape:?} {x:?} {id:?}"
                                );
                                assert!(
                                    value == 0.0 || rough_weight(&set, &x, id) > 0.0,
                                    "{value} without rough weight"
                                );
                                least = least.min(value);
                            }
                            random += u32::from(least < 0.999 * weight);
                        }
                    }
                }
            }
        }
        assert!(random > 1000, "only {random} weights are bounds");
    }
}
