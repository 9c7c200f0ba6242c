//! What reaches a tile of a cut's clusters: a few rays find out, and then the samples themselves.
//!
//! A cluster's weight says what its lights would bring if nothing were in the way. In a hall most of it is in the way of most
//! lights, and the samples that go to them are lost. Second moments rather than means set the weights right, as those make the
//! variance of importance sampling least (Rubinstein 1981, §4.3; for lights: Vévoda, Kondapaneni, Křivánek 2018).
//!
//! What is in the way differs from pixel to pixel. Each block of a few pixels has factors of its own, by what came of the
//! lights that were drawn for it; what it has not tried it takes from the tile, and that from its probes.

use light_tree::{Descents, Draws, SharedCut, WideTree, luminance};
use sampling::Rng;

use crate::learned::{Learned, Probed};
use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;

/// So many trials each cluster has in advance, with what was known before: typical ones the probes, theirs the tile, the
/// tile's each of its blocks. A cluster whose sixteen probes saw nothing keeps half its weight. With fewer the noise of most
/// pixels is lower, but one in ten thousand finds a light that was thought hidden, thirty times too bright.
const PRIOR: f64 = 6.0;
/// What a factor is at most, times what is typical: one probe that met a light at arm's length must not draw a whole tile's
/// samples to its cluster, as what another pixel then finds elsewhere by chance would count for too much.
const MOST: f64 = 2.0;

/// What each of the cut's clusters brings to the `pilots`, to each of which one light of each is drawn and traced.
pub(super) fn probe<E: LightEval>(
    cut: &SharedCut,
    tree: &WideTree,
    pilots: &[GatherPoint],
    eval: &mut E,
    rng: &mut Rng,
    draws: &mut Draws,
    descents: &mut Descents,
) -> Probed {
    let mut clusters = vec![Cluster::default(); cut.len()];
    let (mut lights, mut radiances) = (Vec::new(), Vec::new());
    let shifts: Vec<f64> = clusters.iter().map(|_| rng.f64()).collect();
    for (j, x) in pilots.iter().enumerate() {
        let albedo = f64::from(luminance(x.brdf.albedo(x.ns.dot(x.wo))));
        cut.weigh(tree, &x.receiver, draws);
        let weight = |i: usize| f64::from(draws.weight(i));
        // A black pilot has nothing to say.
        let probed = shifts
            .iter()
            .enumerate()
            .filter(|(i, _)| weight(*i) * albedo > 0.0);
        for (i, _) in probed.clone() {
            clusters[i].probes += 1.0;
            clusters[i].weight += weight(i);
        }
        let numbers = probed.map(|(i, shift)| (i, (shift + j as f64 * GOLDEN).fract()));
        descents.clear();
        cut.pick_within(tree, &x.receiver, numbers, draws, descents);
        descents.descend(tree);
        let drawn = descents.drawn(0).iter().flatten();
        lights.clear();
        for drawn in drawn.clone() {
            eval.expect(drawn.light);
            lights.push(drawn.light);
        }
        eval.radiances(x, &lights, &mut radiances);
        for (drawn, &radiance) in drawn.zip(&radiances) {
            let light = f64::from(luminance(radiance));
            let share = light / (drawn.weight * albedo);
            clusters[drawn.cluster as usize].squares += share * share;
        }
    }
    let (mut sum, mut weights) = (0.0, 0.0);
    for cluster in clusters.iter().filter(|c| c.probes > 0.0) {
        sum += cluster.weight * cluster.squares / cluster.probes;
        weights += cluster.weight;
    }
    let typical = sum / weights;
    if !(typical > 0.0 && typical.is_finite()) {
        return Probed {
            squares: vec![1.0; clusters.len()],
            typical: 0.0,
        };
    }
    let square = |c: &Cluster| ((c.squares / typical + PRIOR) / (c.probes + PRIOR)) as f32;
    Probed {
        squares: clusters.iter().map(square).collect(),
        typical,
    }
}

impl Probed {
    /// What clusters' weights are to be multiplied by, each > 0 and finite; 1 for all when no light reached any pilot.
    pub(crate) fn factors(&self) -> impl Iterator<Item = f32> {
        self.squares.iter().map(|&square| factor(square.into()))
    }
}

impl Learned {
    /// Takes in what came of the trials so far. Nothing is left of the order in which they were made.
    pub(crate) fn take_in(&mut self) {
        let clusters = self.probed.squares.len();
        let mut squares: Vec<f64> = Vec::with_capacity(clusters);
        for (c, &probed) in self.probed.squares.iter().enumerate() {
            let of_tile = self.trials.iter().skip(c).step_by(clusters.max(1));
            let (count, sum) = of_tile.fold((0.0, 0.0), |(count, sum), trials| {
                (count + f64::from(trials.count), sum + trials.squares())
            });
            squares.push((sum + PRIOR * f64::from(probed)) / (count + PRIOR));
        }
        let known = squares.iter().cycle();
        for ((to, trials), known) in self.factors.iter_mut().zip(&self.trials).zip(known) {
            let square = (trials.squares() + PRIOR * known) / (f64::from(trials.count) + PRIOR);
            *to = factor(square);
        }
    }
}

/// The factor of a cluster with this mean square, in units of what is typical.
fn factor(square: f64) -> f32 {
    square.sqrt().min(MOST) as f32
}

/// The fraction of the golden ratio: its multiples are even over [0, 1) however many there are.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// What the probes of a cluster found.
#[derive(Debug, Clone, Copy, Default)]
struct Cluster {
    probes: f64,
    /// Sum of the weights at the pilots.
    weight: f64,
    /// Sum of squares of what arrived over what the weight had it be.
    squares: f64,
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use light_tree::{LightSet, TreeBuilder};
    use sampling::Purpose;
    use scene::trace::{Hit, Tracer};

    use super::*;
    use crate::Inputs;
    use crate::contribution::VirtualShape;
    use crate::learned::Trials;
    use crate::method::conformance::room;
    use crate::shadow_queue::{QueueScratch, ShadowQueue};

    #[test]
    fn what_is_hidden_is_drawn_less_and_the_variance_falls() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        // A ceiling of lights, of which the block's roof leaves few in sight of the floor below it.
        let mut lights = LightSet::default();
        for i in 0..900 {
            let (x, z) = ((i % 30) as f32 / 7.5 - 1.99, (i / 30) as f32 / 7.5 - 1.99);
            lights.push_point(Vec3::new(x, 2.5, z), Vec3::ONE);
        }
        let inputs = Inputs::new(lights, TreeBuilder::Binned);
        let tree = inputs.wide_tree().expect("has lights");
        let pilots: Vec<_> = (0..16)
            .map(|i| {
                // On the floor, about (-0.3, 0, -0.1): below the block's roof.
                let hit = Hit {
                    t: 1.0,
                    triangle: 0,
                    u: 0.05 + 0.002 * (i % 4) as f32,
                    v: 0.42 + 0.005 * (i / 4) as f32,
                };
                let down = Vec3::NEG_Y;
                GatherPoint::new(&scene.surface(&hit, down), -down, Vec3::ONE, 0)
            })
            .collect();
        assert!(pilots.iter().all(|x| x.ns == Vec3::Y), "on the floor");
        let shape = VirtualShape::Sphere;
        let mut memory = QueueScratch::default();
        let mut queue = ShadowQueue::new(&scene, &inputs.lights, &tracer, shape, 0, &mut memory);
        let (mut cut, mut draws) = (SharedCut::default(), Draws::default());
        let mut descents = Descents::default();
        let receivers: Vec<_> = pilots.iter().map(|x| x.receiver).collect();
        cut.refine(tree, &receivers, 128);
        let rng = &mut Rng::new(6, 0, 0, Purpose::Probe);
        let probed = probe(
            &cut,
            tree,
            &pilots,
            &mut queue,
            rng,
            &mut draws,
            &mut descents,
        );
        let factors: Vec<_> = probed.factors().collect();
        assert_eq!(factors.len(), cut.len());
        assert!(factors.iter().all(|f| f.is_finite() && *f > 0.0));

        let x = &pilots[5];
        let mut moments = |factors: &[f32]| {
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..4000 {
                cut.weigh(tree, &x.receiver, &mut draws);
                draws.scale(factors);
                cut.settle(tree, 1, &mut draws);
                let u = rng.f64();
                let drawn = cut.draw(tree, &x.receiver, u, &mut draws, &mut descents);
                let drawn = drawn.iter().flatten();
                let estimate: f64 = drawn
                    .map(|d| f64::from(luminance(queue.radiance(x, d.light))) / d.expected)
                    .sum();
                sum += estimate;
                squares += estimate * estimate;
            }
            (sum / 4000.0, squares / 4000.0)
        };
        let (mean, square) = moments(&[]);
        let (learned_mean, learned_square) = moments(&factors);
        let variances = [
            square - mean * mean,
            learned_square - learned_mean * learned_mean,
        ];
        // Means over 4000 draws each, 5 sigma: false alarm 6e-7.
        let sigma = ((variances[0] + variances[1]) / 4000.0).sqrt();
        assert!(
            (mean - learned_mean).abs() < 5.0 * sigma,
            "{mean} and {learned_mean}"
        );
        assert!(variances[1] * 2.0 < variances[0], "{variances:?}");
    }

    #[test]
    fn blocks_learn_from_their_trials_and_from_the_tiles_where_they_have_none() {
        let probed = Probed {
            squares: vec![1.0; 3],
            typical: 0.25,
        };
        let mut learned = Learned::of(probed);
        let of_block = |block: usize| 3 * block..3 * block + 3;
        // Cluster 0 was hidden from block 0 and in full sight of block 1, cluster 1 of both; nobody tried cluster 2.
        for (place, arrives) in [(0, 0.0), (3, 1.0), (1, 1.0), (4, 1.0)] {
            for _ in 0..100 {
                learned.trials[place].begin();
                learned.trials[place].arrive(Trials::square(arrives, 1.0));
            }
        }
        learned.take_in();
        let factors = |block| &learned.factors[of_block(block)];
        assert!(factors(0)[0] < 0.2, "{:?}", factors(0));
        assert!((factors(1)[0] - 1.0).abs() < 0.02, "{:?}", factors(1));
        // The tile saw half of it.
        assert!(
            (factors(7)[0] - 0.5f32.sqrt()).abs() < 0.02,
            "{:?}",
            factors(7)
        );
        for block in [0, 1, 7] {
            assert!(
                (factors(block)[1] - 1.0).abs() < 1e-6,
                "{:?}",
                factors(block)
            );
            assert_eq!(factors(block)[2], 1.0);
        }
        // The same trials say the same again.
        let before = learned.clone();
        learned.take_in();
        assert_eq!(learned, before);
    }

    #[test]
    fn nothing_is_learned_where_nothing_arrives() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        let mut lights = LightSet::default();
        for i in 0..20 {
            lights.push_point(Vec3::new(i as f32, -1.0, 0.0), Vec3::ONE);
        }
        let inputs = Inputs::new(lights, TreeBuilder::Binned);
        let tree = inputs.wide_tree().expect("has lights");
        let pilots = crate::method::conformance::gather_points(&scene);
        let mut memory = QueueScratch::default();
        let shape = VirtualShape::Sphere;
        let mut queue = ShadowQueue::new(&scene, &inputs.lights, &tracer, shape, 0, &mut memory);
        let (mut cut, mut draws) = (SharedCut::default(), Draws::default());
        let mut descents = Descents::default();
        cut.refine(tree, &[pilots[0].receiver], 8);
        let rng = &mut Rng::new(6, 0, 0, Purpose::Probe);
        let on_floor = &pilots[..1];
        for pilots in [on_floor, &[]] {
            let probed = probe(
                &cut,
                tree,
                pilots,
                &mut queue,
                rng,
                &mut draws,
                &mut descents,
            );
            let factors: Vec<_> = probed.factors().collect();
            assert_eq!(factors, vec![1.0; cut.len()], "{} pilots", pilots.len());
            assert_eq!(probed.typical, 0.0);
        }
    }
}
