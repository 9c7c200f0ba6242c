//! The stopping rule of the published code of Stochastic Lightcuts: a cluster is split only while it may be off by
//! more than a share of what was sampled so far.
//!
//! Source: the code published with Lin and Yuksel 2020, "Real-Time Stochastic Lightcuts", for the method of 2019.

use glam::DVec3;
use light_tree::{LightSet, LightTree, NodeId, NodeWeights};
use sampling::Rng;

use super::refinement::{Cluster, Refinement};
use crate::counters::Phase;
use crate::error_bound::Reflection;
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;

/// A cut whose clusters each carry how their light was drawn.
pub(super) type SampledCut = Refinement<NodeId, Drawn>;

/// How a light was drawn from a cluster.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drawn {
    /// The number that draws it, given the cluster.
    u: f64,
    /// Whether it is one of the scene's own.
    pub(super) is_source: bool,
}

/// A light drawn from a cluster.
struct Sample {
    drawn: Drawn,
    /// What it sends to the viewer over its probability, given the cluster; 0 where no light was found.
    estimate: DVec3,
}

/// What is known while one point's cut is sampled and refined.
pub(super) struct RunningTotal<'a, 'e, E> {
    tree: &'a LightTree,
    lights: &'a LightSet,
    weights: NodeWeights,
    x: &'a GatherPoint,
    /// Greatest BRDF × cosine at the point, sr⁻¹.
    reflection: f64,
    eval: &'e mut E,
    rng: &'e mut Rng,
}

impl<'a, 'e, E: LightEval> RunningTotal<'a, 'e, E> {
    pub(super) fn new(
        tree: &'a LightTree,
        lights: &'a LightSet,
        weights: NodeWeights,
        x: &'a GatherPoint,
        eval: &'e mut E,
        rng: &'e mut Rng,
    ) -> Self {
        let reflection = f64::from(Reflection::of(x).greatest());
        Self {
            tree,
            lights,
            weights,
            x,
            reflection,
            eval,
            rng,
        }
    }

    /// Draws a light of the whole tree, and splits the cluster of greatest bound until that bound is at most `error` of
    /// the sum of all estimates or the cut has `size` clusters.
    ///
    /// A cluster's sample stays good for the child that holds its light, which has a greater probability there; only the
    /// other child draws anew.
    ///
    /// A sum that is too large by chance ends the refinement and one that is too small does not, so that the estimate
    /// is biased: for lights a > b drawn with probability 1/2 each, where 2a is enough to stop and 2b is not, it
    /// is (3a + b) / 2 on average.
    ///
    /// Departures: bounds count the greatest reflection of the surface, so that they compare with what is
    /// reflected. Where the sum is 0 no bound is small enough, in place of a fixed floor.
    pub(super) fn refine(&mut self, cut: &mut SampledCut, size: usize, error: f64) {
        cut.clear();
        self.push(cut, self.tree.root(), None);
        while let Some(worst) = cut.worst(size, error) {
            let Some(first) = self.tree.node(worst.key).first_child() else {
                return;
            };
            let receiver = &self.x.receiver;
            let chosen = self
                .tree
                .choose_child(self.weights, receiver, worst.key, worst.sample.u);
            for child in [first, NodeId(first.0 + 1)] {
                let kept = chosen.filter(|c| c.child == child).map(|c| Sample {
                    drawn: Drawn {
                        u: c.u,
                        ..worst.sample
                    },
                    estimate: worst.estimate * c.pmf,
                });
                self.push(cut, child, kept);
            }
        }
    }

    /// Takes node `id` into the cut, with its `sample` where there is one. What provably brings nothing is left out.
    fn push(&mut self, cut: &mut SampledCut, id: NodeId, sample: Option<Sample>) {
        let irradiance = self.tree.bound(self.weights, &self.x.receiver, id);
        let bound = self.reflection * f64::from(irradiance);
        if bound == 0.0 {
            return;
        }
        let Sample { drawn, estimate } = sample.unwrap_or_else(|| self.draw(id));
        // One light is its own exact estimate.
        if self.tree.node(id).light().is_some() {
            cut.add_exact(estimate, drawn.is_source);
        } else {
            cut.add(Cluster {
                bound,
                key: id,
                sample: drawn,
                estimate,
            });
        }
    }

    fn draw(&mut self, id: NodeId) -> Sample {
        self.eval.mark(Phase::Cut);
        let u = self.rng.f64();
        let drawn = self.tree.select(self.weights, &self.x.receiver, id, u);
        self.eval.mark(Phase::Select);
        let (estimate, is_source) = match drawn {
            Some(s) => (
                self.eval.radiance(self.x, s.light).as_dvec3() / s.pmf,
                self.lights.is_source(s.light),
            ),
            None => {
                self.eval.count_dead();
                (DVec3::ZERO, false)
            }
        };
        self.eval.mark(Phase::Evaluate);
        Sample {
            drawn: Drawn { u, is_source },
            estimate,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Inputs;
    use crate::contribution::VirtualShape;
    use crate::counters::Counters;
    use crate::method::Count;
    use crate::method::conformance::{Estimates, gather_points, light_sets, room, running};
    use crate::method::fixtures::{all_lights, at};
    use crate::method::{
        Fraction, MethodSpec, RunningTotalSpec, StochasticLightcutsSpec, Stopping,
    };
    use glam::Vec3;
    use light_tree::{LightSet, TreeBuilder};
    use scene::trace::Tracer;
    use verify::{critical_z, sidak, z_test};

    /// Estimates of the light at `x` by cuts of `cut` clusters, with the share of the running total that is allowed.
    fn estimates(
        inputs: &Inputs,
        tracer: &Tracer,
        x: GatherPoint,
        cut: u32,
        error: f64,
    ) -> (Vec<DVec3>, Counters) {
        let error = Fraction::try_from(error).expect("in range");
        let method = MethodSpec::StochasticLightcuts(StochasticLightcutsSpec {
            cut: Count::of(cut),
            stopping: Stopping::RunningTotal(RunningTotalSpec { error }),
            ..Default::default()
        });
        let visitor = Estimates {
            // Lights without extent ask for nothing of the scene.
            scene: &scene::Scene::default(),
            inputs,
            tracer,
            x,
            count: 4000,
            seed: 17,
        };
        let (unbiased, values, counters) = method.visit(inputs, visitor);
        assert!(!unbiased, "the method says that it is biased");
        (values, counters)
    }

    /// A red and a blue light in one place, and a white one far off that outshines them.
    fn two_beside_a_bright_one() -> LightSet {
        let mut lights = LightSet::default();
        for colour in [Vec3::X, Vec3::Z] {
            lights.push_point(Vec3::new(0.5, 2.0, 1.0), colour);
        }
        lights.push_point(Vec3::new(-1.5, 2.5, 1.5), Vec3::splat(3.0));
        lights
    }

    #[test]
    fn a_lucky_sample_stops_the_refinement_and_brightens_by_what_is_predicted() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        let x = gather_points(&scene)[0];
        let alone = |pick: usize| {
            let all = two_beside_a_bright_one();
            let id = all.ids().nth(pick).expect("three lights");
            let mut one = LightSet::default();
            one.push_point(all.position(id), all.intensity(id));
            let inputs = Inputs::new(one, TreeBuilder::Binned);
            at(
                &all_lights(&inputs),
                &inputs,
                &tracer,
                VirtualShape::Sphere,
                &x,
                0,
            )
            .0
        };
        let (a, b, bright) = (alone(0), alone(1), alone(2));
        assert!(
            a.x > 0.0 && b.z > 0.0 && bright.y > 0.0,
            "{a}, {b}, {bright}"
        );
        // The red light and the blue one are drawn alike, but the surface reflects more of the red. The bound of
        // both is 2a. Between the totals with 2b and with 2a the first only goes on.
        let mean = |c: DVec3| c.element_sum() / 3.0;
        let error = 2.0 * mean(a) / mean(bright + a + b);
        let inputs = Inputs::new(two_beside_a_bright_one(), TreeBuilder::Binned);
        let (values, _) = estimates(&inputs, &tracer, x, 10, error);
        let predicted = bright + (3.0 * a + b) / 2.0;
        // Per channel: a stops at 2a half of the time, b goes on to a + b.
        for channel in [0, 2] {
            let found = running(&values, channel);
            let z = z_test(found.mean(), found.variance_of_mean(), predicted[channel]);
            // Two comparisons at 5 sigma: a false alarm is 1e-6.
            assert!(
                z.abs() < 5.0,
                "{} instead of {predicted}, z = {z}",
                found.mean()
            );
            let unbiased = (bright + a + b)[channel];
            let z = z_test(found.mean(), found.variance_of_mean(), unbiased);
            assert!(
                z.abs() > 20.0,
                "{} does not tell {unbiased} apart",
                found.mean()
            );
        }
    }

    #[test]
    fn with_no_error_allowed_it_averages_to_all_lights() {
        let mut scores = Vec::new();
        for glossy in [false, true] {
            let scene = room(glossy);
            let tracer = Tracer::build(&scene);
            for (name, lights) in light_sets(&scene, &tracer) {
                let inputs = Inputs::new(lights, TreeBuilder::Binned);
                for x in gather_points(&scene) {
                    let (values, counters) = estimates(&inputs, &tracer, x, 10, 0.0);
                    assert_eq!(counters.nonfinite, 0, "{name}");
                    let all = Estimates {
                        scene: &scene,
                        inputs: &inputs,
                        tracer: &tracer,
                        x,
                        count: 200,
                        seed: 18,
                    };
                    let (_, exact, _) =
                        MethodSpec::AllLights(Default::default()).visit(&inputs, all);
                    let (found, truth) = (running(&values, 1), running(&exact, 1));
                    let rounding = 1e-7 * truth.mean();
                    let variance =
                        found.variance_of_mean() + truth.variance_of_mean() + rounding * rounding;
                    scores.push((
                        z_test(found.mean(), variance, truth.mean()),
                        name,
                        x.position,
                    ));
                }
            }
        }
        // A false alarm once in 10⁴ seeds, with room for heavy tails.
        let limit = 1.2 * critical_z(sidak(1e-4, scores.len()));
        for (z, name, at) in scores {
            assert!(z.abs() < limit, "{name} at {at}: z = {z}");
        }
    }

    #[test]
    fn a_point_costs_no_more_lights_than_the_cut_has_clusters_and_fewer_where_error_is_allowed() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        let (_, lights) = light_sets(&scene, &tracer).swap_remove(3);
        let inputs = Inputs::new(lights, TreeBuilder::Binned);
        let x = gather_points(&scene)[0];
        let samples = |error| estimates(&inputs, &tracer, x, 100, error).1.light_samples;
        // A light for the root and one for each split.
        let (full, some) = (samples(0.0), samples(0.3));
        assert!(full <= 4000 * 100, "{full} lights");
        assert!(
            some < full && some >= 4000,
            "{some} lights, {full} without error"
        );
    }
}
