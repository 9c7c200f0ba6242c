//! How surfaces reflect: Lambert, with a normalised Phong lobe where the material is glossy.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;
use sampling::{Frame, Rng, cosine_hemisphere, phong_lobe};

/// Reflection at one point. Directions are unit, world space, and leave the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Brdf {
    /// Diffuse reflectance, in [0, 1].
    pub diffuse: Vec3,
    /// Specular reflectance, in [0, 1]; zero for matte surfaces.
    pub specular: Vec3,
    /// Phong exponent of the lobe about the mirror direction.
    pub exponent: f32,
}

/// A direction drawn from a [`Brdf`].
#[derive(Debug, Clone, Copy)]
pub struct BrdfSample {
    /// Where the path goes on.
    pub wi: Vec3,
    /// BRDF × cos / pdf: what the path's strength is multiplied by.
    pub weight: Vec3,
}

impl Brdf {
    /// Whether there is a specular lobe.
    #[inline]
    pub fn is_glossy(&self) -> bool {
        self.specular != Vec3::ZERO
    }

    /// BRDF value in sr⁻¹, cosine not included, for both directions above the horizon of `n`.
    ///
    /// Source: Lafortune and Willems 1994, "Using the Modified Phong Reflectance Model".
    #[inline]
    pub fn eval(&self, n: Vec3, wo: Vec3, wi: Vec3) -> Vec3 {
        let mut value = self.diffuse * FRAC_1_PI;
        if self.is_glossy() {
            value += self.eval_specular(n, wo, wi);
        }
        value
    }

    /// The specular part of [`eval`](Self::eval).
    #[inline]
    pub fn eval_specular(&self, n: Vec3, wo: Vec3, wi: Vec3) -> Vec3 {
        let cos = mirror(n, wo).dot(wi).max(0.0);
        self.specular * (self.lobe_peak() * cos.powf(self.exponent))
    }

    /// Value of the specular lobe along its axis for a reflectance of 1, in sr⁻¹; away from it the value falls
    /// with cosⁿ.
    #[inline]
    pub fn lobe_peak(&self) -> f32 {
        (self.exponent + 2.0) / (2.0 * PI)
    }

    /// Unit axis of the specular lobe: the mirror direction of `wo` about `n`.
    #[inline]
    pub fn lobe_axis(n: Vec3, wo: Vec3) -> Vec3 {
        mirror(n, wo)
    }

    /// Greatest share of arriving light that leaves again, per channel.
    #[inline]
    pub fn albedo_bound(&self) -> Vec3 {
        self.diffuse + self.specular
    }

    /// Probability of the diffuse lobe in [`sample`](Self::sample); 1 when both are black.
    fn diffuse_share(&self) -> f32 {
        {
            let (d, s) = (self.diffuse.element_sum(), self.specular.element_sum());
            if s > 0.0 { d / (d + s) } else { 1.0 }
        }
    }

    /// Draws a direction about in proportion to BRDF × cos; `None` when it falls below the horizon or
    /// nothing is reflected.
    pub fn sample(&self, n: Vec3, wo: Vec3, rng: &mut Rng) -> Option<BrdfSample> {
        let share = self.diffuse_share();
        let lobe = rng.f32();
        let u = [rng.f32(), rng.f32()];
        let wi = if lobe < share {
            Frame::around(n).to_world(cosine_hemisphere(u).0)
        } else {
            Frame::around(mirror(n, wo)).to_world(phong_lobe(self.exponent, u))
        };
        let cos = n.dot(wi);
        let pdf = self.pdf_solid_angle(n, wo, wi);
        if !(cos > 0.0 && pdf > 0.0) {
            return None;
        }
        let weight = self.eval(n, wo, wi) * (cos / pdf);
        (weight != Vec3::ZERO && weight.is_finite()).then_some(BrdfSample { wi, weight })
    }

    /// Density of [`sample`](Self::sample) in sr⁻¹; 0 below the horizon.
    pub fn pdf_solid_angle(&self, n: Vec3, wo: Vec3, wi: Vec3) -> f32 {
        let cos = n.dot(wi);
        if cos <= 0.0 {
            return 0.0;
        }
        let share = self.diffuse_share();
        let diffuse = share * cos * FRAC_1_PI;
        if share >= 1.0 {
            return diffuse;
        }
        let cos_lobe = mirror(n, wo).dot(wi).max(0.0);
        diffuse + (1.0 - share) * (self.exponent + 1.0) / (2.0 * PI) * cos_lobe.powf(self.exponent)
    }
}

/// Mirror direction of `wo` about `n`.
#[inline]
fn mirror(n: Vec3, wo: Vec3) -> Vec3 {
    // Normalised: cosⁿ magnifies a length that is off by rounding.
    (n * (2.0 * n.dot(wo)) - wo).normalize_or(n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sampling::{Purpose, uniform_sphere};

    fn cases() -> Vec<(Brdf, Vec3)> {
        let mut cases = Vec::new();
        for wo in [
            Vec3::Y,
            Vec3::new(0.6, 0.8, 0.0),
            Vec3::new(0.995, 0.1, 0.0).normalize(),
        ] {
            for (diffuse, specular, exponent) in [
                (0.8, 0.0, 1.0),
                (0.3, 0.6, 5.0),
                (0.0, 0.9, 40.0),
                (0.5, 0.04, 256.0),
            ] {
                cases.push((
                    Brdf {
                        diffuse: Vec3::splat(diffuse),
                        specular: Vec3::splat(specular),
                        exponent,
                    },
                    wo,
                ));
            }
        }
        cases
    }

    #[test]
    fn swapping_directions_changes_nothing() {
        let mut rng = Rng::new(1, 0, 0, Purpose::Build);
        for (brdf, wo) in cases() {
            for _ in 0..50 {
                let wi = uniform_sphere([rng.f32() * 0.5, rng.f32()]).abs();
                let (a, b) = (brdf.eval(Vec3::Y, wo, wi).x, brdf.eval(Vec3::Y, wi, wo).x);
                assert!(
                    (a - b).abs() <= 1e-3 * a.max(b) + 1e-6,
                    "{brdf:?}: {a} vs {b}"
                );
            }
        }
    }

    #[test]
    fn no_more_light_leaves_than_arrives_and_the_density_integrates_to_at_most_one() {
        for (brdf, wo) in cases() {
            let n = 200_000;
            let mut rng = Rng::new(2, 0, 0, Purpose::Build);
            let (mut reflected, mut mass) = (0.0f64, 0.0f64);
            for _ in 0..n {
                let wi = uniform_sphere([rng.f32(), rng.f32()]);
                if wi.y > 0.0 {
                    reflected +=
                        f64::from(brdf.eval(Vec3::Y, wo, wi).x * wi.y) * 4.0 * std::f64::consts::PI;
                    mass += f64::from(brdf.pdf_solid_angle(Vec3::Y, wo, wi))
                        * 4.0
                        * std::f64::consts::PI;
                }
            }
            let (reflected, mass) = (reflected / f64::from(n), mass / f64::from(n));
            let limit = f64::from(brdf.albedo_bound().x);
            // The sharpest lobe has a relative deviation of about 8 per draw: 0.02 of its share.
            assert!(
                reflected <= limit + 0.03,
                "{brdf:?}: reflects {reflected} of {limit}"
            );
            assert!(mass <= 1.03, "{brdf:?}: density integrates to {mass}");
        }
    }

    #[test]
    fn sampled_weights_average_to_the_reflected_share() {
        for (brdf, wo) in cases() {
            let n = 60_000;
            let mut rng = Rng::new(3, 0, 0, Purpose::Build);
            let mean = (0..n)
                .map(|_| {
                    f64::from(
                        brdf.sample(Vec3::Y, wo, &mut rng)
                            .map_or(0.0, |s| s.weight.x),
                    )
                })
                .sum::<f64>()
                / f64::from(n);
            // Quadrature on a fine grid of the sphere's upper half.
            let (mut exact, steps) = (0.0f64, 700);
            for i in 0..steps {
                for j in 0..steps {
                    let u = [
                        (i as f32 + 0.5) / steps as f32,
                        (j as f32 + 0.5) / steps as f32,
                    ];
                    let (local, pdf) = cosine_hemisphere(u);
                    let wi = Vec3::new(local.x, local.z, local.y);
                    exact += f64::from(brdf.eval(Vec3::Y, wo, wi).x * wi.y / pdf);
                }
            }
            exact /= f64::from(steps * steps);
            assert!(
                (mean - exact).abs() < 0.01,
                "{brdf:?} seen along {wo}: {mean} vs {exact}"
            );
        }
    }
}
