//! Virtual spherical lights.
//!
//! A virtual light whose power is spread over a sphere of radius r sends to a point x
//!
//! Φ/(πr²) · ∫ f_x(ω) f_l(ω) cos⁺θ_x cos⁺θ_l dω over the cone that the sphere subtends,
//!
//! which tends to the point light's Φ f f cos cos / d² as r → 0 and stays finite as d → 0. Light is sent only
//! while the sphere's centre is above both horizons; that rule is part of what is estimated here, so that a
//! tree's bounds, which look at centres, are exact.
//!
//! Source: Hašan, Křivánek, Walter, Bala, "Virtual Spherical Lights for Many-Light Rendering of Glossy
//! Scenes", 2009, eq. (7).

use glam::Vec3;
use sampling::{Frame, uniform_cone};

/// The cone that a sphere subtends at the gather point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Subtended {
    /// Unit direction to the centre.
    pub(crate) axis: Vec3,
    /// Sine of the half angle; 1 inside the sphere, where the cone is a hemisphere.
    sin: f32,
    /// 1 − cosine of the half angle, without the cancellation of 1 − cos.
    pub(crate) one_minus_cos: f32,
    /// max(d, r)².
    far2: f32,
}

impl Subtended {
    /// Cone of the sphere of `radius` at `offset`; at its centre the axis is `normal`.
    pub(crate) fn new(offset: Vec3, radius: f32, normal: Vec3) -> Self {
        let dist2 = offset.length_squared();
        let dist = dist2.sqrt();
        let axis = if dist2 > f32::MIN_POSITIVE {
            offset / dist
        } else {
            // The square underflows, not the direction.
            (offset * 2.0f32.powi(64)).normalize_or(normal)
        };
        Self::along(axis, dist, dist2, radius)
    }

    /// Cone of the sphere of `radius` whose centre lies `dist` along unit `axis`, a distance of which `dist2` is the square.
    #[inline(always)]
    pub(crate) fn along(axis: Vec3, dist: f32, dist2: f32, radius: f32) -> Self {
        let sin = if dist > radius { radius / dist } else { 1.0 };
        let cos = (1.0 - sin * sin).max(0.0).sqrt();
        Self {
            axis,
            sin,
            one_minus_cos: sin * sin / (1.0 + cos),
            far2: dist2.max(radius * radius),
        }
    }

    #[inline(always)]
    fn cos(&self) -> f32 {
        1.0 - self.one_minus_cos
    }

    /// Solid angle over πr²: 2 / (max(d, r)² (1 + cos)), which for r → 0 is 1/d².
    #[inline(always)]
    pub(crate) fn spread(&self) -> f32 {
        2.0 / (self.far2 * (1.0 + self.cos()))
    }

    /// Whether the whole cone is above the horizon of a surface that sees its axis under cosine `cos`.
    #[inline(always)]
    pub(crate) fn is_above(&self, cos: f32) -> bool {
        cos >= self.sin
    }

    /// Greatest cosine, not negative, of the angle between a direction of the cone and a vector that sees its axis
    /// under cosine `cos`; rounded up, so that it is 0 only when all of the cone is a right angle or more away.
    pub(crate) fn greatest_cos(&self, cos: f32) -> f32 {
        let half = self.cos();
        if cos >= half {
            return 1.0;
        }
        let across = ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt();
        // The slack is what rounding takes off, near a cosine of −1 from the sine: √(2 · 10⁻⁷).
        (cos * half + across * self.sin + 5e-4 * self.sin + 1e-6).clamp(0.0, 1.0)
    }

    /// ∫ (n·ω)(b·ω) dω / (πr²) over the cone, for unit `n` and `b` that see its axis under `cos_n` and `cos_b`
    /// and that both have the whole cone above their horizon.
    #[inline(always)]
    pub(crate) fn cosine_integral(&self, n: Vec3, b: Vec3, cos_n: f32, cos_b: f32) -> f32 {
        // With K = 1/(max(d,r)² (1+c)) and h = 1 − c the moments of the cone are
        // A = ⅔ K (1 + c + c²) along the axis and B = ⅓ K h (2 + c) across it.
        let c = self.cos();
        let k = 1.0 / (self.far2 * (1.0 + c));
        let along = 2.0 / 3.0 * k * (1.0 + c + c * c);
        let across = 1.0 / 3.0 * k * self.one_minus_cos * (2.0 + c);
        along * cos_n * cos_b + across * (n.dot(b) - cos_n * cos_b)
    }

    /// Solid angle, sr.
    #[inline(always)]
    pub(crate) fn solid_angle(&self) -> f32 {
        std::f32::consts::TAU * self.one_minus_cos
    }

    /// Whether unit `w` lies in the cone.
    #[inline(always)]
    pub(crate) fn contains(&self, w: Vec3) -> bool {
        // By the chord, which unlike the cosine tells narrow cones apart.
        w.distance_squared(self.axis) <= 2.0 * self.one_minus_cos
    }

    /// A direction uniform in the cone.
    pub(crate) fn sample(&self, u: [f32; 2]) -> Vec3 {
        Frame::around(self.axis).to_world(uniform_cone(self.one_minus_cos, u))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ∫ cos⁺ cos⁺ dω / (πr²) by midpoint quadrature in f64.
    fn quadrature(offset: Vec3, radius: f32, n: Vec3, b: Vec3) -> f64 {
        let (d, r) = (f64::from(offset.length()), f64::from(radius));
        let sin = (r / d).min(1.0);
        let h = sin * sin / (1.0 + (1.0 - sin * sin).sqrt());
        let frame = Frame::around(offset.normalize());
        let steps = 600;
        let mut sum = 0.0;
        for i in 0..steps {
            let z = 1.0 - h * (f64::from(i) + 0.5) / f64::from(steps);
            let s = (1.0 - z * z).sqrt();
            for j in 0..steps {
                let phi = std::f64::consts::TAU * (f64::from(j) + 0.5) / f64::from(steps);
                let local = glam::DVec3::new(s * phi.cos(), s * phi.sin(), z);
                let w = frame.t.as_dvec3() * local.x
                    + frame.b.as_dvec3() * local.y
                    + frame.n.as_dvec3() * local.z;
                sum += n.as_dvec3().dot(w).max(0.0) * b.as_dvec3().dot(w).max(0.0);
            }
        }
        let solid_angle = std::f64::consts::TAU * h;
        sum / f64::from(steps * steps) * solid_angle / (std::f64::consts::PI * r * r)
    }

    #[test]
    fn the_closed_form_is_the_integral_where_the_cone_is_above_both_horizons() {
        let n = Vec3::Y;
        let mut checked = 0;
        for b in [
            Vec3::Y,
            Vec3::new(0.5, 0.8, 0.1).normalize(),
            Vec3::new(-0.7, 0.6, 0.3).normalize(),
        ] {
            for offset in [Vec3::Y, Vec3::new(1.0, 2.0, 0.5), Vec3::new(0.3, 0.9, 0.0)] {
                for radius in [0.01f32, 0.1, 0.4] {
                    let cone = Subtended::new(offset, radius, n);
                    let (cos_n, cos_b) = (n.dot(cone.axis), b.dot(cone.axis));
                    if cone.is_above(cos_n) && cone.is_above(cos_b) {
                        let value = f64::from(cone.cosine_integral(n, b, cos_n, cos_b));
                        let exact = quadrature(offset, radius, n, b);
                        assert!(
                            (value / exact - 1.0).abs() < 1e-4,
                            "{value} vs {exact}: {b} {offset} {radius}"
                        );
                        checked += 1;
                    }
                }
            }
        }
        assert!(checked >= 20, "only {checked} cases");
    }

    #[test]
    fn a_vanishing_radius_gives_the_point_light() {
        let (n, b, offset) = (Vec3::Y, Vec3::new(0.6, 0.8, 0.0), Vec3::new(0.2, 2.0, 0.0));
        for radius in [0.0, 1e-20, 1e-6] {
            let cone = Subtended::new(offset, radius, n);
            let (cos_n, cos_b) = (n.dot(cone.axis), b.dot(cone.axis));
            let point = cos_n * cos_b / offset.length_squared();
            let value = cone.cosine_integral(n, b, cos_n, cos_b);
            assert!(
                (value / point - 1.0).abs() < 1e-6,
                "radius {radius}: {value} vs {point}"
            );
            assert!(
                (cone.spread() * offset.length_squared() - 1.0).abs() < 1e-6,
                "spread at radius {radius}"
            );
        }
    }

    #[test]
    fn inside_and_at_the_centre_everything_stays_finite() {
        for offset in [Vec3::ZERO, Vec3::Y * 1e-20, Vec3::Y * 0.5] {
            let cone = Subtended::new(offset, 1.0, Vec3::Y);
            assert!((cone.axis - Vec3::Y).length() < 1e-6, "axis at {offset}");
            assert!((cone.spread() - 2.0).abs() < 1e-6, "a hemisphere over π");
            assert!(cone.sample([0.999, 0.3]).is_finite(), "sample at {offset}");
        }
    }

    #[test]
    fn cone_samples_average_to_the_integral_across_a_horizon() {
        let (n, b, offset, radius) = (
            Vec3::Y,
            Vec3::new(0.8, 0.6, 0.0),
            Vec3::new(1.0, 0.1, 0.0),
            0.5,
        );
        let cone = Subtended::new(offset, radius, n);
        assert!(
            !cone.is_above(n.dot(cone.axis)),
            "the case straddles the horizon"
        );
        let steps = 500;
        let mut sum = 0.0;
        for i in 0..steps {
            for j in 0..steps {
                let w = cone.sample([
                    (i as f32 + 0.5) / steps as f32,
                    (j as f32 + 0.5) / steps as f32,
                ]);
                sum += f64::from(n.dot(w).max(0.0) * b.dot(w).max(0.0));
            }
        }
        let value = sum / f64::from(steps * steps) * f64::from(cone.spread());
        let exact = quadrature(offset, radius, n, b);
        assert!((value / exact - 1.0).abs() < 1e-3, "{value} vs {exact}");
    }
}
