//! Multidimensional lightcuts: all gather points of a pixel against all lights, in clusters of pairs.
//!
//! Source: Walter, Arbree, Bala, Greenberg, "Multidimensional Lightcuts", 2006.

use glam::{DVec2, Vec3};
use light_tree::{LightOrder, LightSet, LightTree, NodeId, Representatives};
use sampling::Rng;
use serde::Deserialize;

use super::refinement::{Cluster, JUST_VISIBLE, Refinement};
use super::{Count, Fraction, Method};
use crate::Inputs;
use crate::counters::Phase;
use crate::error_bound::Clusters;
use crate::gather_tree::{GatherId, GatherTree};
use crate::point::GatherPoint;
use crate::shadow_queue::{Gathered, LightEval};

/// Estimates each cluster of pairs, gather points × lights, by one of its pairs, and splits the cluster of greatest
/// error bound until that bound is at most `error` of the pixel's total or there are `cut` clusters.
///
/// Deterministic and biased as [`Lightcuts`](super::Lightcuts) is, but what it costs depends little on the number of
/// samples a pixel has. The gather points of a cluster are given what their representative receives, each by its own
/// strength: the mean over the samples is the pixel's estimate, and their spread is that of the picture, such as at
/// an edge, with what they have in common counted as often as it was shared. Like any error of a cluster, that is no
/// part of a reported variance.
///
/// Departures from the paper, besides those of [`Lightcuts`](super::Lightcuts): the pair that represents a cluster is
/// drawn for the cluster, and not composed of one gather point and one of a few lights that every cluster of the same
/// nodes shares. In a corner one near light would be too bright for all clusters of gather points alike, each by less
/// than its share of a total that grows with the error; and where nothing but visibility tells gather points apart,
/// one in shadow would darken the pixel. Of the two ways to split a cluster the one is taken that leaves the smaller
/// bounds, found by trying both.
#[derive(Debug)]
pub struct Multidimensional<'a> {
    spec: MultidimensionalSpec,
    clusters: Option<(&'a LightTree, &'a Representatives)>,
    order: Option<&'a LightOrder>,
    lights: &'a LightSet,
}

/// Settings of [`Multidimensional`].
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MultidimensionalSpec {
    /// Most clusters of pairs a pixel, in 1..=65536; 1000 in the paper.
    pub cut: Count,
    /// Greatest error bound of a cluster as a share of the pixel's total; 0.02 in the paper.
    pub error: Fraction,
}

impl Default for MultidimensionalSpec {
    fn default() -> Self {
        Self {
            cut: Count::of(1000),
            error: JUST_VISIBLE,
        }
    }
}

/// All pairs of a gather point of one cluster and a light of another.
type Pairs = (NodeId, GatherId);

/// The pair that represents a cluster, and what they exchange.
#[derive(Debug, Clone, Copy)]
struct Sample {
    /// Where the light is in its tree's order.
    light: u32,
    /// Where the gather point is in its own.
    point: u32,
    /// What the light sends per unit of intensity.
    unit: Vec3,
}

/// The cut under way: memory is kept from pixel to pixel.
#[derive(Debug, Default)]
pub struct MultidimensionalScratch {
    gather: GatherTree,
    cut: Refinement<Pairs, Sample>,
    /// For each gather node, the radiance that each of its points has got by what was settled there.
    received: Vec<Gathered>,
}

/// What is known while one pixel's cut is refined.
struct Pixel<'a, 'e, E> {
    clusters: Clusters<'a>,
    order: &'a LightOrder,
    points: &'a [GatherPoint],
    gather: &'a GatherTree,
    received: &'a mut [Gathered],
    /// In [0, 1): which light and which gather point represent the next cluster.
    next: DVec2,
    eval: &'e mut E,
}

/// Multiples of this modulo 1 are evenly spread over the square, however many they are.
///
/// Source: Roberts 2018, "The Unreasonable Effectiveness of Quasirandom Sequences".
const STRIDE: DVec2 = DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_2);

impl<E: LightEval> Pixel<'_, '_, E> {
    /// Whether the pairs are one pair, whose estimate is exact.
    fn is_one(&self, (light, points): Pairs) -> bool {
        self.clusters.tree.node(light).light().is_some()
            && self.gather.node(points).children.is_none()
    }

    /// Upper bound of what the pairs send to the pixel.
    fn bound(&self, (light, points): Pairs) -> f64 {
        let node = self.gather.node(points);
        let strength = node.strength.as_vec3();
        self.clusters
            .bound(&node.receivers, &node.reflection, strength, light)
    }

    /// Takes `pairs` into the cut, with the `sample` that represents them where that is known.
    fn push(
        &mut self,
        cut: &mut Refinement<Pairs, Sample>,
        pairs: Pairs,
        bound: f64,
        sample: Option<Sample>,
    ) {
        if bound == 0.0 {
            return;
        }
        let sample = sample.unwrap_or_else(|| self.sample(pairs));
        let (light, points) = pairs;
        let intensity = self.clusters.representatives.intensity(light);
        let radiance = sample.unit.as_dvec3() * intensity.as_dvec3();
        let estimate = self.gather.node(points).strength * radiance;
        if self.is_one(pairs) {
            let is_source = self.clusters.is_source(light);
            self.received[points.index()] += Gathered::by(radiance, is_source);
            cut.add_exact(estimate, is_source);
        } else {
            cut.add(Cluster {
                bound,
                key: pairs,
                sample,
                estimate,
            });
        }
    }

    /// Draws one of the pairs and evaluates it.
    fn sample(&mut self, (light, points): Pairs) -> Sample {
        let u = self.next;
        self.next = (self.next + STRIDE).fract();
        let Clusters {
            tree,
            representatives,
            ..
        } = self.clusters;
        let light = self.order.draw(tree, representatives, light, u.x);
        let point = self.gather.draw(points, u.y);
        let x = &self.points[self.gather.point(point)];
        Sample {
            light,
            point,
            unit: self.eval.unit_radiance(x, self.order.light(light)),
        }
    }

    /// The `sample` of a cluster, if its pair is among those of this part of it.
    fn inherited(&self, sample: Sample, (light, points): Pairs) -> Option<Sample> {
        let holds = self.order.places(light).contains(&sample.light)
            && self.gather.node(points).contains(sample.point);
        holds.then_some(sample)
    }

    /// The pairs in two parts each with its bound, by whichever side leaves the smaller errors.
    fn split(&self, (light, points): Pairs) -> Option<[(Pairs, f64); 2]> {
        let with_bounds = |parts: [Pairs; 2]| parts.map(|part| (part, self.bound(part)));
        let by_light = self
            .clusters
            .tree
            .node(light)
            .first_child()
            .map(|first| with_bounds([first, NodeId(first.0 + 1)].map(|l| (l, points))));
        let node = self.gather.node(points);
        let by_points = node
            .children
            .map(|children| with_bounds(children.map(|g| (light, g))));
        let (by_light, by_points) = match (by_light, by_points) {
            (Some(l), Some(p)) => (l, p),
            (one, other) => return one.or(other),
        };
        // A pair alone has no error.
        let error = |parts: &[(Pairs, f64); 2]| -> f64 {
            parts
                .iter()
                .map(|&(part, bound)| if self.is_one(part) { 0.0 } else { bound })
                .sum()
        };
        let (error_l, error_p) = (error(&by_light), error(&by_points));
        let split_light = if error_l == error_p {
            // Also where the boxes overlap and nothing bounds a point light: the larger one.
            let over = self.clusters.tree.node(light);
            (over.hi - over.lo).max(Vec3::ZERO).length_squared() >= node.diagonal2
        } else {
            error_l < error_p
        };
        Some(if split_light { by_light } else { by_points })
    }

    fn refine(
        &mut self,
        cut: &mut Refinement<Pairs, Sample>,
        root: GatherId,
        size: usize,
        error: f64,
    ) {
        let representatives = self.clusters.representatives;
        cut.clear();
        for &light in representatives.roots() {
            let pairs = (light, root);
            self.push(cut, pairs, self.bound(pairs), None);
        }
        while let Some(worst) = cut.worst(size, error) {
            let Some(parts) = self.split(worst.key) else {
                return;
            };
            for (part, bound) in parts {
                let inherited = self.inherited(worst.sample, part);
                self.push(cut, part, bound, inherited);
            }
        }
    }
}

impl<'a> Method<'a> for Multidimensional<'a> {
    type Spec = MultidimensionalSpec;
    type Scratch = MultidimensionalScratch;
    const WHOLE_PIXEL: bool = true;

    fn prepare(spec: &MultidimensionalSpec, inputs: &'a Inputs) -> Self {
        Self {
            spec: spec.clone(),
            clusters: inputs.clusters(),
            order: inputs.light_order(),
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
        rng: &mut Rng,
        scratch: &mut MultidimensionalScratch,
    ) {
        self.pixel(std::slice::from_ref(x), eval, rng, scratch);
    }

    fn pixel<E: LightEval>(
        &self,
        xs: &[GatherPoint],
        eval: &mut E,
        rng: &mut Rng,
        MultidimensionalScratch {
            gather,
            cut,
            received,
        }: &mut MultidimensionalScratch,
    ) {
        let (Some((tree, representatives)), Some(order)) = (self.clusters, self.order) else {
            return;
        };
        let Some(root) = gather.build(xs, per_normal(tree, xs)) else {
            return;
        };
        received.clear();
        received.resize(gather.len(), Gathered::default());
        let clusters = Clusters {
            tree,
            representatives,
            lights: self.lights,
            shape: eval.shape(),
        };
        let mut pixel = Pixel {
            clusters,
            order,
            points: xs,
            gather,
            received,
            next: DVec2::new(rng.f64(), rng.f64()),
            eval,
        };
        pixel.refine(
            cut,
            root,
            self.spec.cut.get() as usize,
            self.spec.error.get(),
        );
        for cluster in cut.clusters() {
            let (light, points) = cluster.key;
            let radiance =
                cluster.sample.unit.as_dvec3() * representatives.intensity(light).as_dvec3();
            received[points.index()] += Gathered::by(radiance, clusters.is_source(light));
        }
        eval.mark(Phase::Cut);
        // Parents come after their children.
        for id in gather.ids().rev() {
            let (node, radiance) = (gather.node(id), received[id.index()]);
            if let Some(children) = node.children {
                for child in children {
                    received[child.index()] += radiance;
                }
            } else {
                eval.add_radiance(&xs[gather.first_point(id)], radiance);
            }
        }
    }
}

/// How far apart normals are that differ by 1: a sixteenth of the diagonal of the box around lights and points.
fn per_normal(tree: &LightTree, xs: &[GatherPoint]) -> f32 {
    // Infinite corners where no light has a place.
    let lights = tree.node(tree.root());
    let (lo, hi) = xs.iter().fold((lights.lo, lights.hi), |(lo, hi), x| {
        (lo.min(x.position), hi.max(x.position))
    });
    (hi - lo).length() / 16.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contribution::VirtualShape;
    use crate::counters::Counters;
    use crate::method::Lightcuts;
    use crate::method::conformance::{light_sets, radiances, room};
    use crate::method::fixtures::{all_lights, at, many_lights, many_points};
    use crate::method::refinement::mean;
    use crate::shadow_queue::{QueueScratch, ShadowQueue};
    use glam::DVec3;
    use light_tree::TreeBuilder;
    use sampling::Purpose;

    use scene::Scene;
    use scene::trace::{Ray, Tracer};

    const SHAPE: VirtualShape = VirtualShape::ClampedPoint(25.0);

    /// What each of the points, one a slot, receives.
    fn pixel(
        method: &Multidimensional<'_>,
        inputs: &Inputs,
        tracer: &Tracer,
        xs: &mut [GatherPoint],
    ) -> (Vec<DVec3>, Counters) {
        for (x, slot) in xs.iter_mut().zip(0..) {
            x.slot = slot;
        }
        let mut scratch = QueueScratch::default();
        // Lights without extent ask for nothing of the scene.
        let scene = scene::Scene::default();
        let lights = &inputs.lights;
        let mut queue = ShadowQueue::new(&scene, lights, tracer, SHAPE, xs.len(), &mut scratch);
        let stream = |purpose| Rng::new(3, 0, 0, purpose);
        queue.begin_points(xs.len(), stream(Purpose::LightSurface));
        method.pixel(
            xs,
            &mut queue,
            &mut stream(Purpose::Lights),
            &mut MultidimensionalScratch::default(),
        );
        queue.end_point();
        let (counters, sums) = queue.finish();
        (radiances(sums), counters)
    }

    #[test]
    fn a_cut_of_all_pairs_is_all_lights_at_every_point() {
        for glossy in [false, true] {
            let scene = room(glossy);
            let tracer = Tracer::build(&scene);
            for (name, lights) in light_sets(&scene, &tracer) {
                let inputs = Inputs::new(lights, TreeBuilder::Binned);
                let spec = MultidimensionalSpec {
                    cut: Count::of(65536),
                    error: Fraction::of(0.0),
                };
                let method = Multidimensional::prepare(&spec, &inputs);
                let mut xs = many_points(&scene);
                xs.truncate(20);
                xs[3].strength = Vec3::new(0.5, 2.0, 0.0);
                let (values, counters) = pixel(&method, &inputs, &tracer, &mut xs);
                assert!(
                    counters.light_samples <= (inputs.lights.len() * xs.len()) as u64,
                    "{name}: a pair evaluated twice"
                );
                for (x, value) in xs.iter().zip(values) {
                    let x = GatherPoint { slot: 0, ..*x };
                    let (truth, _) = at(&all_lights(&inputs), &inputs, &tracer, SHAPE, &x, 0);
                    assert!(
                        (value - truth).abs().max_element() <= 1e-5 * truth.max_element(),
                        "{name} at {}: {value} instead of {truth}",
                        x.position
                    );
                }
            }
        }
    }

    /// The gather points of a pixel that the camera of the room sees in `direction`.
    fn pixel_points(scene: &Scene, tracer: &Tracer, direction: Vec3) -> Vec<GatherPoint> {
        let mut rng = Rng::new(4, 0, 0, Purpose::Eye);
        let mut xs = Vec::new();
        for _ in 0..64 {
            let jitter = Vec3::new(rng.f32(), rng.f32(), 0.0) * 0.01;
            let direction = (direction + jitter).normalize();
            let ray = Ray {
                origin: Vec3::new(0.3, 1.5, 3.0),
                direction,
                t_max: f32::INFINITY,
            };
            if let Some(hit) = tracer.closest(&ray) {
                let surface = scene.surface(&hit, direction);
                let strength = Vec3::splat(1.0 / 64.0);
                xs.push(GatherPoint::new(&surface, -direction, strength, 0));
            }
        }
        xs
    }

    /// Nothing here is random: the figures are those of the seeds.
    #[test]
    fn a_pixel_is_about_right_for_a_small_part_of_the_work() {
        let (mut pixels, mut off) = (0, 0);
        for glossy in [false, true] {
            let scene = room(glossy);
            let tracer = Tracer::build(&scene);
            let inputs = Inputs::new(many_lights(&scene, &tracer), TreeBuilder::Binned);
            let method = Multidimensional::prepare(&Default::default(), &inputs);
            let one_by_one = Lightcuts::prepare(&Default::default(), &inputs);
            let (mut samples, mut samples_one_by_one) = (0, 0);
            for i in 0..35_u8 {
                let (column, row) = (f32::from(i % 7) - 3.0, f32::from(i / 7) - 2.0);
                let direction = Vec3::new(0.14 * column, 0.14 * row - 0.3, -1.0);
                let mut xs = pixel_points(&scene, &tracer, direction);
                let (values, counters) = pixel(&method, &inputs, &tracer, &mut xs);
                samples += counters.light_samples;
                let mut truth = DVec3::ZERO;
                for x in &xs {
                    let x = GatherPoint { slot: 0, ..*x };
                    truth += at(&all_lights(&inputs), &inputs, &tracer, SHAPE, &x, 0).0;
                    let (_, counters) = at(&one_by_one, &inputs, &tracer, SHAPE, &x, 0);
                    samples_one_by_one += counters.light_samples;
                }
                let value: DVec3 = values.iter().sum();
                let error = mean((value - truth).abs());
                assert!(
                    error <= 0.15 * mean(truth),
                    "{value} instead of {truth} along {direction}"
                );
                pixels += 1;
                off += i32::from(error > 0.05 * mean(truth));
            }
            assert!(
                samples * 20 < samples_one_by_one,
                "{samples} evaluations, {samples_one_by_one} point by point"
            );
        }
        assert!(
            off * 8 < pixels,
            "{off} of {pixels} pixels are off by more than 5 %"
        );
    }
}
