//! The one door between methods and light: evaluation, now or in batches.

use std::ops::AddAssign;
use std::time::Instant;

use glam::{DVec3, Vec3};
use light_tree::{LightId, LightSet, luminance};
use sampling::Rng;
use scene::Scene;
use scene::trace::{OcclusionScratch, Ray, Tracer};

use crate::contribution::{Unoccluded, VirtualShape, unoccluded_of};
use crate::counters::{Counters, Phase};
use crate::learned::{Trial, Trials};
use crate::point::GatherPoint;
use crate::side_by_side::{LightSample, Seen as SeenPoint, SideBySide, World};

/// What a method may ask of the renderer.
///
/// A stochastic method need not know whether its lights are visible: it [`add`](Self::add)s them and the
/// renderer traces the shadow rays of many points together, several times faster than one by one. A method
/// that refines on what it sees asks for [`radiance`](Self::radiance) at once.
pub trait LightEval {
    /// Adds what lights send by way of `x`, each multiplied by its scale, to the pixel sample of `x`. Many that are added
    /// together take less time than one by one.
    fn add(&mut self, x: &GatherPoint, samples: impl IntoIterator<Item = LightSample>) {
        self.add_by_roulette(x, samples, 0.0);
    }

    /// As [`add`](Self::add), but of those that would add less than the share `roulette`, in 0..=1, of what up to sixteen neighbours
    /// among them add on average, not all are traced: with a probability in proportion to what each would add, and for as much more.
    /// The expected sum is the same. Of no trials: what comes of them were no longer what they are compared with.
    fn add_by_roulette(
        &mut self,
        x: &GatherPoint,
        samples: impl IntoIterator<Item = LightSample>,
        roulette: f64,
    );

    /// Says that light `id` will be [added](Self::add), after others: its memory is asked for.
    fn expect(&mut self, id: LightId);

    /// Says that light `id`, which was [expected](Self::expect) some time ago, will be added soon: what lies behind its memory
    /// is asked for.
    fn expect_soon(&mut self, id: LightId);

    /// Radiance that light `id` sends by way of `x` toward the viewer, visibility included, at once.
    fn radiance(&mut self, x: &GatherPoint, id: LightId) -> Vec3;

    /// As [`radiance`](Self::radiance) of each of these lights, in place of what `radiances` had: their shadow rays are traced
    /// together.
    fn radiances(&mut self, x: &GatherPoint, lights: &[LightId], radiances: &mut Vec<Vec3>);

    /// As [`radiance`](Self::radiance), were the light's intensity 1 in every channel: one light can stand for
    /// others of any colour, also where it lacks a channel itself.
    fn unit_radiance(&mut self, x: &GatherPoint, id: LightId) -> Vec3;

    /// How virtual lights shine: what bounds have to know.
    fn shape(&self) -> VirtualShape;

    /// Adds radiance that the method worked out itself, to the pixel sample of `x`.
    fn add_radiance(&mut self, x: &GatherPoint, radiance: Gathered);

    /// Says that the time since the last mark was spent on `phase`.
    fn mark(&mut self, _phase: Phase) {}

    /// Says that a branch of the light tree was found dead: the sample is worth nothing.
    fn count_dead(&mut self) {}
}

/// Radiance that a method added up.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gathered {
    /// Of all lights.
    pub all: DVec3,
    /// Of those that are the scene's own.
    pub of_sources: DVec3,
}

impl Gathered {
    /// `radiance` of lights that are the scene's own, or of others.
    pub fn by(radiance: DVec3, is_source: bool) -> Self {
        Self {
            all: radiance,
            of_sources: if is_source { radiance } else { DVec3::ZERO },
        }
    }
}

impl AddAssign for Gathered {
    fn add_assign(&mut self, other: Self) {
        self.all += other.all;
        self.of_sources += other.of_sources;
    }
}

/// What a pixel sample has received.
#[derive(Debug, Clone, Copy, Default)]
pub struct SampleSum {
    /// Radiance.
    pub radiance: DVec3,
    /// The part of it that has met one surface, or none, since it left a light.
    pub direct: DVec3,
}

impl SampleSum {
    fn add(&mut self, radiance: DVec3, is_direct: bool) {
        self.radiance += radiance;
        if is_direct {
            self.direct += radiance;
        }
    }
}

/// Light that an eye path meets by itself.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Pixel sample.
    pub slot: u32,
    /// What it adds to that.
    pub radiance: Vec3,
    /// Whether it is seen, or by one reflection.
    pub is_direct: bool,
}

/// A shadow ray's passenger.
#[derive(Debug, Clone, Copy)]
struct Pending {
    value: Vec3,
    slot: u32,
    is_direct: bool,
    /// Place among the trials, or that of [`Trial::NONE`], and what [`Trials::square`] says of the light.
    trial: u32,
    square: u32,
}

/// Rays traced together. Enough to keep the tracer's lanes full, few enough to stay in the nearest cache.
const BATCH: usize = 1024;
/// One point in so many is timed: reading the clock at each would cost more than some of what it measures.
/// The first of a pixel's points may cost more than the others, so it is prime.
const TIMED: u32 = 61;

/// Collects shadow rays with the light they carry, traces them in batches, and adds what arrives to the
/// sums of a tile's pixel samples. Sums are made in the order in which light was added, so that bits
/// depend on nothing but that order.
pub struct ShadowQueue<'a> {
    scene: &'a Scene,
    lights: &'a LightSet,
    tracer: &'a Tracer,
    shape: VirtualShape,
    scratch: &'a mut QueueScratch,
    /// Statistics of the tile.
    pub counters: Counters,
    /// Numbers for points on lights, of the pixel sample under way.
    rng: Rng,
    until_timed: u32,
    mark: Option<Mark>,
}

/// When what is timed began.
#[derive(Debug, Clone, Copy)]
struct Mark {
    since: Instant,
    /// What its time stands for, as a multiple.
    weight: u32,
}

/// Memory of a [`ShadowQueue`], kept between tiles.
#[derive(Debug, Default)]
pub struct QueueScratch {
    rays: Vec<Ray>,
    pending: Vec<Pending>,
    occluded: Vec<bool>,
    trials: Vec<Trials>,
    side_by_side: SideBySide,
    sums: Vec<SampleSum>,
    /// Rays whose answers are waited for, and of which light each is.
    asked: Vec<Ray>,
    asked_of: Vec<usize>,
    occlusion: OcclusionScratch,
}

impl<'a> ShadowQueue<'a> {
    /// An empty queue for a tile of `slots` pixel samples.
    pub fn new(
        scene: &'a Scene,
        lights: &'a LightSet,
        tracer: &'a Tracer,
        shape: VirtualShape,
        slots: usize,
        scratch: &'a mut QueueScratch,
    ) -> Self {
        // A tile that was dropped half way leaves rays behind.
        scratch.rays.clear();
        scratch.pending.clear();
        scratch.trials.clear();
        scratch.sums.clear();
        scratch.sums.resize(slots, SampleSum::default());
        let rng = Rng::new(0, 0, 0, sampling::Purpose::LightSurface);
        Self {
            scene,
            lights,
            tracer,
            shape,
            scratch,
            counters: Counters::default(),
            rng,
            // The first point of a tile waits for what nobody has asked for yet, and stands for no others.
            until_timed: TIMED / 2,
            mark: None,
        }
    }

    /// Begins a tile, before its first gather point: `rng` serves points on lights until then.
    pub fn begin_tile(&mut self, rng: Rng) {
        self.rng = rng;
        self.mark = Some(Mark {
            since: Instant::now(),
            weight: 1,
        });
    }

    /// Takes over what came of earlier trials.
    pub(crate) fn give_trials(&mut self, trials: Vec<Trials>) {
        self.scratch.trials = trials;
    }

    /// Traces what is waiting and gives back the trials, with what came of those since.
    pub(crate) fn take_trials(&mut self) -> Vec<Trials> {
        self.flush();
        std::mem::take(&mut self.scratch.trials)
    }

    /// Begins a gather point: `rng` serves points on lights.
    pub fn begin_point(&mut self, rng: Rng) {
        self.begin_points(1, rng);
    }

    /// Begins `count` gather points that are looked at together.
    pub fn begin_points(&mut self, count: usize, rng: Rng) {
        self.rng = rng;
        self.counters.shading_points += count as u64;
        self.mark = None;
        if self.until_timed == 0 {
            self.until_timed = TIMED;
            self.mark = Some(Mark {
                since: Instant::now(),
                weight: TIMED,
            });
        }
        self.until_timed -= 1;
    }

    /// Ends a gather point, or those that were begun together.
    pub fn end_point(&mut self) {
        self.mark(Phase::Evaluate);
        self.mark = None;
        if self.scratch.rays.len() >= BATCH {
            self.flush();
        }
    }

    /// Adds what an eye path met.
    pub fn add_seen(&mut self, seen: &Seen) {
        self.scratch.sums[seen.slot as usize].add(seen.radiance.as_dvec3(), seen.is_direct);
    }

    /// Traces what is waiting and returns the sums of all pixel samples.
    pub fn finish(mut self) -> (Counters, &'a [SampleSum]) {
        self.flush();
        (self.counters, &self.scratch.sums)
    }

    /// Queues the shadow rays of the lights that were evaluated, those of the faint by `roulette`.
    fn queue(&mut self, x: &GatherPoint, roulette: f64) {
        let QueueScratch {
            side_by_side,
            rays,
            pending,
            ..
        } = &mut *self.scratch;
        self.counters.nonfinite += u64::from(side_by_side.refused());
        let faint = match roulette > 0.0 {
            true => roulette * mean(side_by_side.values().map(size)),
            false => 0.0,
        };
        for mut lit in side_by_side.brought(x) {
            let LightSample { light, trial, .. } = lit.sample;
            let size = size(lit.value);
            if size < faint {
                debug_assert!(trial.place == Trial::NO_PLACE, "of no trials");
                if self.rng.f64() * faint >= size {
                    continue;
                }
                lit.value = (lit.value.as_dvec3() * (faint / size)).as_vec3();
                // One channel may be three times the size.
                if !lit.value.is_finite() {
                    self.counters.nonfinite += 1;
                    continue;
                }
            }
            let square = match trial.place {
                Trial::NO_PLACE => 0,
                _ => Trials::square(f64::from(luminance(lit.radiance)), trial.expected),
            };
            rays.push(lit.shadow_ray);
            pending.push(Pending {
                value: lit.value,
                slot: x.slot,
                is_direct: x.bounce == 0 && self.lights.is_source(light),
                trial: trial.place,
                square,
            });
        }
        // A method may add a million lights at one point.
        if rays.len() >= 4 * BATCH {
            self.flush();
        }
    }

    /// What light `id` sends by way of `x` unless something is in the way, were its intensity `intensity`.
    fn unoccluded_of(
        &mut self,
        x: &GatherPoint,
        id: LightId,
        intensity: Vec3,
    ) -> Option<Unoccluded> {
        self.counters.light_samples += 1;
        let (scene, lights, rng) = (self.scene, self.lights, &mut self.rng);
        let light = unoccluded_of(scene, lights, self.shape, x, id, intensity, rng)?;
        if !light.radiance.is_finite() {
            self.counters.nonfinite += 1;
            return None;
        }
        self.counters.shadow_rays += 1;
        Some(light)
    }

    /// Radiance of light `id`, were its intensity `intensity`, traced at once.
    fn radiance_of(&mut self, x: &GatherPoint, id: LightId, intensity: Vec3) -> Vec3 {
        let Some(light) = self.unoccluded_of(x, id, intensity) else {
            return Vec3::ZERO;
        };
        let is_timed = |mark: &Mark| mark.weight == TIMED;
        let started = self.mark.filter(is_timed).map(|_| Instant::now());
        let occluded = self.tracer.is_occluded(&light.shadow_ray);
        if let (Some(mark), Some(started)) = (&mut self.mark, started) {
            // The ray's time is taken out of the phase under way.
            let spent = started.elapsed();
            mark.since += spent;
            self.counters.time(Phase::Trace, spent * TIMED);
        }
        if occluded { Vec3::ZERO } else { light.radiance }
    }

    fn flush(&mut self) {
        let started = Instant::now();
        let scratch = &mut *self.scratch;
        scratch.occluded.resize(scratch.rays.len(), false);
        self.tracer
            .occluded(&scratch.rays, &mut scratch.occluded, &mut scratch.occlusion);
        for (pending, _) in scratch
            .pending
            .iter()
            .zip(&scratch.occluded)
            .filter(|(_, occluded)| !**occluded)
        {
            let sum = &mut scratch.sums[pending.slot as usize];
            sum.add(pending.value.as_dvec3(), pending.is_direct);
            if let Some(trials) = scratch.trials.get_mut(pending.trial as usize) {
                trials.arrive(pending.square);
            }
        }
        self.counters.shadow_rays += scratch.rays.len() as u64;
        scratch.rays.clear();
        scratch.pending.clear();
        self.counters.time(Phase::Trace, started.elapsed());
    }
}

/// Mean of the channels without their signs, > 0 where one is not 0: it does not underflow. What is estimated by the difference to
/// something known may be negative.
fn size(value: Vec3) -> f64 {
    value.abs().as_dvec3().element_sum() / 3.0
}

/// 0 of nothing.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for value in values {
        sum += value;
        count += 1;
    }
    sum / f64::from(count.max(1))
}

impl LightEval for ShadowQueue<'_> {
    #[inline]
    fn add_by_roulette(
        &mut self,
        x: &GatherPoint,
        samples: impl IntoIterator<Item = LightSample>,
        roulette: f64,
    ) {
        let world = World {
            scene: self.scene,
            lights: self.lights,
            shape: self.shape,
        };
        let seen = SeenPoint::of(x, self.shape);
        let mut samples = samples.into_iter();
        loop {
            let QueueScratch {
                side_by_side,
                trials,
                ..
            } = &mut *self.scratch;
            let taken = side_by_side.take(self.lights, &seen, &mut samples);
            if taken.is_empty() {
                return;
            }
            self.counters.light_samples += taken.len() as u64;
            for sample in taken {
                if let Some(trials) = trials.get_mut(sample.trial.place as usize) {
                    trials.begin();
                }
            }
            side_by_side.evaluate(&world, x, &seen, &mut self.rng);
            self.queue(x, roulette);
        }
    }

    #[inline]
    fn expect(&mut self, id: LightId) {
        self.lights.prefetch(id);
    }

    #[inline]
    fn expect_soon(&mut self, id: LightId) {
        self.lights.prefetch_gloss(id);
    }

    fn radiance(&mut self, x: &GatherPoint, id: LightId) -> Vec3 {
        self.radiance_of(x, id, self.lights.intensity(id))
    }

    fn radiances(&mut self, x: &GatherPoint, lights: &[LightId], radiances: &mut Vec<Vec3>) {
        radiances.clear();
        self.scratch.asked.clear();
        self.scratch.asked_of.clear();
        for (i, &id) in lights.iter().enumerate() {
            let light = self.unoccluded_of(x, id, self.lights.intensity(id));
            radiances.push(light.as_ref().map_or(Vec3::ZERO, |light| light.radiance));
            if let Some(light) = light {
                self.scratch.asked.push(light.shadow_ray);
                self.scratch.asked_of.push(i);
            }
        }
        let started = Instant::now();
        let QueueScratch {
            asked,
            asked_of,
            occluded,
            occlusion,
            ..
        } = &mut *self.scratch;
        occluded.resize(asked.len(), false);
        self.tracer.occluded(asked, occluded, occlusion);
        for (&i, _) in asked_of
            .iter()
            .zip(&*occluded)
            .filter(|(_, occluded)| **occluded)
        {
            radiances[i] = Vec3::ZERO;
        }
        let spent = started.elapsed();
        if let Some(mark) = &mut self.mark {
            mark.since += spent;
        }
        self.counters.time(Phase::Trace, spent);
    }

    fn unit_radiance(&mut self, x: &GatherPoint, id: LightId) -> Vec3 {
        self.radiance_of(x, id, Vec3::ONE)
    }

    fn shape(&self) -> VirtualShape {
        self.shape
    }

    fn add_radiance(&mut self, x: &GatherPoint, radiance: Gathered) {
        let strength = x.strength.as_dvec3();
        let value = radiance.all * strength;
        if value.is_finite() {
            let sum = &mut self.scratch.sums[x.slot as usize];
            sum.radiance += value;
            if x.bounce == 0 {
                sum.direct += radiance.of_sources * strength;
            }
        } else {
            self.counters.nonfinite += 1;
        }
    }

    #[inline]
    fn mark(&mut self, phase: Phase) {
        if let Some(mark) = &mut self.mark {
            let now = Instant::now();
            self.counters.time(phase, (now - mark.since) * mark.weight);
            mark.since = now;
        }
    }

    fn count_dead(&mut self) {
        self.counters.dead_samples += 1;
    }
}

#[cfg(test)]
mod tests {
    use sampling::Purpose;

    use super::*;

    #[test]
    fn nothing_but_black_is_without_size() {
        for value in [Vec3::X, Vec3::new(1.0, -1.0, 0.0), Vec3::Y * 1e-45] {
            assert!(size(value) > 0.0 && size(-value) == size(value), "{value}");
        }
        assert_eq!(size(Vec3::ZERO), 0.0, "black");
    }

    #[test]
    fn one_point_in_so_many_is_timed_and_not_the_first() {
        let (scene, lights) = (Scene::default(), LightSet::default());
        let tracer = Tracer::build(&scene);
        let mut scratch = QueueScratch::default();
        let shape = VirtualShape::Sphere;
        let mut queue = ShadowQueue::new(&scene, &lights, &tracer, shape, 1, &mut scratch);
        let mut timed = Vec::new();
        for point in 0..10 * TIMED {
            queue.begin_point(Rng::new(1, 0, 0, Purpose::LightSurface));
            if queue.mark.is_some() {
                timed.push(point);
            }
            queue.end_point();
        }
        assert_eq!(timed.len(), 10, "{timed:?}");
        assert!(timed[0] > 0, "the first waits for its lights");
    }
}
