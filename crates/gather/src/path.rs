//! Eye paths that go on behind their first hit.
//!
//! Each vertex is a gather point, where the chosen method estimates the light that arrives straight from the lights. A
//! light that can be hit, a triangle or the environment, is also found by the ray that goes on. So that it counts once,
//! its light is divided: the method's estimate gets a share that depends only on the point and the direction, and a hit
//! gets the rest. Any such shares leave every method unbiased, whatever its probabilities; the better they tell which
//! of the two finds the light more easily, the less noise is left. See [`light_share`].

use glam::Vec3;
use sampling::Rng;
use scene::trace::{Hit, Ray, Tracer};
use scene::{BrdfSample, Scene};

use crate::point::GatherPoint;
use crate::shadow_queue::Seen;

/// Which light paths are followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Integrator {
    /// To the first hit, and from there to the lights in use.
    #[default]
    Direct,
    /// On from the first hit by so many surfaces, and from each to the lights in use.
    Path {
        /// Surfaces behind the first hit.
        max_bounces: u32,
    },
    /// As `Direct`, and on behind the first hit for as much of the light as [`VirtualShape`](crate::VirtualShape)'s clamp
    /// takes off virtual lights. Their [bounces](light_tree::LightSet::bounces) have to be known.
    Compensated {
        /// Surfaces that the light of any virtual light has met at most.
        max_bounces: u32,
    },
}

/// Longest a path survives by chance alone: the chance to go on is never above this.
const MOST_SURVIVAL: f32 = 0.95;
/// Bounces that chance never ends: most of a picture's light is in them.
const CERTAIN_BOUNCES: u32 = 1;

/// Part of a light's radiance that sampling the lights is to find; hits find the rest.
///
/// The balance heuristic between the density of the direction by reflection, `pdf_reflection`, and `pdf_light`, which it
/// would have were the light at hand chosen with certainty: how likely a method is to choose it is not asked. 1 where
/// reflection never finds it.
///
/// Source: Veach and Guibas, "Optimally Combining Sampling Techniques for Monte Carlo Rendering", 1995.
#[inline]
pub(crate) fn light_share(pdf_light: f32, pdf_reflection: f32) -> f32 {
    if pdf_reflection > 0.0 {
        1.0 / (1.0 + pdf_reflection / pdf_light)
    } else {
        1.0
    }
}

/// Radiance that a ray along unit `direction` meets without a surface that reflects it.
pub(crate) fn seen(scene: &Scene, direction: Vec3, hit: Option<&Hit>) -> Vec3 {
    match hit {
        Some(hit) => scene.emitted(hit.triangle as usize, hit.u, hit.v),
        None => {
            let environment = scene.environment.as_ref();
            environment.map_or(Vec3::ZERO, |e| e.radiance(direction))
        }
    }
}

/// Draws how a path goes on from `x`; `None` when nothing is reflected, or into the surface.
pub(crate) fn onward(x: &GatherPoint, rng: &mut Rng) -> Option<BrdfSample> {
    let sample = x.brdf.sample(x.ns, x.wo, rng)?;
    (sample.wi.dot(x.ng) > 0.0).then_some(sample)
}

/// Ends a path of `strength` by chance, the sooner the weaker it is: the strength of one that goes on makes up for those
/// that end.
pub(crate) fn survive(strength: Vec3, rng: &mut Rng) -> Option<Vec3> {
    let survival = strength.max_element().min(MOST_SURVIVAL);
    (rng.f32() < survival).then(|| strength / survival)
}

/// Follows paths, and leaves what they find.
pub(crate) struct Walk<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) tracer: &'a Tracer,
    pub(crate) max_bounces: u32,
}

impl Walk<'_> {
    /// Follows a path on from its first gather point. Gather points, the first included, go to `points`, and what is
    /// met of lights to `lights`. Returns the number of rays.
    pub(crate) fn follow(
        &self,
        first: GatherPoint,
        rng: &mut Rng,
        points: &mut Vec<GatherPoint>,
        lights: &mut Vec<Seen>,
    ) -> u64 {
        let hits_lights = self.scene.has_visible_lights();
        let mut x = GatherPoint {
            shares_hits: hits_lights,
            ..first
        };
        let mut rays = 0;
        loop {
            points.push(x);
            let is_last = x.bounce == self.max_bounces;
            // Behind the last vertex only light itself is of interest.
            if is_last && !hits_lights {
                return rays;
            }
            let Some(BrdfSample { wi, weight }) = onward(&x, rng) else {
                return rays;
            };
            let mut strength = x.strength * weight;
            if x.bounce >= CERTAIN_BOUNCES {
                let Some(survived) = survive(strength, rng) else {
                    return rays;
                };
                strength = survived;
            }
            rays += 1;
            let hit = self.tracer.closest(&Ray {
                origin: x.position,
                direction: wi,
                t_max: f32::INFINITY,
            });
            if hits_lights {
                let radiance = strength * seen(self.scene, wi, hit.as_ref());
                if radiance != Vec3::ZERO {
                    let rest = 1.0 - self.share_of_sampling(&x, wi, hit.as_ref());
                    lights.push(Seen {
                        slot: x.slot,
                        radiance: radiance * rest,
                        is_direct: x.bounce == 0,
                    });
                }
            }
            let Some(hit) = hit.filter(|_| !is_last) else {
                return rays;
            };
            let surface = self.scene.surface(&hit, wi);
            x = GatherPoint {
                bounce: x.bounce + 1,
                shares_hits: hits_lights,
                ..GatherPoint::new(&surface, -wi, strength, x.slot)
            };
        }
    }

    /// The share that the lights' sampling at `x` has of a light met in direction `wi`.
    fn share_of_sampling(&self, x: &GatherPoint, wi: Vec3, hit: Option<&Hit>) -> f32 {
        let pdf_light = match hit {
            Some(hit) => {
                let light = self
                    .scene
                    .emitter_point(hit.triangle as usize, hit.u, hit.v);
                let cos = light.normal().dot(wi).abs();
                hit.t * hit.t / (light.area() * cos)
            }
            None => {
                let environment = self.scene.environment.as_ref();
                environment.map_or(0.0, |e| e.pdf_solid_angle(wi))
            }
        };
        light_share(pdf_light, x.brdf.pdf_solid_angle(x.ns, x.wo, wi))
    }
}
