//! How much a GGX surface with Fresnel reflection sends back, for the light that is left to what lies below it.

use std::sync::LazyLock;

use glam::Vec3;
use sampling::{ggx_reflected, ggx_visibility, ggx_visible_normal};

/// Cosines and roughnesses tabulated; between them values differ from the integral by less than 3·10⁻³.
const COSINES: usize = 64;
const ROUGHNESSES: usize = 32;
/// Facets an entry is the mean over, in each of two dimensions.
const FACETS: usize = 16;

/// Share of light reflected, split by Schlick's formula: F₀ × (`all` − `grazing`) + `grazing`.
#[derive(Debug, Clone, Copy, Default)]
struct Share {
    /// With F = 1.
    all: f32,
    /// With F = (1 − cos)⁵.
    grazing: f32,
}

impl Share {
    fn lerp(self, other: Self, t: f32) -> Self {
        Self {
            all: self.all + (other.all - self.all) * t,
            grazing: self.grazing + (other.grazing - self.grazing) * t,
        }
    }

    fn with(self, normal_incidence: Vec3) -> Vec3 {
        normal_incidence * (self.all - self.grazing) + self.grazing
    }
}

/// Shares by cosine and roughness, and their cosine-weighted means by roughness.
struct Table {
    shares: Vec<[Share; COSINES]>,
    means: Vec<Share>,
}

/// Made when the first coated surface is seen, in some ten milliseconds.
static TABLE: LazyLock<Table> = LazyLock::new(|| {
    let shares: Vec<[Share; COSINES]> = (0..ROUGHNESSES)
        .map(|j| {
            let alpha = (j as f32 / (ROUGHNESSES - 1) as f32).max(super::brdf::LEAST_ALPHA);
            std::array::from_fn(|i| integrate(i as f32 / (COSINES - 1) as f32, alpha))
        })
        .collect();
    let mean = |row: &[Share; COSINES]| {
        let mut sum = Share::default();
        for pair in 0..COSINES - 1 {
            // Simpson's rule on the product of the cosine and a share that is linear in it is exact.
            let at = |t: f32| {
                let share = row[pair].lerp(row[pair + 1], t);
                let cos = (pair as f32 + t) / (COSINES - 1) as f32;
                (2.0 * cos * share.all, 2.0 * cos * share.grazing)
            };
            let (a, b, c) = (at(0.0), at(0.5), at(1.0));
            let width = 1.0 / (6.0 * (COSINES - 1) as f32);
            sum.all += width * (a.0 + 4.0 * b.0 + c.0);
            sum.grazing += width * (a.1 + 4.0 * b.1 + c.1);
        }
        sum
    };
    let means = shares.iter().map(mean).collect();
    Table { shares, means }
});

/// Mean over the facets that are seen under cosine `cos`: BRDF × cosᵢ over the density of reflected directions.
fn integrate(cos: f32, alpha: f32) -> Share {
    let cos = cos.max(1e-4);
    let wo = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
    let mut sum = Share::default();
    for k in 0..FACETS * FACETS {
        let at = |i: usize| (i as f32 + 0.5) / FACETS as f32;
        let h = ggx_visible_normal(alpha, wo, [at(k / FACETS), at(k % FACETS)]);
        let cos_h = wo.dot(h);
        let cos_i = 2.0 * cos_h * h.z - wo.z;
        if cos_i > 0.0 {
            let alpha2 = alpha * alpha;
            let weight = ggx_visibility(alpha2, cos, cos_i) * cos_i / ggx_reflected(alpha2, cos);
            sum.all += weight;
            sum.grazing += weight * (1.0 - cos_h).clamp(0.0, 1.0).powi(5);
        }
    }
    let count = (FACETS * FACETS) as f32;
    Share {
        all: sum.all / count,
        grazing: sum.grazing / count,
    }
}

/// Index of the entry below `x` in [0, 1] of `count` entries, and how far behind it `x` lies.
fn place(x: f32, count: usize) -> (usize, f32) {
    let at = x.clamp(0.0, 1.0) * (count - 1) as f32;
    let below = (at as usize).min(count - 2);
    (below, at - below as f32)
}

/// Share of light arriving under cosine `cos` that GGX facets of roughness `alpha` reflect once, where Schlick's
/// formula gives `normal_incidence` for light along a facet's normal. Each channel in [0, 1].
pub(crate) fn reflected(normal_incidence: Vec3, cos: f32, alpha: f32) -> Vec3 {
    let table = &*TABLE;
    let ((j, s), (i, t)) = (place(alpha, ROUGHNESSES), place(cos, COSINES));
    let row = |j: usize| table.shares[j][i].lerp(table.shares[j][i + 1], t);
    let share = row(j).lerp(row(j + 1), s).with(normal_incidence);
    share.clamp(Vec3::ZERO, Vec3::ONE)
}

/// The same for light from everywhere alike: the mean over cosines, weighted by them.
pub(crate) fn mean_reflected(normal_incidence: Vec3, alpha: f32) -> Vec3 {
    let (j, s) = place(alpha, ROUGHNESSES);
    let mean = TABLE.means[j].lerp(TABLE.means[j + 1], s);
    mean.with(normal_incidence).clamp(Vec3::ZERO, Vec3::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smooth_coat_reflects_by_schlicks_formula() {
        for cos in [0.1f32, 0.3, 0.7, 1.0] {
            let exact = 0.04 + 0.96 * (1.0 - cos).powi(5);
            let share = reflected(Vec3::splat(0.04), cos, 1e-3).x;
            assert!(
                (share - exact).abs() < 3e-3,
                "cos {cos}: {share} vs {exact}"
            );
        }
    }

    #[test]
    fn the_mean_is_the_integral_over_cosines() {
        for alpha in [0.05, 0.4, 1.0] {
            let steps = 1000;
            let cosines = (0..steps).map(|i| (i as f32 + 0.5) / steps as f32);
            let terms = cosines.map(|cos| 2.0 * cos * reflected(Vec3::splat(0.04), cos, alpha).x);
            let mean = terms.sum::<f32>() / steps as f32;
            let tabulated = mean_reflected(Vec3::splat(0.04), alpha).x;
            assert!((mean - tabulated).abs() < 1e-4, "{mean} vs {tabulated}");
        }
    }
}
