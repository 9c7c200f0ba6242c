//! Lightcuts: each cluster of a cut is estimated by one light of it, and clusters are split until what any of
//! them can be off by is too little to be seen.
//!
//! Source: Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005. Kept as published: other
//! methods are measured against it.

use glam::Vec3;
use light_tree::{LightSet, LightTree, NodeId, Receivers, Representatives};
use sampling::Rng;
use serde::Deserialize;

use super::refinement::{Cluster, JUST_VISIBLE, Refinement};
use super::{Count, Fraction, Method};
use crate::Inputs;
use crate::counters::Phase;
use crate::error_bound::{Clusters, Reflection};
use crate::point::GatherPoint;
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
    pub cut: Count,
    /// Greatest error bound of a cluster as a share of the total; 0.02 in the paper.
    pub error: Fraction,
}

impl Default for LightcutsSpec {
    fn default() -> Self {
        Self {
            cut: Count::of(1000),
            error: JUST_VISIBLE,
        }
    }
}

/// The cut under way: memory is kept from point to point. A cluster's sample is what its light sends per unit of
/// intensity.
#[derive(Debug, Default)]
pub struct LightcutsScratch(Refinement<NodeId, Vec3>);

/// What is known while one point's cut is refined.
struct Point<'a, 'e, E> {
    clusters: Clusters<'a>,
    x: &'a GatherPoint,
    receivers: Receivers,
    reflection: Reflection,
    eval: &'e mut E,
}

impl<E: LightEval> Point<'_, '_, E> {
    /// Takes node `id` into the cut. `unit` is what its light sends where that is known.
    fn push(&mut self, cut: &mut Refinement<NodeId, Vec3>, id: NodeId, unit: Option<Vec3>) {
        let Clusters {
            tree,
            representatives,
            ..
        } = self.clusters;
        let is_leaf = tree.node(id).light().is_some();
        // A single light is as quickly evaluated as bounded.
        let bound = if is_leaf {
            0.0
        } else {
            self.clusters
                .bound(&self.receivers, &self.reflection, Vec3::ONE, id)
        };
        if bound == 0.0 && !is_leaf {
            return;
        }
        let unit =
            unit.unwrap_or_else(|| self.eval.unit_radiance(self.x, representatives.light(id)));
        let estimate = unit.as_dvec3() * representatives.intensity(id).as_dvec3();
        if is_leaf {
            let is_source = self.clusters.is_source(id);
            cut.add_exact(estimate, is_source);
        } else {
            cut.add(Cluster {
                bound,
                key: id,
                sample: unit,
                estimate,
            });
        }
    }

    fn refine(&mut self, cut: &mut Refinement<NodeId, Vec3>, size: usize, error: f64) {
        let Clusters {
            tree,
            representatives,
            ..
        } = self.clusters;
        cut.clear();
        for root in representatives.roots() {
            self.push(cut, *root, None);
        }
        while let Some(worst) = cut.worst(size, error) {
            let Some(first) = tree.node(worst.key).first_child() else {
                return;
            };
            let light = representatives.light(worst.key);
            for child in [first, NodeId(first.0 + 1)] {
                let shared = representatives.light(child) == light;
                self.push(cut, child, shared.then_some(worst.sample));
            }
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
        LightcutsScratch(cut): &mut LightcutsScratch,
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
        let mut point = Point {
            clusters,
            x,
            receivers: x.receivers(),
            reflection: Reflection::of(x),
            eval,
        };
        point.refine(cut, self.spec.cut.get() as usize, self.spec.error.get());
        eval.mark(Phase::Cut);
        eval.add_radiance(x, cut.sum(|cluster| clusters.is_source(cluster.key)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contribution::VirtualShape;
    use crate::method::conformance::{gather_points, light_sets, room};
    use crate::method::fixtures::{all_lights, at, many_lights, many_points};
    use crate::method::refinement::mean;
    use light_tree::TreeBuilder;
    use scene::trace::Tracer;

    #[test]
    fn a_cut_of_all_lights_is_all_lights() {
        for glossy in [false, true] {
            let scene = room(glossy);
            let tracer = Tracer::build(&scene);
            for (name, lights) in light_sets(&scene, &tracer) {
                let inputs = Inputs::new(lights, TreeBuilder::Binned);
                let spec = LightcutsSpec {
                    error: Fraction::of(0.0),
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
                        error <= 0.08 * mean(truth),
                        "{name} at {}: {value} instead of {truth}",
                        x.position
                    );
                    points += 1;
                    above += i32::from(error > 0.02 * mean(truth));
                    evaluated += counters.light_samples;
                }
                let average = evaluated / many_points(&scene).len() as u64;
                // Where the lobes of virtual lights on glossy walls point, no bound of a cluster tells.
                let share = if glossy { 4 } else { 8 };
                assert!(
                    name != "many" || average < inputs.lights.len() as u64 / share,
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
            cut: Count::of(1),
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
}
