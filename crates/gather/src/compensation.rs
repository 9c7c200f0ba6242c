//! The light that a clamp takes off virtual point lights, found again.
//!
//! A virtual point light at y sends to x in proportion to f_x G, G = cosₓ cos_y / d² being what a clamp b limits. Virtual
//! lights stand for the light L that all surfaces reflect, so what the clamp takes off all of them is in the mean
//!
//! ∫ f_x(ω) cosₓ L(y → x) max(0, 1 − b / G) dω,
//!
//! where y is what x sees along ω. A ray drawn by reflection finds it. Where G > b the ray leaves another gather point at y,
//! whose light is found as at any other: by the chosen method, clamped, and compensated in turn. Such rays are short, as
//! G > b only for d² < cosₓ / b.
//!
//! Light may meet so many surfaces before the first gather point, and one less before each that follows: virtual lights
//! whose light has met more are dark there.
//!
//! Source: Kollig and Keller, "Illumination in the Presence of Weak Singularities", 2004.

use sampling::Rng;
use scene::trace::{Ray, Tracer};
use scene::{BrdfSample, Scene};

use crate::path::{onward, survive};
use crate::point::GatherPoint;

/// Follows paths for the light that a clamp takes off.
pub(crate) struct Compensation<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) tracer: &'a Tracer,
    /// What cos cos / d² is clamped to, above 0; infinite where nothing is to be found again.
    pub(crate) clamp: f32,
    /// Surfaces that light may meet before the first gather point.
    pub(crate) max_bounces: u32,
}

impl Compensation<'_> {
    /// Follows a path on from its first gather point, as far as clamps have taken off light. All gather points, the first
    /// included, go to `points`. Returns the number of rays.
    pub(crate) fn follow(
        &self,
        first: GatherPoint,
        rng: &mut Rng,
        points: &mut Vec<GatherPoint>,
    ) -> u64 {
        points.push(first);
        if self.clamp == f32::INFINITY {
            return 0;
        }
        let mut x = first;
        let mut rays = 0;
        while x.bounce < self.max_bounces {
            let Some(sample) = onward(&x, rng) else {
                break;
            };
            rays += 1;
            let Some(y) = self.next(&x, &sample, rng) else {
                break;
            };
            points.push(y);
            x = y;
        }
        rays
    }

    /// The gather point that `x` sees along a direction drawn, with the strength of what the clamp at `x` took off; `None`
    /// where it took off nothing, and by chance, the likelier the less that was.
    fn next(&self, x: &GatherPoint, sample: &BrdfSample, rng: &mut Rng) -> Option<GatherPoint> {
        let cos_x = x.ns.dot(sample.wi);
        let hit = self.tracer.closest(&Ray {
            origin: x.position,
            direction: sample.wi,
            t_max: (cos_x / self.clamp).sqrt(),
        })?;
        let surface = self.scene.surface(&hit, sample.wi);
        // As a virtual light there would send: by its geometric normal.
        let cosines = cos_x * -surface.ng.dot(sample.wi);
        let kept = self.clamp * hit.t * hit.t;
        if kept >= cosines {
            return None;
        }
        let strength = x.strength * sample.weight * (1.0 - kept / cosines);
        Some(GatherPoint {
            bounce: x.bounce + 1,
            light_bounces: self.max_bounces - x.bounce - 1,
            ..GatherPoint::new(&surface, -sample.wi, survive(strength, rng)?, x.slot)
        })
    }
}
