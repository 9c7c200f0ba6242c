//! What one light can bring one point, as a weight: for methods that look at every light.

use glam::Vec3;
use light_tree::{LightId, LightKind, LightSet};
use sampling::Rng;
use scene::Brdf;

use crate::contribution::{VirtualShape, unoccluded_by_place};
use crate::point::GatherPoint;
use crate::sender::GlossySender;
use crate::vsl::Subtended;

/// Mean over the channels of what light `id` adds to the pixel sample of `x` if nothing is in the way.
///
/// 0 only where the contribution is. Where a virtual sphere has no closed form, which is when a horizon cuts it or
/// the surface is glossy, the contribution is random and the weight bounds what is expected of it: BRDF and both cosines
/// at their greatest over the cone that the sphere subtends, but one of the lobes no greater than its mean may be, or a
/// sphere that a coat's peak falls on would take all samples. A triangle or a cell of an environment, of which a point is drawn,
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
        let cone = Subtended::new(offset, lights.radius(id), x.ns);
        let (cos_x, cos_light) = (x.ns.dot(cone.axis), -normal.dot(cone.axis));
        let sender = GlossySender::of(lights, id);
        let is_whole = cone.is_above(cos_x) && cone.is_above(cos_light);
        if x.brdf.is_glossy() || sender.is_some() || !is_whole {
            let reflected = bound_over(&cone, &x.brdf, [x.ns, x.ns], x.wo, cone.axis);
            let emitted = match &sender {
                None => Over::matte(cone.greatest_cos(cos_light)),
                Some(s) => {
                    let normals = [s.normal, normal];
                    let over = bound_over(&cone, &s.brdf, normals, s.incoming, -cone.axis);
                    Over {
                        greatest: s.scale * over.greatest,
                        mean: s.scale * over.mean,
                    }
                }
            };
            let both = reflected.greatest * emitted.mean;
            let both = both.min(reflected.mean * emitted.greatest);
            let bound = both * lights.intensity(id) * cone.spread();
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

/// Bounds of BRDF × cosine over a cone.
struct Over {
    /// Of any direction.
    greatest: Vec3,
    /// Of the mean: all that a lobe reflects, at most, is in the cone.
    mean: Vec3,
}

impl Over {
    fn matte(greatest: f32) -> Self {
        Self {
            greatest: Vec3::splat(greatest),
            mean: Vec3::splat(greatest),
        }
    }
}

/// BRDF × cosine over the directions of `cone`, whose axis, as seen from the surface that reflects light between it
/// and unit `wo`, is `axis`. The BRDF is about the first of the normals, the cosine about the second.
fn bound_over(cone: &Subtended, brdf: &Brdf, [n, m]: [Vec3; 2], wo: Vec3, axis: Vec3) -> Over {
    let cos_o = n.dot(wo);
    let diffuse = brdf.diffuse_bound(cos_o) * cone.greatest_cos(m.dot(axis));
    let mut over = Over {
        greatest: diffuse,
        mean: diffuse,
    };
    if brdf.is_glossy() {
        let lobe = brdf.lobe_bound(cos_o);
        // Without the cosine that the lobe's bound holds for, at its greatest.
        let per_cosine = if n == m { 1.0 } else { lobe.per_cosine };
        let cos_lobe = cone.greatest_cos(Brdf::lobe_axis(n, wo).dot(axis));
        let lobe = lobe.value(cos_lobe);
        // A coat sends a little of every colour in some direction, however dark it is along the normal.
        let reflected = brdf.albedo(cos_o).max(Vec3::splat(1e-4));
        over.greatest += lobe * per_cosine;
        over.mean += lobe.min(reflected / cone.solid_angle()) * per_cosine;
    }
    over
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
        LightKind::Virtual => f64::from(lights.radius(id)),
        _ => 0.0,
    };
    intensity * f64::from(height) / (dist2.sqrt() * dist2.max(1.5 * radius * radius))
}

/// Mean of the channels in f64: above 0 wherever a channel is.
fn mean(c: Vec3) -> f64 {
    c.as_dvec3().element_sum() / 3.0
}

#[cfg(test)]
mod tests {
    use light_tree::VirtualLight;
    use sampling::{Purpose, uniform_sphere};
    use scene::trace::Hit;
    use scene::{Fresnel, Material, MaterialId, Mesh, Scene};

    use super::*;
    use crate::sphere::MOST_STRATEGIES;

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
                intensity: Vec3::new(1.0, 0.5, 0.0) * 0.7,
                gloss: None,
            });
        }
        let brdf = Brdf {
            diffuse: Vec3::splat(0.2),
            specular: Vec3::splat(0.5),
            alpha: 0.2,
            fresnel: Fresnel::Constant,
        };
        for _ in 0..20 {
            let normal = uniform_sphere([rng.f32(), rng.f32()]);
            let incoming = uniform_sphere([rng.f32(), rng.f32()]);
            let incoming = incoming * incoming.dot(normal).signum();
            // A shading normal that differs, between the two.
            let shading = (normal * 2.0 + incoming).normalize();
            set.push_virtual(&VirtualLight {
                position: Vec3::new(rng.f32() * 2.0 - 1.0, rng.f32(), rng.f32() * 2.0 - 1.0),
                normal,
                intensity: Vec3::new(1.0, 0.5, 0.0) * 0.7,
                gloss: Some(vpl::gloss(&brdf, [shading, normal], incoming)),
            });
        }
        set.set_radius(radius);
        set
    }

    #[test]
    fn a_contribution_never_exceeds_its_weight() {
        let mut rng = Rng::new(9, 0, 0, Purpose::Build);
        let mut random = 0;
        for (specular, alpha) in [(0.0, 1.0), (0.5, 0.5), (0.5, 0.08)] {
            let brdf = Brdf {
                diffuse: Vec3::new(0.5, 0.2, 0.0),
                specular: Vec3::splat(specular),
                alpha,
                fresnel: Fresnel::Constant,
            };
            for radius in [1e-3, 0.1, 0.7] {
                let set = lights(radius, &mut rng);
                for shape in [VirtualShape::Sphere, VirtualShape::ClampedPoint(3.0)] {
                    for x in points(brdf, &mut rng) {
                        for id in set.ids() {
                            let weight = unoccluded_weight(&set, shape, &x, id, &mut rng);
                            let glossy = x.brdf.is_glossy() || set.gloss(id).is_some();
                            let most = match (shape, glossy) {
                                (VirtualShape::Sphere, true) => f64::from(MOST_STRATEGIES),
                                _ => 1.0,
                            };
                            let mut least = f64::INFINITY;
                            for _ in 0..8 {
                                let intensity = set.intensity(id);
                                let value =
                                    unoccluded_by_place(&set, shape, &x, id, intensity, &mut rng)
                                        .map_or(0.0, |l| mean(l.radiance));
                                assert!(
                                    value <= weight * most * (1.0 + 1e-4),
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
