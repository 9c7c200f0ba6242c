//! Every method and every kind of light where all random numbers are 0, or the greatest below 1.

use glam::{DVec3, Vec3};
use light_tree::{LightSet, TreeBuilder};
use sampling::{Extreme, Rng, Sequence};
use scene::Scene;
use scene::trace::Tracer;

use super::conformance::{cases, gather_points, room, settings};
use super::stratified_lightcuts::{LEARNED_FROM, LIGHTS};
use super::*;
use crate::contribution::VirtualShape;
use crate::counters::Counters;
use crate::path::Walk;
use crate::shadow_queue::{QueueScratch, ShadowQueue};
use crate::tile_points::Centre;

const EXTREMES: [Extreme; 2] = [Extreme::Zero, Extreme::BelowOne];

/// A sequence whose number for choosing lights is the least or the greatest that it has: found by trying.
fn sequence(number: Extreme) -> Sequence {
    Sequence(match number {
        Extreme::Zero => 2_314_106,
        Extreme::BelowOne => 20_914_089,
    })
}

#[test]
fn the_sequences_choose_lights_by_extreme_numbers() {
    let number = |end| sequence(end).f32(LEARNED_FROM, LIGHTS);
    assert_eq!(number(Extreme::Zero), 0.0, "the least");
    let greatest = 1.0 - f32::EPSILON;
    assert_eq!(number(Extreme::BelowOne), greatest, "the greatest");
}

/// One estimate at `x`, with `lights` for all choices of lights and `surface` for all points on them.
struct Estimate<'a> {
    scene: &'a Scene,
    inputs: &'a Inputs,
    tracer: &'a Tracer,
    shape: VirtualShape,
    x: GatherPoint,
    lights: Extreme,
    surface: Extreme,
}

impl Visitor for Estimate<'_> {
    type Output = (DVec3, Counters);

    fn visit<'m, M: Method<'m>>(self, method: M) -> Self::Output {
        let mut memory = QueueScratch::default();
        let mut scratch = M::Scratch::default();
        let set = &self.inputs.lights;
        let mut queue = ShadowQueue::new(self.scene, set, self.tracer, self.shape, 2, &mut memory);
        let choice = Rng::extreme(self.lights);
        // Two samples, for methods that look at more than one.
        let points = [0, 1].map(|slot| GatherPoint {
            slot,
            sample: LEARNED_FROM,
            sequence: sequence(self.lights),
            ..self.x
        });
        queue.begin_tile(Rng::extreme(self.surface));
        let centre = Centre {
            point: points[0],
            reach: 0.1,
            is_pilot: true,
        };
        let tile = TilePoints {
            points: &points,
            width: 1,
            samples: 2,
            is_milestone: true,
            centres: &[Some(centre)],
            probe_stream: &choice,
            stream: &|_, _, _| choice.clone(),
        };
        method.begin_tile(&tile, &mut queue, &mut Learned::default(), &mut scratch);
        queue.begin_points(2, Rng::extreme(self.surface));
        method.pixel(&points, &mut queue, &mut choice.clone(), &mut scratch);
        queue.end_point();
        let (counters, sums) = queue.finish();
        (
            sums.iter().map(|sum| sum.radiance).sum::<DVec3>() / 2.0,
            counters,
        )
    }
}

/// Estimates of every method in one place, by all pairs of extreme numbers: the method, and what it found.
fn estimates<'a>(
    scene: &'a Scene,
    inputs: &'a Inputs,
    tracer: &'a Tracer,
    shape: VirtualShape,
    x: GatherPoint,
) -> impl Iterator<Item = (MethodSpec, Extreme, DVec3)> {
    let numbers = EXTREMES.map(|lights| EXTREMES.map(|surface| (lights, surface)));
    let numbers = numbers.into_iter().flatten();
    numbers.flat_map(move |(lights, surface)| {
        settings().into_iter().map(move |method| {
            let estimate = Estimate {
                scene,
                inputs,
                tracer,
                shape,
                x,
                lights,
                surface,
            };
            let (found, counters) = method.visit(inputs, estimate);
            let told =
                || format!("{method:?}, lights by {lights:?}, points on them by {surface:?}");
            assert_eq!(counters.nonfinite, 0, "{}", told());
            let sound = found.is_finite() && found.min_element() >= 0.0;
            assert!(sound, "{}: {found}", told());
            (method, surface, found)
        })
    })
}

#[test]
fn extreme_numbers_leave_every_method_sound_under_every_kind_of_light() {
    let mut checks = 0;
    for glossy in [false, true] {
        for (scene, tracer, name, lights) in cases(glossy) {
            let inputs = Inputs::new(lights, TreeBuilder::Binned);
            for x in gather_points(&scene) {
                for shape in [VirtualShape::Sphere, VirtualShape::ClampedPoint(10.0)] {
                    let mut exact = [DVec3::NAN; 2];
                    for (method, surface, found) in estimates(&scene, &inputs, &tracer, shape, x) {
                        checks += 1;
                        let exact = &mut exact[surface as usize];
                        if matches!(method, MethodSpec::AllLights(_)) {
                            *exact = found;
                        }
                        // Lights that are alike leave nothing to chance: none may be lost, or counted by a wrong probability.
                        if name == "one" || name == "two alike" {
                            assert!(
                                (found - *exact).abs().max_element() <= 1e-5 * exact.max_element(),
                                "{method:?}, {name}, at {}: {found} instead of {exact}",
                                x.position
                            );
                        }
                    }
                }
            }
        }
    }
    eprintln!("{checks} estimates by extreme random numbers");
    assert!(checks > 10_000, "only {checks} estimates");
}

#[test]
fn the_one_light_above_the_horizon_is_found_among_dark_ones_by_extreme_numbers() {
    let scene = room(false);
    let tracer = Tracer::build(&scene);
    for x in gather_points(&scene) {
        let (across, along) = x.ns.any_orthonormal_pair();
        let mut lights = LightSet::default();
        // First and last in any order: by number, and along each axis.
        for side in [-1.0, 1.0] {
            for i in 1..60 {
                let from = (across + 0.3 * along) * (side * i as f32 * 0.05);
                lights.push_point(x.position - 0.5 * x.ns + from, Vec3::ONE);
            }
            if side < 0.0 {
                lights.push_point(x.position + 0.1 * x.ns, Vec3::ONE);
            }
        }
        let inputs = Inputs::new(lights, TreeBuilder::Binned);
        let mut exact = DVec3::NAN;
        for (method, _, found) in estimates(&scene, &inputs, &tracer, VirtualShape::Sphere, x) {
            match method {
                MethodSpec::AllLights(_) => exact = found,
                // They draw a light without regard to the point.
                MethodSpec::Uniform(_) | MethodSpec::Power(_) => continue,
                _ => {}
            }
            assert!(
                exact.min_element() > 0.0,
                "the light is seen from {}",
                x.position
            );
            assert!(
                (found - exact).abs().max_element() <= 1e-5 * exact.max_element(),
                "{method:?}, at {}: {found} instead of {exact}",
                x.position
            );
        }
    }
}

#[test]
fn paths_by_extreme_numbers_end_and_carry_finite_light() {
    for glossy in [false, true] {
        for (scene, tracer, name, _) in cases(glossy) {
            for first in gather_points(&scene) {
                for number in EXTREMES {
                    let walk = Walk {
                        scene: &scene,
                        tracer: &tracer,
                        max_bounces: 50,
                    };
                    let (mut points, mut lights) = (Vec::new(), Vec::new());
                    let rng = &mut Rng::extreme(number);
                    let rays = walk.follow(first, rng, &mut points, &mut lights);
                    assert!(rays <= 51 && points.len() <= 51, "{rays} rays");
                    let strengths = points.iter().map(|x| x.strength);
                    for light in strengths.chain(lights.iter().map(|seen| seen.radiance)) {
                        let sound = light.is_finite() && light.min_element() >= 0.0;
                        assert!(
                            sound,
                            "{name}, {number:?}, from {}: {light}",
                            first.position
                        );
                    }
                }
            }
        }
    }
}
