//! What reaches a tile of a cut's clusters: a few rays find out.
//!
//! A cluster's weight says what its lights would bring if nothing were in the way. In a hall most of it is in the way of most
//! lights, and the samples that go to them are lost. Second moments rather than means set the weights right, as those make the
//! variance of importance sampling least (Rubinstein 1981, §4.3; for lights: Vévoda, Kondapaneni, Křivánek 2018).

use light_tree::{Draws, SharedCut, WideTree, luminance};
use sampling::Rng;

use crate::point::GatherPoint;
use crate::shadow_queue::LightEval;

/// Typical probes that each cluster has in advance: no cluster's weight falls to nothing because a few probes saw nothing.
const PRIOR: f64 = 1.0;
/// What a factor is at most, times what is typical.
const MOST: f64 = 1e3;

/// By how much the weight of each of the cut's clusters is to be multiplied, each > 0 and finite; nothing when no light reaches any of the
/// `pilots`.
///
/// One light of each cluster is drawn and traced for each of the pilots.
pub(super) fn factors<E: LightEval>(
    cut: &SharedCut,
    tree: &WideTree,
    pilots: &[GatherPoint],
    eval: &mut E,
    rng: &mut Rng,
    draws: &mut Draws,
) -> Vec<f32> {
    let mut clusters = vec![Probed::default(); cut.len()];
    let shifts: Vec<f64> = clusters.iter().map(|_| rng.f64()).collect();
    for (j, x) in pilots.iter().enumerate() {
        let albedo = f64::from(luminance(x.brdf.albedo(x.ns.dot(x.wo))));
        cut.weigh(tree, &x.receiver, draws);
        for (i, (cluster, shift)) in clusters.iter_mut().zip(&shifts).enumerate() {
            let weight = f64::from(draws.weight(i));
            // A black pilot has nothing to say.
            let expected = weight * albedo;
            if expected <= 0.0 {
                continue;
            }
            cluster.probes += 1.0;
            cluster.weight += weight;
            let u = (shift + j as f64 * GOLDEN).fract();
            if let Some(drawn) = cut.draw_within(tree, &x.receiver, i, u, draws) {
                let light = f64::from(luminance(eval.radiance(x, drawn.light)));
                let share = light / (drawn.expected * expected);
                cluster.squares += share * share;
            }
        }
    }
    let (mut sum, mut weights) = (0.0, 0.0);
    for cluster in clusters.iter().filter(|c| c.probes > 0.0) {
        sum += cluster.weight * cluster.squares / cluster.probes;
        weights += cluster.weight;
    }
    let typical = sum / weights;
    if !(typical > 0.0 && typical.is_finite()) {
        return Vec::new();
    }
    let factor = |c: &Probed| {
        let square = (c.squares / typical + PRIOR) / (c.probes + PRIOR);
        square.sqrt().min(MOST) as f32
    };
    clusters.iter().map(factor).collect()
}

/// The fraction of the golden ratio: its multiples are even over [0, 1) however many there are.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// What the probes of a cluster found.
#[derive(Debug, Clone, Copy, Default)]
struct Probed {
    probes: f64,
    /// Sum of the weights at the pilots.
    weight: f64,
    /// Sum of squares of what arrived over what the weight had it be.
    squares: f64,
}
