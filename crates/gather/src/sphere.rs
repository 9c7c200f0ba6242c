//! What a gather point reflects of the light of a virtual sphere.
//!
//! ∫ f_x(ω) f_l(−ω) cos⁺θ_x cos⁺θ_l dω / (πr²) over the cone that the sphere subtends, for a light of intensity 1. Between
//! matte surfaces, which is all there is in most scenes, the integral has a closed form; where a horizon cuts the cone one
//! uniform direction stands for it. With a lobe on either side it is drawn by up to three strategies at once: uniformly in the
//! cone, by the lobe of the receiver, and by the lobe of the light, weighed by the balance heuristic.
//!
//! Sources: Hašan, Křivánek, Walter, Bala, "Virtual Spherical Lights for Many-Light Rendering of Glossy Scenes", 2009,
//! §4; Veach and Guibas, "Optimally Combining Sampling Techniques for Monte Carlo Rendering", 1995, eq. (14).

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;
use sampling::Rng;
use scene::{Brdf, Fresnel};

use crate::point::GatherPoint;
use crate::sender::GlossySender;
use crate::vsl::Subtended;

/// Directions drawn at most: a single estimate is at most this many times the integrand's greatest value times the solid angle.
#[cfg(test)]
pub(crate) const MOST_STRATEGIES: u32 = 3;

/// A lobe is drawn from when the cone is at least this share of its width. In a cone much narrower than the lobe the lobe is
/// constant, and the uniform strategy alone is best.
pub(crate) const LEAST_SHARE: f32 = 0.05;

/// An estimate of the integral, exact between matte surfaces above whose horizons all of the cone is. `normal` is that of the
/// light, whose emission it bounds; `sender` how a glossy light shines.
pub(crate) fn sphere(
    cone: &Subtended,
    x: &GatherPoint,
    normal: Vec3,
    sender: Option<&GlossySender>,
    rng: &mut Rng,
) -> Vec3 {
    let toward = -normal;
    let (cos_x, cos_light) = (x.ns.dot(cone.axis), toward.dot(cone.axis));
    let is_whole = cone.is_above(cos_x) && cone.is_above(cos_light);
    // Products of constant parts have the closed form.
    let constant = match sender {
        _ if !is_whole => Vec3::ZERO,
        Some(sender) => constant_part(&x.brdf) * constant_part(&sender.brdf) * sender.scale,
        None => constant_part(&x.brdf),
    };
    let exact = match constant {
        Vec3::ZERO => Vec3::ZERO,
        constant => constant * cone.cosine_integral(x.ns, toward, cos_x, cos_light),
    };
    if is_whole && sender.is_none() && !x.brdf.is_glossy() {
        return exact;
    }
    let rest = |w: Vec3| {
        let cosines = x.ns.dot(w).max(0.0) * toward.dot(w).max(0.0);
        if cosines == 0.0 {
            return Vec3::ZERO;
        }
        let emitted = sender.map_or(Vec3::ONE, |sender| sender.emitted(-w));
        (x.brdf.eval(x.ns, x.wo, w) * emitted - constant) * cosines
    };
    exact + estimate(cone, x, sender, rest, rng)
}

/// What of a BRDF's value does not depend on directions.
fn constant_part(brdf: &Brdf) -> Vec3 {
    match brdf.fresnel {
        Fresnel::Constant => brdf.diffuse * FRAC_1_PI,
        Fresnel::Schlick => Vec3::ZERO,
    }
}

/// Estimates ∫ `integrand` dω / (πr²) over the cone.
fn estimate(
    cone: &Subtended,
    x: &GatherPoint,
    sender: Option<&GlossySender>,
    integrand: impl Fn(Vec3) -> Vec3,
    rng: &mut Rng,
) -> Vec3 {
    let solid_angle = cone.solid_angle();
    let is_wide = |brdf: &Brdf, n: Vec3, wo: Vec3| {
        brdf.is_glossy() && solid_angle * brdf.greatest_specular_pdf(n.dot(wo)) >= LEAST_SHARE
    };
    let receiver = is_wide(&x.brdf, x.ns, x.wo);
    let sender = sender.filter(|s| is_wide(&s.brdf, s.normal, s.incoming));
    // Each strategy's density over the uniform one's; all strategies draw once.
    let density = |w: Vec3| {
        let mut sum = 1.0;
        if receiver {
            sum += solid_angle * x.brdf.pdf_specular(x.ns, x.wo, w);
        }
        if let Some(s) = sender {
            sum += solid_angle * s.brdf.pdf_specular(s.normal, s.incoming, -w);
        }
        sum
    };
    let mut u = || [rng.f32(), rng.f32()];
    let w = cone.sample(u());
    let mut sum = integrand(w) / density(w);
    let mut add = |w: Vec3| {
        if cone.contains(w) {
            sum += integrand(w) / density(w);
        }
    };
    if receiver {
        add(x.brdf.sample_specular(x.ns, x.wo, u()));
    }
    if let Some(s) = sender {
        add(-s.brdf.sample_specular(s.normal, s.incoming, u()));
    }
    sum * cone.spread()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use light_tree::{LightId, LightSet, Receiver, VirtualLight};
    use rayon::prelude::*;
    use sampling::{Purpose, uniform_cone};

    fn glossy(diffuse: f32, specular: f32, alpha: f32, fresnel: Fresnel) -> Brdf {
        Brdf {
            diffuse: Vec3::new(diffuse, 0.5 * diffuse, 0.0),
            specular: Vec3::splat(specular),
            alpha,
            fresnel,
        }
    }

    /// At the origin of a surface that faces +y, seen from `wo`.
    fn point(brdf: Brdf, wo: Vec3) -> GatherPoint {
        GatherPoint {
            position: Vec3::ZERO,
            ng: Vec3::Y,
            ns: Vec3::Y,
            wo,
            brdf,
            strength: Vec3::ONE,
            slot: 0,
            block: 0,
            sample: 0,
            sequence: sampling::Sequence(0),
            bounce: 0,
            light_bounces: u32::MAX,
            shares_hits: false,
            receiver: Receiver::new(Vec3::ZERO, Vec3::Y),
        }
    }

    /// A light on a surface of `brdf` with `normal`, lit from `incoming`.
    fn sender(brdf: Brdf, normal: Vec3, incoming: Vec3) -> GlossySender {
        GlossySender {
            brdf,
            normal,
            incoming,
            scale: Vec3::splat(std::f32::consts::PI / 0.8),
        }
    }

    /// The integral by the midpoint rule, over directions of equal solid angle.
    fn quadrature(
        x: &GatherPoint,
        offset: Vec3,
        radius: f32,
        normal: Vec3,
        sender: Option<&GlossySender>,
    ) -> DVec3 {
        let (d2, r2) = (
            f64::from(offset.length_squared()),
            f64::from(radius).powi(2),
        );
        let sin2 = (r2 / d2).min(1.0);
        let one_minus_cos = sin2 / (1.0 + (1.0 - sin2).sqrt());
        let frame = sampling::Frame::around(offset.normalize());
        let steps = 1000_u32;
        let sums: Vec<DVec3> = (0..steps)
            .into_par_iter()
            .map(|i| {
                let mut sum = DVec3::ZERO;
                for j in 0..steps {
                    let u = [i, j].map(|k| (k as f32 + 0.5) / steps as f32);
                    let w = frame.to_world(uniform_cone(one_minus_cos as f32, u));
                    let (cos_x, cos_l) = (x.ns.dot(w), -normal.dot(w));
                    if cos_x > 0.0 && cos_l > 0.0 {
                        let emitted = sender.map_or(Vec3::ONE, |s| s.emitted(-w));
                        let f = x.brdf.eval(x.ns, x.wo, w) * emitted;
                        sum += f.as_dvec3() * (f64::from(cos_x) * f64::from(cos_l));
                    }
                }
                sum
            })
            .collect();
        // Solid angle over πr².
        let per_area = 2.0 * one_minus_cos / r2 / f64::from(steps).powi(2);
        sums.into_iter().sum::<DVec3>() * per_area
    }

    /// Means of many estimates and their standard errors.
    fn estimated(
        x: &GatherPoint,
        offset: Vec3,
        radius: f32,
        normal: Vec3,
        sender: Option<&GlossySender>,
    ) -> (DVec3, DVec3) {
        let chunks = 64;
        let each = 20_000;
        let cone = Subtended::new(offset, radius, x.ns);
        let sums: Vec<[DVec3; 2]> = (0..chunks)
            .into_par_iter()
            .map(|chunk| {
                let mut rng = Rng::new(31, chunk, 0, Purpose::LightSurface);
                let mut sums = [DVec3::ZERO; 2];
                for _ in 0..each {
                    let value = sphere(&cone, x, normal, sender, &mut rng).as_dvec3();
                    sums[0] += value;
                    sums[1] += value * value;
                }
                sums
            })
            .collect();
        let n = (chunks * each) as f64;
        let mean = sums.iter().map(|s| s[0]).sum::<DVec3>() / n;
        let square = sums.iter().map(|s| s[1]).sum::<DVec3>() / n;
        let variance = (square - mean * mean).max(DVec3::ZERO) / n;
        (
            mean,
            DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt()),
        )
    }

    #[test]
    fn estimates_average_to_the_integral() {
        let matte = Brdf::lambert(Vec3::new(0.8, 0.4, 0.0));
        let metal = glossy(0.0, 0.9, 0.15, Fresnel::Constant);
        let plastic = glossy(0.6, 0.04, 0.2, Fresnel::Schlick);
        let wide = glossy(0.4, 0.3, 0.5, Fresnel::Constant);
        let wo = Vec3::new(-0.6, 0.8, 0.0);
        // Above the point in its mirror direction, facing it, lit so that the light's lobe is toward it.
        let across = Vec3::new(0.6, 0.8, 0.0);
        let facing = Vec3::new(-0.5, -0.85, 0.1).normalize();
        let mirrored = Brdf::lobe_axis(facing, -across);
        let mut worst = 0.0f64;
        let mut cases = 0;
        let pairs = [
            (matte, None),
            (metal, None),
            (plastic, None),
            (matte, Some(metal)),
            (metal, Some(metal)),
            (wide, Some(plastic)),
            (plastic, Some(wide)),
        ];
        // Facing each other, and with the cone cut by one or both horizons.
        let placements = [
            (across, facing),
            (Vec3::new(0.98, 0.2, 0.0).normalize(), facing),
            (across, Vec3::new(0.8, -0.62, 0.0).normalize()),
        ];
        for (dist, radius) in [(2.0, 0.1), (1.0, 0.6), (0.5, 0.7), (0.05, 1.0)] {
            for (receiver, light) in pairs {
                let (direction, normal) = placements[cases % placements.len()];
                cases += 1;
                let x = point(receiver, wo);
                let incoming = match normal == facing {
                    true => mirrored,
                    false => (normal - direction * 0.2).normalize(),
                };
                let sender = light.map(|brdf| sender(brdf, normal, incoming));
                let (offset, sender) = (direction * dist, sender.as_ref());
                let exact = quadrature(&x, offset, radius, normal, sender);
                let (mean, error) = estimated(&x, offset, radius, normal, sender);
                for c in 0..3 {
                    let off = (mean[c] - exact[c]).abs();
                    if exact[c] > 0.0 {
                        worst = worst.max(error[c] / exact[c]);
                    }
                    // Five standard errors, false alarm 6e-7 each, and the quadrature's own error.
                    assert!(
                        off <= 3e-4 * exact[c] + 5.0 * error[c],
                        "{mean:?} ± {error:?} vs {exact:?}: {dist} {radius} {receiver:?} {light:?} {direction} {normal}"
                    );
                }
            }
        }
        assert!(worst < 2e-3, "standard errors up to {worst}");
    }

    #[test]
    fn a_vanishing_radius_gives_the_point_light_on_glossy_surfaces_too() {
        let brdf = glossy(0.3, 0.5, 0.1, Fresnel::Schlick);
        let x = point(brdf, Vec3::new(-0.6, 0.8, 0.0));
        let offset = Vec3::new(1.3, 1.6, 0.1);
        let wi = offset.normalize();
        let normal = Vec3::new(-0.2, -0.9, 0.3).normalize();
        let sender = sender(brdf, normal, (normal + Vec3::X * 0.3).normalize());
        let geometry = x.ns.dot(wi) * -normal.dot(wi) / offset.length_squared();
        let exact = brdf.eval(x.ns, x.wo, wi) * sender.emitted(-wi) * geometry;
        let mut rng = Rng::new(4, 0, 0, Purpose::LightSurface);
        let mut last = f32::INFINITY;
        for radius in [1e-2, 1e-3, 1e-5, 1e-20, 0.0] {
            let cone = Subtended::new(offset, radius, x.ns);
            let value = sphere(&cone, &x, normal, Some(&sender), &mut rng);
            let off = ((value - exact) / exact).abs().x;
            assert!(off <= last.max(1e-5), "radius {radius}: off by {off}");
            last = off;
        }
        assert!(last < 1e-5, "{last}");
    }

    #[test]
    fn stored_lights_shine_like_the_surface_that_they_are_on() {
        let mut set = LightSet::default();
        let brdf = glossy(0.5, 0.3, 0.2, Fresnel::Constant);
        let (normal, incoming) = (Vec3::Y, Vec3::new(0.6, 0.8, 0.0));
        let flux = Vec3::new(2.0, 1.0, 0.0);
        set.push_virtual(&VirtualLight {
            position: Vec3::ZERO,
            normal,
            intensity: flux * brdf.albedo(0.8) / std::f32::consts::PI,
            gloss: Some(light_tree::Gloss {
                incoming,
                normal,
                reflectance: brdf.albedo(0.8),
                diffuse: brdf.diffuse,
                specular: brdf.specular,
                alpha: brdf.alpha,
                is_coat: false,
                peak: 1.0,
            }),
        });
        let sender = GlossySender::of(&set, LightId(0)).expect("is glossy");
        let w = Vec3::new(-0.55, 0.8, 0.1).normalize();
        let sent = set.intensity(LightId(0)) * sender.emitted(w);
        let exact = flux * brdf.eval(normal, incoming, w);
        // Directions are kept to 7·10⁻⁵.
        assert!(
            sent.distance(exact) < 1e-4 * exact.length(),
            "{sent} vs {exact}"
        );
    }
}
