//! Warps of the unit square to directions, each beside its density.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

/// An orthonormal frame around a unit vector `n`.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// First tangent.
    pub t: Vec3,
    /// Second tangent.
    pub b: Vec3,
    /// The axis.
    pub n: Vec3,
}

impl Frame {
    /// Frame around unit `n` (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
    #[inline]
    pub fn around(n: Vec3) -> Self {
        let (t, b) = n.any_orthonormal_pair();
        Self { t, b, n }
    }

    /// A vector given in this frame, in world space.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.t * v.x + self.b * v.y + self.n * v.z
    }
}

/// Uniform over the unit sphere; density 1/(4π) sr⁻¹.
#[inline]
pub fn uniform_sphere(u: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u[0];
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

/// Direction about +z with density cosθ/π sr⁻¹; returns it with its density (never 0: z > 0).
#[inline]
pub fn cosine_hemisphere(u: [f32; 2]) -> (Vec3, f32) {
    // 1 - u lies in (0, 1], so z is never 0.
    let z = (1.0 - u[0]).sqrt();
    let r = u[0].sqrt();
    let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
    (Vec3::new(r * cos, r * sin, z), z * FRAC_1_PI)
}

/// Uniform over the cone about +z with `one_minus_cos` = 1 − cos(half angle) in (0, 1];
/// density 1/(2π · one_minus_cos) sr⁻¹.
///
/// Takes 1 − cos rather than cos: for narrow cones an f32 cosine rounds to 1.
#[inline]
pub fn uniform_cone(one_minus_cos: f32, u: [f32; 2]) -> Vec3 {
    cone_direction(one_minus_cos, u[0], turn(u[1]))
}

/// [`uniform_cone`] of `u` and the number of which `turn` is the [`turn`].
#[inline(always)]
pub fn cone_direction(one_minus_cos: f32, u: f32, [sin, cos]: [f32; 2]) -> Vec3 {
    let h = u * one_minus_cos;
    let z = 1.0 - h;
    let r = (h * (2.0 - h)).max(0.0).sqrt();
    Vec3::new(r * cos, r * sin, z)
}

/// Sine and cosine of the share `u` of a full turn.
#[inline]
pub fn turn(u: f32) -> [f32; 2] {
    let (sin, cos) = (2.0 * PI * u).sin_cos();
    [sin, cos]
}

/// A point uniform over the unit disc.
#[inline]
pub fn uniform_disc(u: [f32; 2]) -> [f32; 2] {
    let r = u[0].sqrt();
    let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
    [r * cos, r * sin]
}

/// Barycentric weights of the second and third corner of a point uniform over a triangle.
///
/// Source: Turk 1990, "Generating Random Points in Triangles", Graphics Gems.
#[inline]
pub fn uniform_triangle(u: [f32; 2]) -> [f32; 2] {
    let root = u[0].sqrt();
    [root * (1.0 - u[1]), root * u[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Purpose, Rng};

    /// Mean of z over 40,000 draws against its exact value; 5 sigma, false alarm 6e-7 each.
    fn check_mean_z(what: &str, exact: f64, sd: f64, mut draw: impl FnMut([f32; 2]) -> Vec3) {
        let n = 40_000;
        let mut rng = Rng::new(7, 0, 0, Purpose::Build);
        let mut sum = 0.0;
        for _ in 0..n {
            let v = draw([rng.f32(), rng.f32()]);
            assert!((v.length() - 1.0).abs() < 1e-5, "{what}: not unit: {v}");
            sum += f64::from(v.z);
        }
        let z = (sum / f64::from(n) - exact) / (sd / f64::from(n).sqrt());
        assert!(z.abs() < 5.0, "{what}: z = {z}");
    }

    #[test]
    fn means_of_z_match_their_integrals() {
        check_mean_z("sphere", 0.0, (1.0f64 / 3.0).sqrt(), uniform_sphere);
        check_mean_z("cosine", 2.0 / 3.0, (1.0f64 / 18.0).sqrt(), |u| {
            cosine_hemisphere(u).0
        });
        check_mean_z("cone", 0.75, 0.5 / 12.0f64.sqrt(), |u| uniform_cone(0.5, u));
    }

    #[test]
    fn points_fill_a_triangle_and_a_disc_evenly() {
        // The triangle in four: each gets a quarter, within 5 sigma of 40,000 draws.
        let mut rng = Rng::new(8, 0, 0, Purpose::Build);
        let mut counts = [0i32; 4];
        for _ in 0..40_000 {
            let [a, b] = uniform_triangle([rng.f32(), rng.f32()]);
            assert!(a >= 0.0 && b >= 0.0 && a + b <= 1.0 + 1e-6, "{a}, {b}");
            let corner = [a > 0.5, b > 0.5, a + b < 0.5];
            counts[corner.iter().position(|c| *c).unwrap_or(3)] += 1;
        }
        assert!(
            counts.iter().all(|c| i32::abs(c - 10_000) < 433),
            "{counts:?}"
        );
        // The disc in four rings of equal area.
        let mut counts = [0i32; 4];
        for _ in 0..40_000 {
            let [x, y] = uniform_disc([rng.f32(), rng.f32()]);
            counts[((x * x + y * y) * 4.0).min(3.0) as usize] += 1;
        }
        assert!(
            counts.iter().all(|c| i32::abs(c - 10_000) < 433),
            "{counts:?}"
        );
    }

    #[test]
    fn extreme_numbers_stay_on_the_sphere() {
        let last = 1.0 - f32::EPSILON / 2.0;
        for u in [[0.0, 0.0], [last, last], [0.0, last], [last, 0.0]] {
            for v in [
                uniform_sphere(u),
                cosine_hemisphere(u).0,
                uniform_cone(1e-12, u),
            ] {
                assert!(
                    v.is_finite() && (v.length() - 1.0).abs() < 1e-5,
                    "{u:?} gives {v}"
                );
            }
            assert!(cosine_hemisphere(u).1 > 0.0, "density at {u:?}");
        }
    }

    #[test]
    fn a_cone_too_narrow_for_its_cosine_is_still_wide() {
        for one_minus_cos in [1e-30, 1e-12, 1e-8, 1e-3] {
            // The edge at sin² = h (2 − h).
            let edge = uniform_cone(one_minus_cos, [1.0, 0.125])
                .truncate()
                .length();
            let exact = (one_minus_cos * (2.0 - one_minus_cos)).sqrt();
            assert!((edge / exact - 1.0).abs() < 1e-5, "{edge}, not {exact}");
        }
    }
}
