//! Lightcuts: each cluster of a cut is estimated by one light of it, and clusters are split until what any of
//! them can be off by is too little to be seen.
//!
//! Source: Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005. Kept as published: other
//! methods are measured against it.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::{DVec3, Vec3};
use light_tree::{LightSet, LightTree, NodeId, Receivers, Representatives};
use sampling::Rng;
use serde::Deserialize;

use super::Method;
use super::stochastic_lightcuts::CutSize;
use crate::Inputs;
use crate::error_bound::{Clusters, Reflection};
use crate::point::GatherPoint;
use crate::render::Phase;
use crate::shadow_queue::LightEval;

/// Estimates each cluster of a cut by the light that stands for it, and splits the cluster of greatest error
/// bound until that bound is at most `error` of the total or the cut has `cut` clusters.
///
/// Deterministic and biased: the error of one cluster is bounded, with light behind walls counted as if it
/// arrived, the sum of the errors is not. Where nothing is seen to arrive no share of the total is small
/// enough, so that a point in full shadow uses up its whole cut; there is no absolute floor to set.
///
/// Departures from the paper: the bound of a virtual light is that of its sphere instead of a clamped distance;
/// error and total are compared as means of the channels; clusters that provably send nothing take no place in
/// the cut. One light is evaluated for each kind of light however small the cut.
#[derive(Debug)]
pub struct Lightcuts<'a> {
    spec: LightcutsSpec,
    clusters: Option<(&'a LightTree, &'a Representatives)>,
    lights: &'a LightSet,
}

/// Settings of [`Lightcuts`].
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightcutsSpec {
    /// Most clusters, in 1..=65536; 1000 in the paper.
    pub cut: CutSize,
    /// Greatest error bound of a cluster as a share of the total; 0.02 in the paper.
    pub error: ErrorShare,
}

impl Default for LightcutsSpec {
    fn default() -> Self {
        Self {
            cut: CutSize(1000),
            error: ErrorShare::default(),
        }
    }
}

/// A share of the total, in 0..=1.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "f64")]
pub struct ErrorShare(f64);

impl ErrorShare {
    /// As a number.
    pub fn get(self) -> f64 {
        self.0
    }
}

impl Default for ErrorShare {
    /// 2 %: what can just be seen, by Weber's law.
    fn default() -> Self {
        Self(0.02)
    }
}

impl TryFrom<f64> for ErrorShare {
    type Error = String;

    fn try_from(value: f64) -> Result<Self, String> {
        if (0.0..=1.0).contains(&value) {
            Ok(Self(value))
        } else {
            Err(format!("found {value}; expected 0..=1"))
        }
    }
}

/// A cluster that may still be split.
#[derive(Debug, Clone, Copy)]
struct Cluster {
    /// Upper bound of what the cluster sends, and so of its error.
    bound: f64,
    node: NodeId,
    /// What its light sends per unit of intensity.
    unit: Vec3,
    estimate: DVec3,
}

impl PartialEq for Cluster {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Cluster {}

impl PartialOrd for Cluster {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Cluster {
    /// By bound; ties by node, so that the order is the same everywhere.
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound
            .total_cmp(&other.bound)
            .then(other.node.cmp(&self.node))
    }
}

/// The cut under way: memory is kept from point to point.
#[derive(Debug, Default)]
pub struct LightcutsScratch {
    /// Clusters of more than one light.
    heap: BinaryHeap<Cluster>,
    total: RunningTotal,
    /// What single lights send: exact.
    exact: DVec3,
    /// Clusters and single lights.
    size: usize,
}

/// What all of a cut sends, added up anew.
fn sum(exact: DVec3, heap: &BinaryHeap<Cluster>) -> DVec3 {
    heap.iter().fold(exact, |sum, c| sum + c.estimate)
}

/// A sum that terms are taken from again.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RunningTotal {
    value: f64,
    /// The largest it was since it was last added up anew: its error is some 10⁻¹⁶ of this.
    peak: f64,
}

impl RunningTotal {
    pub(super) fn new(value: f64) -> Self {
        Self { value, peak: value }
    }

    pub(super) fn value(&self) -> f64 {
        self.value
    }

    /// Adds `change`; `sum` adds everything up anew where so much was taken away that digits are lost.
    pub(super) fn change(&mut self, change: f64, sum: impl FnOnce() -> f64) {
        self.value += change;
        self.peak = self.peak.max(self.value);
        if self.value < 1e-6 * self.peak {
            *self = Self::new(sum());
        }
    }
}

/// The mean of the channels, as [`light_tree::luminance`].
pub(super) fn mean(c: DVec3) -> f64 {
    c.element_sum() * (1.0 / 3.0)
}

/// One point's refinement.
struct Refinement<'a, 'e, E> {
    clusters: Clusters<'a>,
    x: &'a GatherPoint,
    receivers: Receivers,
    reflection: Reflection,
    eval: &'e mut E,
}

impl<E: LightEval> Refinement<'_, '_, E> {
    /// Takes node `id` into the cut and returns its estimate. `unit` is what its light sends where that is known.
    fn push(&mut self, cut: &mut LightcutsScratch, id: NodeId, unit: Option<Vec3>) -> DVec3 {
        let is_leaf = self.clusters.tree.node(id).light().is_some();
        // A single light is as quickly evaluated as bounded.
        let bound = if is_leaf {
            0.0
        } else {
            self.clusters.bound(&self.receivers, &self.reflection, id)
        };
        if bound == 0.0 && !is_leaf {
            return DVec3::ZERO;
        }
        let representatives = self.clusters.representatives;
        let unit =
            unit.unwrap_or_else(|| self.eval.unit_radiance(self.x, representatives.light(id)));
        let estimate = unit.as_dvec3() * representatives.intensity(id).as_dvec3();
        cut.size += 1;
        if is_leaf {
            cut.exact += estimate;
        } else {
            cut.heap.push(Cluster {
                bound,
                node: id,
                unit,
                estimate,
            });
        }
        estimate
    }

    fn refine(&mut self, cut: &mut LightcutsScratch, size: usize, error: f64) {
        let Clusters {
            tree,
            representatives,
            ..
        } = self.clusters;
        cut.heap.clear();
        (cut.exact, cut.size) = (DVec3::ZERO, 0);
        for root in representatives.roots() {
            self.push(cut, *root, None);
        }
        cut.total = RunningTotal::new(mean(sum(cut.exact, &cut.heap)));
        while cut.size < size {
            let Some(worst) = cut.heap.peek().copied() else {
                return;
            };
            let Some(first) = tree.node(worst.node).first_child() else {
                return;
            };
            if worst.bound <= error * cut.total.value() {
                return;
            }
            cut.heap.pop();
            cut.size -= 1;
            let light = representatives.light(worst.node);
            let mut change = -worst.estimate;
            for child in [first, NodeId(first.0 + 1)] {
                let shared = representatives.light(child) == light;
                change += self.push(cut, child, shared.then_some(worst.unit));
            }
            cut.total
                .change(mean(change), || mean(sum(cut.exact, &cut.heap)));
        }
    }
}

impl<'a> Method<'a> for Lightcuts<'a> {
    type Spec = LightcutsSpec;
    type Scratch = LightcutsScratch;

    fn prepare(spec: &LightcutsSpec, inputs: &'a Inputs) -> Self {
        Self {
            spec: spec.clone(),
            clusters: inputs.clusters(),
            lights: &inputs.lights,
        }
    }

    fn is_unbiased(&self) -> bool {
        false
    }

    fn point<E: LightEval>(
        &self,
        x: &GatherPoint,
        eval: &mut E,
        _: &mut Rng,
        cut: &mut LightcutsScratch,
    ) {
        let Some((tree, representatives)) = self.clusters else {
            return;
        };
        let clusters = Clusters {
            tree,
            representatives,
            lights: self.lights,
            shape: eval.shape(),
        };
        let mut refinement = Refinement {
            clusters,
            x,
            receivers: x.receivers(),
            reflection: Reflection::of(&x.brdf),
            eval,
        };
        refinement.refine(cut, self.spec.cut.get(), self.spec.error.get());
        eval.mark(Phase::Cut);
        eval.add_radiance(x, sum(cut.exact, &cut.heap));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contribution::VirtualShape;
    use crate::method::conformance::{gather_points, light_sets, room};
    use crate::render::Counters;
    use crate::shadow_queue::{QueueScratch, ShadowQueue};
    use light_tree::TreeBuilder;
    use sampling::Purpose;
    use scene::trace::Tracer;

    /// What a method finds at `x`, with points on virtual lights drawn from stream `sample`.
    fn at<'m, M: Method<'m>>(
        method: &M,
        inputs: &Inputs,
        tracer: &Tracer,
        shape: VirtualShape,
        x: &GatherPoint,
        sample: u64,
    ) -> (DVec3, Counters) {
        let mut scratch = QueueScratch::default();
        let mut queue = ShadowQueue::new(&inputs.lights, tracer, shape, 1, &mut scratch);
        let stream = |purpose| Rng::new(3, 0, sample, purpose);
        queue.begin_point(stream(Purpose::LightSurface));
        method.point(
            x,
            &mut queue,
            &mut stream(Purpose::Lights),
            &mut M::Scratch::default(),
        );
        queue.end_point();
        let (counters, sums) = queue.finish();
        (sums[0], counters)
    }

    fn all_lights(inputs: &Inputs) -> super::super::AllLights<'_> {
        Method::prepare(&Default::default(), inputs)
    }

    #[test]
    fn a_cut_of_all_lights_is_all_lights() {
        for glossy in [false, true] {
            let scene = room(glossy);
            let tracer = Tracer::build(&scene);
            for (name, lights) in light_sets(&scene, &tracer) {
                let inputs = Inputs::new(lights, TreeBuilder::Binned);
                let spec = LightcutsSpec {
                    error: ErrorShare(0.0),
                    ..LightcutsSpec::default()
                };
                let method = Lightcuts::prepare(&spec, &inputs);
                // Virtual lights as points have a closed form everywhere.
                let shape = VirtualShape::ClampedPoint(25.0);
                for x in gather_points(&scene) {
                    let (value, counters) = at(&method, &inputs, &tracer, shape, &x, 0);
                    let (truth, _) = at(&all_lights(&inputs), &inputs, &tracer, shape, &x, 0);
                    assert!(
                        (value - truth).abs().max_element() <= 1e-5 * truth.max_element(),
                        "{name} at {}: {value} instead of {truth}",
                        x.position
                    );
                    assert!(
                        counters.light_samples <= inputs.lights.len() as u64,
                        "{name}: a light evaluated twice"
                    );
                }
            }
        }
    }

    /// Points all over the room.
    fn many_points(scene: &scene::Scene) -> Vec<GatherPoint> {
        let mut rng = Rng::new(8, 0, 0, Purpose::Eye);
        let mut points = Vec::new();
        while points.len() < 300 {
            let hit = scene::trace::Hit {
                t: 1.0,
                triangle: (rng.f32() * 8.0) as u32,
                u: rng.f32(),
                v: rng.f32(),
            };
            let toward = Vec3::new(0.3, 1.5, 3.0);
            let place = scene.surface(&hit, Vec3::NEG_Y).position;
            let direction = (place - toward).normalize();
            if hit.u + hit.v < 1.0 {
                let surface = scene.surface(&hit, direction);
                points.push(GatherPoint::new(&surface, -direction, Vec3::ONE, 0));
            }
        }
        points
    }

    /// Two thousand lights of two kinds, about the room.
    fn many_lights(scene: &scene::Scene, tracer: &Tracer) -> LightSet {
        let mut rng = Rng::new(9, 0, 0, Purpose::Build);
        let mut lights = LightSet::default();
        let mut emitters = Vec::new();
        for _ in 0..500 {
            let [x, y, z] = [rng.f32(), rng.f32(), rng.f32()];
            let position = Vec3::new(4.0 * x - 2.0, 1.0 + 1.9 * y, 4.0 * z - 1.9);
            let intensity = Vec3::new(rng.f32(), rng.f32(), rng.f32());
            lights.push_point(position, intensity);
            emitters.push(scene::Emitter::Point {
                position,
                intensity,
            });
        }
        let lit = scene::Scene {
            emitters,
            ..scene.clone()
        };
        let spec = vpl::VirtualLightSpec {
            count: 1500,
            max_bounces: 4,
            seed: 5,
        };
        vpl::trace(&lit, tracer, &spec, &mut lights);
        lights.set_radius(0.1);
        lights
    }

    /// The promise is about each cluster; errors of either sign mostly cancel, so that the whole keeps it at
    /// most points as well. Nothing here is random: the figures are those of the seeds above.
    #[test]
    fn the_sum_of_all_errors_is_seldom_above_what_is_promised_for_one() {
        let shape = VirtualShape::ClampedPoint(100.0);
        let (mut points, mut above) = (0, 0);
        for glossy in [false, true] {
            let scene = room(glossy);
            let tracer = Tracer::build(&scene);
            let mut sets = light_sets(&scene, &tracer);
            sets.push(("many", many_lights(&scene, &tracer)));
            for (name, lights) in sets {
                let inputs = Inputs::new(lights, TreeBuilder::Binned);
                let method = Lightcuts::prepare(&LightcutsSpec::default(), &inputs);
                let mut evaluated = 0;
                for x in many_points(&scene) {
                    let (value, counters) = at(&method, &inputs, &tracer, shape, &x, 0);
                    let (truth, _) = at(&all_lights(&inputs), &inputs, &tracer, shape, &x, 0);
                    let error = mean((value - truth).abs());
                    assert!(
                        error <= 0.06 * mean(truth),
                        "{name} at {}: {value} instead of {truth}",
                        x.position
                    );
                    points += 1;
                    above += i32::from(error > 0.02 * mean(truth));
                    evaluated += counters.light_samples;
                }
                let average = evaluated / many_points(&scene).len() as u64;
                assert!(
                    name != "many" || average < inputs.lights.len() as u64 / 8,
                    "{average} of {} lights evaluated at a point",
                    inputs.lights.len()
                );
            }
        }
        assert!(
            above * 20 < points,
            "{above} of {points} points are off by more than 2 %"
        );
    }

    #[test]
    fn one_light_stands_for_lights_of_colours_that_it_lacks() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        let mut lights = LightSet::default();
        for colour in [Vec3::X, Vec3::Z * 3.0] {
            lights.push_point(Vec3::new(0.0, 2.0, 0.0), colour);
        }
        let inputs = Inputs::new(lights, TreeBuilder::Binned);
        let spec = LightcutsSpec {
            cut: CutSize(1),
            ..LightcutsSpec::default()
        };
        let method = Lightcuts::prepare(&spec, &inputs);
        for x in gather_points(&scene) {
            let (value, counters) = at(&method, &inputs, &tracer, VirtualShape::Sphere, &x, 0);
            let exact = at(
                &all_lights(&inputs),
                &inputs,
                &tracer,
                VirtualShape::Sphere,
                &x,
                0,
            )
            .0;
            assert!(counters.light_samples <= 1, "one cluster");
            assert!(
                (value - exact).abs().max_element() <= 1e-6 * exact.max_element(),
                "{value} instead of {exact}"
            );
        }
    }

    #[test]
    fn a_large_term_that_is_taken_away_again_leaves_the_small_ones() {
        let mut total = RunningTotal::new(1e20);
        total.change(1.0 - 1e20, || 1.0);
        assert_eq!(total.value(), 1.0, "added up anew");
        total.change(0.5, || unreachable!("no digits were lost"));
        assert_eq!(total.value(), 1.5, "added to");
    }

    #[test]
    fn a_share_outside_of_its_range_is_refused() {
        for bad in [-0.1, 1.1, f64::NAN, f64::INFINITY] {
            assert!(ErrorShare::try_from(bad).is_err(), "{bad}");
        }
    }
}
