//! The specular lobe of a glossy receiver, as weights see it.

use glam::{Vec3, Vec3A};
use sampling::ggx_density;

use crate::bounds::{Receiver, RelativeBox, widened_by};

/// What a glossy point reflects, BRDF × cosine, at most: a diffuse part, and a GGX lobe about a mirror direction. Values are
/// means over the channels, sr⁻¹.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lobe {
    /// Unit mirror direction of the viewer.
    pub axis: Vec3,
    /// Greatest diffuse BRDF value.
    pub diffuse: f32,
    /// Times the density of facets that mirror light to the viewer: the lobe.
    pub near: f32,
    /// Added for facets far off the normal, which Fresnel reflection may favour.
    pub far: f32,
    /// Least sin² of the angle between the normal and such facets.
    pub far_sin2: f32,
    /// Squared roughness.
    pub alpha2: f32,
}

impl Lobe {
    /// Upper bound of the lobe for directions whose cosine with the axis is at most `cos`: they need a facet at half the
    /// angle off the normal.
    #[inline]
    fn value(&self, cos: f32) -> f32 {
        let sin2 = (0.5 * (1.0 - cos) - 1e-7).max(0.0);
        self.near * ggx_density(self.alpha2, sin2)
            + self.far * ggx_density(self.alpha2, sin2.max(self.far_sin2))
    }
}

impl Receiver {
    /// Upper bound of BRDF × cosine, mean of the channels in sr⁻¹, for light from any point of the box from `lo` to `hi`;
    /// of the cosine alone where the receiver is matte. 0 only where all of the box is below the horizon.
    ///
    /// The cosine with the mirror direction is bounded over the sphere about the box: some thirty operations.
    pub fn reflection_bound(&self, lo: Vec3, hi: Vec3) -> f32 {
        self.reflection_bound_over(&RelativeBox {
            lo: Vec3A::from(lo) - self.position(),
            hi: Vec3A::from(hi) - self.position(),
        })
    }

    #[inline]
    pub(crate) fn reflection_bound_over(&self, seen: &RelativeBox) -> f32 {
        let cos = self.cos_bound_over(seen);
        match self.lobe() {
            Some(lobe) if cos > 0.0 => {
                lobe.diffuse * cos + lobe.value(sphere_cos(lobe.axis.into(), seen))
            }
            _ => cos,
        }
    }
}

/// Upper bound of the cosine between unit `axis` and the direction to any point of the sphere about the box.
#[inline]
fn sphere_cos(axis: Vec3A, seen: &RelativeBox) -> f32 {
    let centre = seen.centre();
    // Rounded up: for a sphere that all but touches the receiver the cosine below comes from a difference.
    let (dist2, radius2) = (
        centre.length_squared(),
        0.25 * seen.diagonal2() * (1.0 + 1e-6),
    );
    if radius2 >= dist2 {
        return 1.0;
    }
    let sin2 = radius2 / dist2;
    let cos = axis.dot(centre) / dist2.sqrt();
    widened_by(cos, (1.0 - sin2).sqrt(), sin2.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use sampling::{Purpose, Rng, uniform_sphere};

    #[test]
    fn no_direction_to_the_box_exceeds_the_bound() {
        let mut rng = Rng::new(5, 0, 0, Purpose::Build);
        let mut lit = 0;
        for k in 0..40_000 {
            let unit = |rng: &mut Rng| uniform_sphere([rng.f32(), rng.f32()]).normalize();
            let (normal, axis) = (unit(&mut rng), unit(&mut rng));
            let lobe = Lobe {
                axis,
                diffuse: 0.1,
                near: 0.3,
                far: 0.2 * (k % 2) as f32,
                far_sin2: 0.1,
                alpha2: [1.0, 0.1, 1e-3, 1e-6][k % 4],
            };
            let at = unit(&mut rng) * rng.f32();
            let x = Receiver::new(at, normal).with_lobe(lobe);
            // Often around the mirror direction.
            let middle = match k % 3 {
                0 => unit(&mut rng) * rng.f32() * 3.0,
                _ => at + axis * rng.f32() * 3.0,
            };
            let half = (unit(&mut rng) * rng.f32() * 0.5).abs();
            let half = if k % 5 == 0 { Vec3::ZERO } else { half };
            let bound = x.reflection_bound(middle - half, middle + half);
            let t = Vec3::new(rng.f32(), rng.f32(), rng.f32()) * 2.0 - 1.0;
            let p = (middle + half * t).clamp(middle - half, middle + half);
            let w = (p - at).normalize();
            let cos = normal.dot(w);
            if cos <= 0.0 {
                continue;
            }
            lit += 1;
            // In f64: the lobe at half the angle, by the chord.
            let sin2 = f64::from(w.distance_squared(axis)) / 4.0;
            let density = |sin2: f64| {
                let a = f64::from(lobe.alpha2);
                a / (std::f64::consts::PI * (a * (1.0 - sin2) + sin2).powi(2))
            };
            let truth = 0.1 * f64::from(cos)
                + 0.3 * density(sin2)
                + f64::from(lobe.far) * density(sin2.max(0.1));
            let truth = truth * (1.0 - 1e-4);
            assert!(f64::from(bound) >= truth, "{bound} below {truth}: {lobe:?}");
        }
        assert!(lit > 10_000, "only {lit} lit points");
    }

    #[test]
    fn without_a_lobe_the_bound_is_that_of_the_cosine() {
        let x = Receiver::new(Vec3::ZERO, Vec3::Y);
        let bound = x.reflection_bound(Vec3::new(3.0, 4.0, 0.0), Vec3::new(3.0, 4.0, 0.0));
        assert!((bound - 0.8).abs() < 1e-5, "{bound}");
    }
}
