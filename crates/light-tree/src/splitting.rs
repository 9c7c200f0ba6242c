//! Importance sampling with adaptive tree splitting: lights drawn from a tree that is taken apart, on the way
//! down, where one light cannot stand for all.
//!
//! Source: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting", §5.4.

use crate::bounds::Receiver;
use crate::energy_variance::EnergyVariance;
use crate::select::{Selected, choose};
use crate::tree::{LightTree, NodeId};
use crate::weight::NodeWeights;

/// When a node is split.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplittingRule {
    /// σ above which both children are visited; infinite for never.
    greatest_deviation: f64,
    most: usize,
}

impl SplittingRule {
    /// Splits nodes for which s = (1 / (1 + σ))^¼ is below `threshold`, while fewer than `most` ≥ 1 lights are on the
    /// way to be drawn. The threshold is in 0..=1: at 0 nothing is split and one light drawn, at 1 every node is
    /// split whose lights differ at all.
    ///
    /// `most` is not in the paper, which has no bound on the time.
    ///
    /// # Panics
    /// When a number is out of range.
    pub fn new(threshold: f64, most: usize) -> Self {
        assert!(
            (0.0..=1.0).contains(&threshold),
            "splitting threshold {threshold}"
        );
        assert!(most >= 1, "at least one light is drawn");
        Self {
            // s < threshold, solved for σ, so that no root is drawn at each node.
            greatest_deviation: threshold.powi(-4) - 1.0,
            most,
        }
    }

    /// Whether no node is ever split; the variances are then not needed.
    pub fn never_splits(&self) -> bool {
        self.most == 1 || self.greatest_deviation == f64::INFINITY
    }
}

/// A node on the way down.
#[derive(Debug, Clone, Copy)]
struct Visit {
    node: NodeId,
    /// Random number, rescaled at each choice to [0, 1).
    u: f64,
    /// Probability of all choices so far. A split is no choice.
    pmf: f64,
}

/// Draws lights from a tree by splitting. Memory is kept between receivers.
#[derive(Debug, Clone, Default)]
pub struct Splitter {
    active: Vec<Visit>,
    deeper: Vec<Visit>,
    drawn: Vec<Option<Selected>>,
}

impl Splitter {
    /// Draws lights for `receiver` from the whole tree; `None` marks a branch that turned out dead.
    ///
    /// The sum over those drawn of what a light brings over its `pmf` has the expected value of the sum over all
    /// lights: whichever way a node is divided, below it that holds for each part, and no decision to split looks at a
    /// random number that is used later. `variance` is `None` only for a rule that never splits. Nodes are visited
    /// level by level, so that the rule's limit is shared among branches; `u` gives fresh numbers in [0, 1).
    ///
    /// # Panics
    /// When `variance` is missing.
    pub fn select(
        &mut self,
        tree: &LightTree,
        variance: Option<&EnergyVariance>,
        rule: SplittingRule,
        weights: NodeWeights,
        receiver: &Receiver,
        mut u: impl FnMut() -> f64,
    ) -> &[Option<Selected>] {
        assert!(
            variance.is_some() || rule.never_splits(),
            "splitting needs the variance of energy"
        );
        self.drawn.clear();
        self.active.clear();
        self.active.push(Visit {
            node: tree.root(),
            u: u(),
            pmf: 1.0,
        });
        while !self.active.is_empty() {
            self.deeper.clear();
            for (i, visit) in self.active.iter().enumerate() {
                let node = tree.node(visit.node);
                let Some(first) = node.first_child() else {
                    self.drawn
                        .push(node.light().map(|light| Selected::new(light, visit.pmf)));
                    continue;
                };
                let pair = tree.weigh(weights, receiver, first);
                let live = self.drawn.len() + self.deeper.len() + self.active.len() - i;
                let splits = live < rule.most
                    && pair[0].min(pair[1]) > 0.0
                    && variance.is_some_and(|v| {
                        v.deviation(tree, receiver, visit.node) > rule.greatest_deviation
                    });
                if splits {
                    for child in [first, NodeId(first.0 + 1)] {
                        tree.prefetch_children(child);
                        self.deeper.push(Visit {
                            node: child,
                            u: u(),
                            pmf: visit.pmf,
                        });
                    }
                    continue;
                }
                match choose(pair, visit.u) {
                    // A product of hundreds of tiny probabilities could underflow: such a light cannot be told
                    // from none.
                    Some((child, p, u)) if visit.pmf * p > 0.0 => {
                        let node = NodeId(first.0 + child);
                        tree.prefetch_children(node);
                        self.deeper.push(Visit {
                            node,
                            u,
                            pmf: visit.pmf * p,
                        });
                    }
                    _ => self.drawn.push(None),
                }
            }
            std::mem::swap(&mut self.active, &mut self.deeper);
        }
        &self.drawn
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sampling::{Purpose, Rng};
    use verify::{Running, chi_square, z_test};

    use super::*;
    use crate::build::TreeBuilder;
    use crate::lights::LightSet;
    use crate::test_lights::{
        BLACK, any_lights, any_receiver, contribution, lights_on_walls, receiver,
    };

    /// In a corner, on a wall, and in the middle of the walls' cube.
    const POINTS: [(Vec3, Vec3); 3] = [
        (Vec3::new(-0.95, -0.99, 0.9), Vec3::Y),
        (Vec3::new(-1.0, 0.3, 0.3), Vec3::X),
        (Vec3::new(0.1, 0.0, 0.2), Vec3::NEG_Z),
    ];

    fn rng() -> Rng {
        Rng::new(6, 0, 0, Purpose::Lights)
    }

    #[test]
    fn sums_of_drawn_lights_average_to_the_sum_of_all() {
        let lights = lights_on_walls(300);
        let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
        let variance = EnergyVariance::of(&tree);
        for weights in NodeWeights::ALL {
            for at in POINTS {
                let truth: f64 = lights
                    .ids()
                    .map(|id| contribution(&lights, id, at.0, at.1))
                    .sum();
                let mut last = f64::INFINITY;
                for (threshold, most) in [(0.0, 1), (0.5, 1000), (0.9, 20), (0.97, 1000)] {
                    let rule = SplittingRule::new(threshold, most);
                    let mut splitter = Splitter::default();
                    let mut rng = rng();
                    let mut sums = Running::default();
                    for _ in 0..10_000 {
                        let drawn = splitter.select(
                            &tree,
                            Some(&variance),
                            rule,
                            weights,
                            &receiver(at),
                            || rng.f64(),
                        );
                        assert!(drawn.len() <= most, "{} of {most}", drawn.len());
                        sums.add(
                            drawn
                                .iter()
                                .flatten()
                                .map(|s| contribution(&lights, s.light, at.0, at.1) / s.pmf)
                                .sum(),
                        );
                    }
                    // 48 comparisons at 5 sigma, with room for heavy tails: a false alarm is below 1e-4.
                    let z = z_test(sums.mean(), sums.variance_of_mean(), truth);
                    assert!(
                        z.abs() < 5.0,
                        "{weights:?}, {rule:?}, {at:?}: {} instead of {truth}, z = {z}",
                        sums.mean()
                    );
                    if most == 1 || threshold == 0.97 {
                        assert!(sums.variance_of_mean() < last, "{weights:?}, {rule:?}");
                        last = sums.variance_of_mean();
                    }
                }
            }
        }
    }

    #[test]
    fn a_threshold_of_zero_draws_one_light_as_often_as_its_probability() {
        let lights = lights_on_walls(200);
        let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
        let rule = SplittingRule::new(0.0, 1000);
        assert!(rule.never_splits(), "{rule:?}");
        for at in POINTS {
            let weights = NodeWeights::ContyKulla2018;
            let (pmfs, dead) = tree.pmf_below(weights, &receiver(at), tree.root());
            let mut expected = vec![0.0; lights.len() + 1];
            for (id, pmf) in pmfs {
                expected[id.index()] = pmf;
            }
            expected[lights.len()] = dead;
            let mut observed = vec![0u64; lights.len() + 1];
            let (mut splitter, mut rng) = (Splitter::default(), rng());
            for _ in 0..40_000 {
                let drawn =
                    splitter.select(&tree, None, rule, weights, &receiver(at), || rng.f64());
                assert_eq!(drawn.len(), 1, "no split");
                match drawn[0] {
                    Some(s) => observed[s.light.index()] += 1,
                    None => observed[lights.len()] += 1,
                }
            }
            let fit = chi_square(&observed, &expected);
            assert!(fit.p_value > 1e-6, "{fit:?}");
        }
    }

    #[test]
    fn a_threshold_of_one_draws_every_light_that_contributes_with_certainty() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let at = any_receiver(u, &lights)?;
            let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
                return Ok(());
            };
            let variance = EnergyVariance::of(&tree);
            let (mut splitter, mut rng) = (Splitter::default(), rng());
            let drawn = splitter.select(
                &tree,
                Some(&variance),
                SplittingRule::new(1.0, usize::MAX),
                NodeWeights::ContyKulla2018,
                &receiver(at),
                || rng.f64(),
            );
            let all: f64 = lights
                .ids()
                .map(|id| contribution(&lights, id, at.0, at.1))
                .sum();
            let estimate: f64 = drawn
                .iter()
                .flatten()
                .map(|s| contribution(&lights, s.light, at.0, at.1) / s.pmf)
                .sum();
            assert!(estimate.is_finite(), "{drawn:?}");
            // Lights that do not differ, at one place or parallel and alike, stay together.
            let split_up = drawn.iter().flatten().all(|s| s.pmf == 1.0);
            assert!(
                !split_up || (estimate - all).abs() <= 1e-9 * all + BLACK,
                "{estimate} instead of {all}: {drawn:?}"
            );
            Ok(())
        });
    }

    #[test]
    fn picks_do_not_depend_on_the_unit_of_length() {
        let at = |scale: f32| {
            let mut set = LightSet::default();
            let mut rng = Rng::new(8, 0, 0, Purpose::Build);
            for _ in 0..200 {
                let p = Vec3::new(rng.f32() - 0.5, rng.f32() + 0.1, rng.f32() - 0.5);
                set.push_point(p * scale, Vec3::splat((0.1 + rng.f32()) * scale * scale));
            }
            set.push_directional(Vec3::NEG_Y, Vec3::splat(0.1));
            set.push_directional(Vec3::new(0.6, -0.8, 0.0), Vec3::splat(0.2));
            let tree = LightTree::build(&set, TreeBuilder::Binned).expect("has lights");
            let x = receiver((Vec3::new(0.2, 0.0, 0.1) * scale, Vec3::Y));
            let mut rng = self::rng();
            Splitter::default()
                .select(
                    &tree,
                    Some(&EnergyVariance::of(&tree)),
                    SplittingRule::new(0.8, 100),
                    NodeWeights::ContyKulla2018,
                    &x,
                    || rng.f64(),
                )
                .to_vec()
        };
        let one = at(1.0);
        assert!(one.len() > 3, "split into {}", one.len());
        for k in [-20, -3, 5, 20] {
            assert_eq!(at(2.0f32.powi(k)), one, "at 2^{k}");
        }
    }
}
