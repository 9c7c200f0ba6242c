//! How surfaces reflect: Lambert, and a GGX lobe where the material is glossy.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;
use sampling::{
    Frame, Rng, cosine_hemisphere, ggx_density, ggx_reflected, ggx_visibility, ggx_visible_normal,
};

use crate::coat;

/// Least roughness: a lobe a tenth of a degree wide, which f32 directions still resolve.
pub(crate) const LEAST_ALPHA: f32 = 1e-3;

/// How the specular reflectance depends on the angle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Fresnel {
    /// Not at all: the specular lobe lies beside the diffuse one, and reflectances add up.
    #[default]
    Constant,
    /// Schlick's formula, up to 1 at grazing angles. The diffuse part lies below: it gets what the facets let in, and
    /// sends back what they let out, so that no more leaves than arrives (Kelemen and Szirmay-Kalos 2001).
    Schlick,
}

/// Reflection at one point. Directions are unit, world space, and leave the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Brdf {
    /// Diffuse reflectance, in [0, 1].
    pub diffuse: Vec3,
    /// Specular reflectance of a facet that faces the light, in [0, 1]. With [`Fresnel::Constant`] no channel
    /// of `diffuse` + `specular` is above 1, and zero means matte.
    pub specular: Vec3,
    /// GGX roughness α of the specular lobe, in [0.001, 1].
    pub alpha: f32,
    /// How `specular` depends on the angle.
    pub fresnel: Fresnel,
}

/// A direction drawn from a [`Brdf`].
#[derive(Debug, Clone, Copy)]
pub struct BrdfSample {
    /// Where the path goes on.
    pub wi: Vec3,
    /// BRDF × cos / pdf: what the path's strength is multiplied by.
    pub weight: Vec3,
}

/// What the specular lobe reflects at most, BRDF × cosine, by how far a direction is from the mirror direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LobeBound {
    /// Times the density of facets, sr⁻¹, for the directions of a sharp lobe.
    pub near: Vec3,
    /// Added for facets far off the normal, where Schlick's formula may reach 1.
    pub far: Vec3,
    /// Least sin² of the angle between the normal and such facets.
    pub far_sin2: f32,
    /// Squared roughness: the least and the greatest of the surfaces that the bound holds for.
    pub alpha2: [f32; 2],
    /// Times this the bound holds for the BRDF without the cosine.
    pub per_cosine: f32,
}

impl LobeBound {
    /// Upper bound of BRDF × cosine, sr⁻¹, for directions whose cosine with the mirror direction is at most `cos`,
    /// in [−1, 1].
    ///
    /// Turning a facet by θ turns what it mirrors by at most 2θ, so directions at γ from the mirror direction need a
    /// facet at least γ/2 off the normal.
    #[inline]
    pub fn value(&self, cos: f32) -> Vec3 {
        // Less what rounding of a cosine near 1 takes: a tenth of the sharpest lobe's α².
        let sin2 = (0.5 * (1.0 - cos) - 1e-7).max(0.0);
        let mut bound = self.near * self.density(sin2);
        if self.far != Vec3::ZERO {
            bound += self.far * self.density(sin2.max(self.far_sin2));
        }
        bound
    }

    /// The greatest density of facets of any of the roughnesses: over α² it has one maximum, at tan²θ.
    fn density(&self, sin2: f32) -> f32 {
        let [least, greatest] = self.alpha2;
        ggx_density((sin2 / (1.0 - sin2)).clamp(least, greatest), sin2)
    }

    /// A bound for both surfaces.
    pub fn max(&self, other: &Self) -> Self {
        Self {
            near: self.near.max(other.near),
            far: self.far.max(other.far),
            far_sin2: self.far_sin2.min(other.far_sin2),
            alpha2: [
                self.alpha2[0].min(other.alpha2[0]),
                self.alpha2[1].max(other.alpha2[1]),
            ],
            per_cosine: self.per_cosine.max(other.per_cosine),
        }
    }
}

impl Brdf {
    /// Matte, of `diffuse` reflectance.
    pub const fn lambert(diffuse: Vec3) -> Self {
        Self {
            diffuse,
            specular: Vec3::ZERO,
            alpha: 1.0,
            fresnel: Fresnel::Constant,
        }
    }

    /// Whether there is a specular lobe.
    #[inline]
    pub fn is_glossy(&self) -> bool {
        self.specular != Vec3::ZERO || self.fresnel == Fresnel::Schlick
    }

    /// BRDF value in sr⁻¹, cosine not included, for both directions above the horizon of `n`.
    #[inline]
    pub fn eval(&self, n: Vec3, wo: Vec3, wi: Vec3) -> Vec3 {
        if !self.is_glossy() {
            return self.diffuse * FRAC_1_PI;
        }
        self.eval_diffuse(n, wo, wi) + self.eval_specular(n, wo, wi)
    }

    /// The diffuse part of [`eval`](Self::eval).
    #[inline]
    pub fn eval_diffuse(&self, n: Vec3, wo: Vec3, wi: Vec3) -> Vec3 {
        let value = self.diffuse * FRAC_1_PI;
        if self.fresnel == Fresnel::Constant || value == Vec3::ZERO {
            return value;
        }
        value * self.let_in(n.dot(wo)) * (Vec3::ONE - self.facets_reflect(n.dot(wi)))
    }

    /// Share of light under cosine `cos` that reaches what lies below the facets, over the mean of that share.
    fn let_in(&self, cos: f32) -> Vec3 {
        let mean = Vec3::ONE - coat::mean_reflected(self.specular, self.alpha);
        // A mirror lets nothing in: neither the numerator.
        (Vec3::ONE - self.facets_reflect(cos)) / mean.max(Vec3::splat(1e-3))
    }

    fn facets_reflect(&self, cos: f32) -> Vec3 {
        coat::reflected(self.specular, cos, self.alpha)
    }

    /// The specular part of [`eval`](Self::eval): F D G / (4 cosₒ cosᵢ). 0 when a direction is not above the horizon.
    ///
    /// Source: Walter, Marschner, Li, Torrance 2007, eq. (20).
    #[inline]
    pub fn eval_specular(&self, n: Vec3, wo: Vec3, wi: Vec3) -> Vec3 {
        let (cos_o, cos_i) = (n.dot(wo), n.dot(wi));
        if !(cos_o > 0.0 && cos_i > 0.0) {
            return Vec3::ZERO;
        }
        let h = (wo + wi).normalize_or(n);
        let alpha2 = self.alpha * self.alpha;
        let value = ggx_density(alpha2, sin2(n, h)) * ggx_visibility(alpha2, cos_o, cos_i);
        self.facet(wo.dot(h)) * value
    }

    /// What a facet reflects of light that meets it under cosine `cos`.
    #[inline]
    fn facet(&self, cos: f32) -> Vec3 {
        match self.fresnel {
            Fresnel::Constant => self.specular,
            Fresnel::Schlick => {
                let grazing = (1.0 - cos).clamp(0.0, 1.0).powi(5);
                self.specular + (Vec3::ONE - self.specular) * grazing
            }
        }
    }

    /// Unit axis of the specular lobe: the mirror direction of `wo` about `n`.
    #[inline]
    pub fn lobe_axis(n: Vec3, wo: Vec3) -> Vec3 {
        (n * (2.0 * n.dot(wo)) - wo).normalize_or(n)
    }

    /// What the specular lobe sends at most to a viewer under cosine `cos_o`; see [`LobeBound`].
    pub fn lobe_bound(&self, cos_o: f32) -> LobeBound {
        let cos_o = cos_o.clamp(0.0, 1.0);
        let alpha2 = self.alpha * self.alpha;
        // The facets up to tan θ = 2 α have all but a 25th of the peak's density. The light they mirror meets them
        // under at most the viewer's angle and their own.
        let far_sin2 = 4.0 * alpha2 / (1.0 + 4.0 * alpha2);
        let sin_o = ((1.0 - cos_o) * (1.0 + cos_o)).max(0.0).sqrt();
        let cos_h = cos_o * (1.0 - far_sin2).sqrt() - sin_o * far_sin2.sqrt();
        let near = self.facet(cos_h);
        let far = match self.fresnel {
            Fresnel::Constant => Vec3::ZERO,
            Fresnel::Schlick => Vec3::ONE - near,
        };
        let reflected = ggx_reflected(alpha2, cos_o);
        LobeBound {
            near: near * reflected,
            far: far * reflected,
            far_sin2,
            alpha2: [alpha2; 2],
            // For cosᵢ → 0 the visibility tends to 1 / (2 α cosₒ).
            per_cosine: 0.5 / (self.alpha * cos_o.max(1e-6) * reflected),
        }
    }

    /// Upper bound of the diffuse part's value, sr⁻¹, for a viewer under cosine `cos_o`.
    pub fn diffuse_bound(&self, cos_o: f32) -> Vec3 {
        let value = self.diffuse * FRAC_1_PI;
        match self.fresnel {
            Fresnel::Schlick if value != Vec3::ZERO => value * self.let_in(cos_o),
            _ => value,
        }
    }

    /// Share of light from a direction under cosine `cos` ≥ 0 that leaves again, per channel; of a specular lobe of
    /// constant reflectance an upper bound.
    pub fn albedo(&self, cos: f32) -> Vec3 {
        match self.fresnel {
            Fresnel::Constant => self.diffuse + self.specular,
            Fresnel::Schlick => {
                let facets = self.facets_reflect(cos);
                facets + self.diffuse * (Vec3::ONE - facets)
            }
        }
    }

    /// Probability of the diffuse lobe in [`sample`](Self::sample) for a viewer under cosine `cos_o`; 1 when both are
    /// black.
    fn diffuse_share(&self, cos_o: f32) -> f32 {
        if !self.is_glossy() {
            return 1.0;
        }
        let (diffuse, specular) = match self.fresnel {
            Fresnel::Constant => (self.diffuse, self.specular),
            Fresnel::Schlick => {
                let facets = self.facets_reflect(cos_o);
                (self.diffuse * (Vec3::ONE - facets), facets)
            }
        };
        let (d, s) = (diffuse.element_sum(), specular.element_sum());
        if s > 0.0 { d / (d + s) } else { 1.0 }
    }

    /// Draws a direction about in proportion to BRDF × cos; `None` when it falls below the horizon or
    /// nothing is reflected.
    pub fn sample(&self, n: Vec3, wo: Vec3, rng: &mut Rng) -> Option<BrdfSample> {
        let share = self.diffuse_share(n.dot(wo));
        let lobe = rng.f32();
        let u = [rng.f32(), rng.f32()];
        let wi = if lobe < share {
            Frame::around(n).to_world(cosine_hemisphere(u).0)
        } else {
            self.sample_specular(n, wo, u)
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
        let share = self.diffuse_share(n.dot(wo));
        let diffuse = share * cos * FRAC_1_PI;
        if share >= 1.0 {
            return diffuse;
        }
        diffuse + (1.0 - share) * self.pdf_specular(n, wo, wi)
    }

    /// Mirrors `wo`, above the horizon of `n`, in a facet that it sees; the direction may lie below the horizon.
    #[inline]
    pub fn sample_specular(&self, n: Vec3, wo: Vec3, u: [f32; 2]) -> Vec3 {
        let frame = Frame::around(n);
        let local = Vec3::new(frame.t.dot(wo), frame.b.dot(wo), n.dot(wo));
        let h = frame.to_world(ggx_visible_normal(self.alpha, local, u));
        (h * (2.0 * h.dot(wo)) - wo).normalize_or(n)
    }

    /// Greatest value of [`pdf_specular`](Self::pdf_specular) for a viewer under cosine `cos_o`, sr⁻¹.
    pub fn greatest_specular_pdf(&self, cos_o: f32) -> f32 {
        let alpha2 = self.alpha * self.alpha;
        ggx_density(alpha2, 0.0) * ggx_reflected(alpha2, cos_o.max(0.0))
    }

    /// Density of [`sample_specular`](Self::sample_specular) in sr⁻¹, for `wi` above the horizon; 0 when `wo` is not.
    #[inline]
    pub fn pdf_specular(&self, n: Vec3, wo: Vec3, wi: Vec3) -> f32 {
        let cos_o = n.dot(wo);
        if cos_o <= 0.0 {
            return 0.0;
        }
        let alpha2 = self.alpha * self.alpha;
        let h = (wo + wi).normalize_or(n);
        ggx_density(alpha2, sin2(n, h)) * ggx_reflected(alpha2, cos_o)
    }
}

/// Squared sine of the angle between unit vectors, to full precision where they are close.
#[inline]
fn sin2(n: Vec3, h: Vec3) -> f32 {
    n.cross(h).length_squared().min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::Texels;
    use crate::{Channel, Material, TextureId};
    use sampling::{Extreme, Purpose, uniform_sphere};
    use verify::chi_square;

    const N: Vec3 = Vec3::Y;

    fn viewers() -> Vec<Vec3> {
        [0.0f32, 37.0, 75.0, 88.0]
            .iter()
            .map(|degrees| {
                let t = degrees.to_radians();
                Vec3::new(t.sin() * 0.8, t.cos(), t.sin() * 0.6).normalize()
            })
            .collect()
    }

    /// What maps make of a material at single points.
    fn textured() -> Vec<Brdf> {
        let map = Some(Channel {
            texture: TextureId(0),
            index: 0,
        });
        let painted_metal = Material {
            diffuse: Vec3::new(1.0, 0.8, 0.6),
            alpha: 1.0,
            metallic: Some(1.0),
            roughness_map: map,
            metallic_map: map,
            ..Material::default()
        };
        let polish = Material {
            diffuse: Vec3::splat(0.9),
            specular: Vec3::splat(0.5),
            alpha: 0.5,
            roughness_map: map,
            ..Material::default()
        };
        let at = |material: &Material, diffuse, roughness, metallic| {
            material.brdf(&Texels {
                diffuse: Vec3::splat(diffuse),
                roughness,
                metallic,
            })
        };
        vec![
            at(&painted_metal, 0.9, 0.4, 0.25),
            at(&painted_metal, 0.5, 0.8, 0.5),
            at(&painted_metal, 1.0, 0.6, 1.0),
            // Together above what arrives.
            at(&polish, 1.0, 1.0, 1.0),
            at(&polish, 0.2, 0.5, 1.0),
        ]
    }

    fn brdfs() -> Vec<Brdf> {
        let mut all = textured();
        all.push(Brdf::lambert(Vec3::splat(0.8)));
        for alpha in [LEAST_ALPHA, 0.05, 0.3, 1.0] {
            for (diffuse, specular, fresnel) in [
                (0.0, 1.0, Fresnel::Constant),
                (0.6, 0.4, Fresnel::Constant),
                (1.0, 0.04, Fresnel::Schlick),
                (0.0, 0.6, Fresnel::Schlick),
            ] {
                all.push(Brdf {
                    diffuse: Vec3::new(diffuse, 0.5 * diffuse, 0.0),
                    specular: Vec3::new(specular, 0.3 * specular, 0.0),
                    alpha,
                    fresnel,
                });
            }
        }
        all
    }

    #[test]
    fn extreme_random_numbers_give_unit_directions_and_finite_weights() {
        for brdf in brdfs() {
            for wo in viewers() {
                for number in [Extreme::Zero, Extreme::BelowOne] {
                    let Some(sample) = brdf.sample(N, wo, &mut Rng::extreme(number)) else {
                        continue;
                    };
                    let BrdfSample { wi, weight } = sample;
                    let told = || format!("{brdf:?}, {wo}, {number:?}: {sample:?}");
                    assert!(wi.is_normalized() && wi.dot(N) > 0.0, "{}", told());
                    let sound = weight.is_finite() && weight.min_element() >= 0.0;
                    assert!(sound && weight.max_element() < 10.0, "{}", told());
                }
            }
        }
    }

    #[test]
    fn swapping_directions_changes_nothing() {
        let mut rng = Rng::new(1, 0, 0, Purpose::Build);
        for brdf in brdfs() {
            for wo in viewers() {
                for k in 0..50 {
                    let wi = match k % 2 {
                        0 => uniform_sphere([rng.f32() * 0.5, rng.f32()]).abs(),
                        _ => brdf.sample_specular(N, wo, [rng.f32(), rng.f32()]),
                    };
                    if N.dot(wi) > 0.0 {
                        let (a, b) = (brdf.eval(N, wo, wi), brdf.eval(N, wi, wo));
                        let near = (a - b).abs().cmple(1e-4 * a.max(b) + 1e-7).all();
                        assert!(near, "{brdf:?}: {a} vs {b}");
                    }
                }
            }
        }
    }

    #[test]
    fn no_more_light_leaves_than_arrives_and_little_is_lost() {
        for brdf in brdfs() {
            for wo in viewers() {
                let steps = 300;
                let mut rng = Rng::new(2, 0, 0, Purpose::Build);
                let (mut sum, n) = (glam::DVec3::ZERO, steps * steps);
                for _ in 0..n {
                    if let Some(s) = brdf.sample(N, wo, &mut rng) {
                        sum += s.weight.as_dvec3();
                    }
                }
                let albedo = (sum / f64::from(n)).as_vec3();
                let most = brdf.albedo(N.dot(wo));
                // Weights of at most about 2 and a deviation below 0.5: 0.01 is 6 sigma of 90,000 draws, false alarm
                // 1e-9 each.
                let excess = (albedo - most).max_element();
                assert!(excess < 0.01, "{brdf:?} along {wo}: {albedo} of {most}");
                assert!(albedo.max_element() < 1.01, "{brdf:?}: {albedo}");
                // Light that meets a second facet is lost: most where many are steep. At α = 0.3 and normal incidence
                // quadrature of the formula itself gives 0.877, at α = 1 it gives 0.307.
                let kept = match brdf.alpha {
                    a if a <= 0.05 => 0.85,
                    a if a <= 0.3 => 0.77,
                    _ => 0.28,
                };
                let least = (albedo - most * kept).min_element();
                assert!(least > -0.01, "{brdf:?} along {wo}: {albedo} of {most}");
            }
        }
    }

    /// Directions are counted by the facet that mirrors them: evenly over x = tan² / (α² + tan²) of its angle, and
    /// over its azimuth. Such bins follow a lobe of any width.
    struct Bins {
        alpha2: f64,
        frame: Frame,
        wo: Vec3,
    }

    impl Bins {
        const SIDE: usize = 10;

        fn of(&self, wi: Vec3) -> usize {
            let h = (self.wo + wi).as_dvec3();
            let [t, b, n] = [self.frame.t, self.frame.b, self.frame.n].map(|a| a.as_dvec3().dot(h));
            let tan2 = (t * t + b * b) / (n * n);
            let x = tan2 / (self.alpha2 + tan2);
            let turn = b.atan2(t) / std::f64::consts::TAU + 0.5;
            let place = |s: f64| ((s * Self::SIDE as f64) as usize).min(Self::SIDE - 1);
            place(x) * Self::SIDE + place(turn)
        }

        /// Integrals of `pdf` over the bins: one point at random in each cell of a fine grid, which the horizon cuts
        /// without favour.
        fn integrals(&self, pdf: impl Fn(Vec3) -> f32) -> Vec<f64> {
            let mut rng = Rng::new(8, 0, 0, Purpose::Build);
            const STEPS: usize = 48;
            let mut masses = vec![0.0; Self::SIDE * Self::SIDE];
            let fine = Self::SIDE * STEPS;
            for i in 0..fine {
                for j in 0..fine {
                    let x = (i as f64 + rng.f64()) / fine as f64;
                    let tan2 = self.alpha2 * x / (1.0 - x);
                    let cos = 1.0 / (1.0 + tan2).sqrt();
                    let sin = (tan2 / (1.0 + tan2)).sqrt();
                    // dω = dφ d(cos), by way of tan² and x.
                    let per_x = 0.5 * cos.powi(3) * self.alpha2 / (1.0 - x).powi(2);
                    let phi = std::f64::consts::TAU * ((j as f64 + rng.f64()) / fine as f64 - 0.5);
                    let local = glam::DVec3::new(sin * phi.cos(), sin * phi.sin(), cos);
                    let h = self.frame.to_world(local.as_vec3()).normalize();
                    let cos_h = h.dot(self.wo);
                    let wi = h * (2.0 * cos_h) - self.wo;
                    if cos_h > 0.0 && N.dot(wi) > 0.0 {
                        let solid = 4.0 * f64::from(cos_h) * per_x * std::f64::consts::TAU;
                        masses[i / STEPS * Self::SIDE + j / STEPS] +=
                            f64::from(pdf(wi)) * solid / (fine * fine) as f64;
                    }
                }
            }
            masses
        }
    }

    #[test]
    fn directions_are_drawn_with_the_density_that_is_told() {
        let cases = brdfs().len() * viewers().len();
        // No bins tell the sharpest lobe and what is diffuse.
        let even = |brdf: &Brdf| brdf.alpha > LEAST_ALPHA || brdf.diffuse == Vec3::ZERO;
        for (k, brdf) in brdfs().into_iter().filter(even).enumerate() {
            for wo in viewers() {
                let bins = Bins {
                    // Wide enough to tell diffuse directions apart, narrow enough for the lobe.
                    alpha2: match brdf.diffuse == Vec3::ZERO {
                        true => f64::from(brdf.alpha).powi(2),
                        false => f64::from(brdf.alpha.max(0.15)).powi(2),
                    },
                    frame: Frame::around(N),
                    wo,
                };
                let mut expected = bins.integrals(|wi| brdf.pdf_solid_angle(N, wo, wi));
                let lost = (1.0 - expected.iter().sum::<f64>()).max(0.0);
                let mut observed = vec![0u64; expected.len() + 1];
                expected.push(lost);
                let mut rng = Rng::new(7, k as u64, 0, Purpose::Build);
                for _ in 0..40_000 {
                    let bin = brdf.sample(N, wo, &mut rng).map(|s| bins.of(s.wi));
                    observed[bin.unwrap_or(Bins::SIDE * Bins::SIDE)] += 1;
                }
                let test = chi_square(&observed, &expected);
                // All cases together: false alarm 1e-4.
                assert!(
                    test.p_value > 1e-4 / cases as f64,
                    "{brdf:?} along {wo}: {test:?}"
                );
            }
        }
    }

    #[test]
    fn no_value_exceeds_the_bounds() {
        let mut rng = Rng::new(3, 0, 0, Purpose::Build);
        for brdf in brdfs() {
            for wo in viewers() {
                let cos_o = N.dot(wo);
                let (lobe, diffuse) = (brdf.lobe_bound(cos_o), brdf.diffuse_bound(cos_o));
                for k in 0..400 {
                    let wi = match k % 2 {
                        0 => uniform_sphere([rng.f32() * 0.5, rng.f32()]).abs(),
                        _ => brdf.sample_specular(N, wo, [rng.f32(), rng.f32()]),
                    };
                    let cos = N.dot(wi);
                    if cos <= 0.0 {
                        continue;
                    }
                    let bound = lobe.value(Brdf::lobe_axis(N, wo).dot(wi));
                    let value = brdf.eval_specular(N, wo, wi);
                    let held = (value * cos).cmple(bound * 1.002 + 1e-9).all();
                    assert!(held, "{brdf:?}: {value} × {cos} above {bound}");
                    let held = value.cmple(bound * lobe.per_cosine * 1.002 + 1e-9).all();
                    assert!(
                        held,
                        "{brdf:?}: {value} above {bound} × {}",
                        lobe.per_cosine
                    );
                    let value = brdf.eval_diffuse(N, wo, wi);
                    assert!(value.cmple(diffuse * 1.0001).all(), "{value} of {diffuse}");
                }
            }
        }
    }
}
