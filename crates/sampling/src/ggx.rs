//! The GGX distribution of microfacet normals.
//!
//! Sources: Walter, Marschner, Li, Torrance, "Microfacet Models for Refraction through Rough Surfaces", 2007; Heitz,
//! "Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs", 2014.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

/// D: density of microfacet normals, projected area per area and sr⁻¹, at an angle θ from the surface normal given by
/// sin²θ in [0, 1]. `alpha2` is the squared roughness, in (0, 1].
///
/// By the sine, because sharp lobes are narrower than what 1 − cos² can tell from 0.
#[inline]
pub fn ggx_density(alpha2: f32, sin2: f32) -> f32 {
    let t = alpha2 * (1.0 - sin2) + sin2;
    alpha2 * FRAC_1_PI / (t * t)
}

/// G₂ / (4 cosₒ cosᵢ) for directions under cosines `cos_o`, `cos_i` ≥ 0 of which one is above 0, with masking and
/// shadowing correlated by height (Heitz 2014, eq. 99).
#[inline]
pub fn ggx_visibility(alpha2: f32, cos_o: f32, cos_i: f32) -> f32 {
    0.5 / (cos_o * ggx_slant(alpha2, cos_i) + cos_i * ggx_slant(alpha2, cos_o))
}

/// G₁ / (4 cosₒ) for a direction under cosine `cos_o` ≥ 0: D times this is the density, sr⁻¹, of directions that
/// [`ggx_visible_normal`] mirrors it into, and also the greatest of D × [`ggx_visibility`] × cosᵢ over all cosᵢ.
#[inline]
pub fn ggx_reflected(alpha2: f32, cos_o: f32) -> f32 {
    0.5 / (cos_o + ggx_slant(alpha2, cos_o))
}

/// √(α² + (1 − α²) cos²).
#[inline]
fn ggx_slant(alpha2: f32, cos: f32) -> f32 {
    (alpha2 + (1.0 - alpha2) * cos * cos).sqrt()
}

/// A microfacet normal as seen from unit `wo`, z being the surface normal and `wo` above the surface: density
/// G₁ max(0, wo·h) D(h) / woz.
///
/// Source: Dupuy and Benyoub, "Sampling Visible GGX Normals with Spherical Caps", 2023.
#[inline]
pub fn ggx_visible_normal(alpha: f32, wo: Vec3, u: [f32; 2]) -> Vec3 {
    let stretched = Vec3::new(wo.x * alpha, wo.y * alpha, wo.z).normalize();
    let z = (1.0 - u[0]) * (1.0 + stretched.z) - stretched.z;
    let r = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
    let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
    let h = Vec3::new(r * cos, r * sin, z) + stretched;
    Vec3::new(h.x * alpha, h.y * alpha, h.z.max(0.0)).normalize_or(Vec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_projected_area_of_all_facets_is_that_of_the_surface() {
        for alpha in [0.03f64, 0.3, 1.0] {
            let steps = 200_000;
            // By x = tan²θ / (α² + tan²θ), which spreads the peak.
            let sum: f64 = (0..steps)
                .map(|i| {
                    let x = (f64::from(i) + 0.5) / f64::from(steps);
                    let tan2 = alpha * alpha * x / (1.0 - x);
                    let (cos2, sin2) = (1.0 / (1.0 + tan2), tan2 / (1.0 + tan2));
                    let d = f64::from(ggx_density((alpha * alpha) as f32, sin2 as f32));
                    // dω cosθ = π d(sin²θ), and d(sin²θ) = cos⁴θ d(tan²θ).
                    let jacobian = alpha * alpha / (1.0 - x).powi(2);
                    d * std::f64::consts::PI * cos2 * cos2 * jacobian
                })
                .sum::<f64>()
                / f64::from(steps);
            assert!((sum - 1.0).abs() < 1e-4, "alpha {alpha}: {sum}");
        }
    }

    #[test]
    fn extreme_numbers_give_unit_normals_above_the_surface() {
        let last = 1.0 - f32::EPSILON / 2.0;
        for alpha in [1e-3, 0.5, 1.0] {
            for wo in [
                Vec3::Z,
                Vec3::new(1.0, 0.0, 1e-7).normalize(),
                Vec3::new(-0.6, 0.0, 0.8),
            ] {
                for u in [[0.0, 0.0], [last, last], [0.0, last], [last, 0.0]] {
                    let h = ggx_visible_normal(alpha, wo, u);
                    let unit = (h.length() - 1.0).abs() < 1e-5;
                    assert!(unit && h.z >= 0.0, "{alpha} {wo} {u:?}: {h}");
                }
            }
        }
    }
}
