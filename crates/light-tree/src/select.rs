//! Hierarchical importance sampling: one light from a cluster.

use crate::bounds::Receiver;
use crate::lights::LightId;
use crate::tree::{LightTree, NodeId, Pair};
use crate::weight::NodeWeights;

/// What happens when neither child of a node can light the receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeadBranch {
    /// No light is drawn: the sample is worth 0, and the estimate unbiased.
    #[default]
    Stop,
    /// Algorithm 1 to the letter: go on with the sibling passed last, with the probability and the random
    /// number held before that branch. Brightens: see [`LightTree::select_retry`].
    Retry,
}

/// A light drawn from a cluster.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Selected {
    /// Which light.
    pub light: LightId,
    /// Probability of drawing it, given the cluster, in (0, 1].
    pub pmf: f64,
}

/// The child of a node that a random number falls to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chosen {
    /// Which child.
    pub child: NodeId,
    /// Probability of choosing it, given the node, in (0, 1].
    pub pmf: f64,
    /// What is left of the number: again uniform in [0, 1). It draws the light below the child that the whole number
    /// draws below the node.
    pub u: f64,
}

/// A descent under way.
#[derive(Debug, Clone, Copy)]
struct Descent {
    node: NodeId,
    /// Random number, rescaled at each level to [0, 1).
    u: f64,
    pmf: f64,
    /// Position in the caller's list of results.
    slot: usize,
}

/// Largest f64 below 1.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

/// Chooses by `weights` with `u`; returns the chosen child, its probability and the rescaled number.
#[inline]
pub(crate) fn choose(weights: [f32; 2], u: f64) -> Option<(u32, f64, f64)> {
    let [w0, w1] = weights.map(f64::from);
    let sum = w0 + w1;
    debug_assert!(sum.is_finite(), "weights {weights:?}");
    if sum <= 0.0 {
        return None;
    }
    // Selected, not branched on: the outcome is random, and a wrong guess costs more than the sums.
    // A child of weight 0 is never taken: scaled < w0 fails for w0 = 0 and holds for w0 = sum.
    let scaled = u * sum;
    let right = scaled >= w0 && w1 > 0.0;
    let (w, passed) = if right { (w1, w0) } else { (w0, 0.0) };
    Some((
        u32::from(right),
        w / sum,
        ((scaled - passed) / w).clamp(0.0, BELOW_ONE),
    ))
}

/// Draws one light from each of many clusters, all descending side by side so that the memory latencies of
/// one hide behind the others'. Memory is kept between receivers.
#[derive(Debug, Clone, Default)]
pub struct Selector {
    active: Vec<Descent>,
    drawn: Vec<Option<Selected>>,
}

impl Selector {
    /// Draws one light below each of `nodes` with the random numbers `u`, each in [0, 1).
    ///
    /// Results are in the order of `nodes`, `None` where nothing can light the receiver or, with
    /// [`DeadBranch::Stop`], where a dead branch was met.
    pub fn select(
        &mut self,
        tree: &LightTree,
        weights: NodeWeights,
        dead_branches: DeadBranch,
        receiver: &Receiver,
        nodes: impl Iterator<Item = NodeId>,
        mut u: impl FnMut() -> f64,
    ) -> &[Option<Selected>] {
        self.drawn.clear();
        self.active.clear();
        for (slot, node) in nodes.enumerate() {
            let u = u();
            match dead_branches {
                DeadBranch::Stop => {
                    self.drawn.push(None);
                    self.active.push(Descent {
                        node,
                        u,
                        pmf: 1.0,
                        slot,
                    });
                }
                DeadBranch::Retry => self
                    .drawn
                    .push(tree.select_retry(weights, receiver, node, u)),
            }
        }
        while !self.active.is_empty() {
            let mut kept = 0;
            for i in 0..self.active.len() {
                let mut descent = self.active[i];
                match tree.descend(weights, receiver, &mut descent) {
                    Step::Deeper => {
                        self.active[kept] = descent;
                        kept += 1;
                    }
                    Step::Leaf(light) => {
                        self.drawn[descent.slot] = Some(Selected {
                            light,
                            pmf: descent.pmf,
                        })
                    }
                    Step::Dead => {}
                }
            }
            self.active.truncate(kept);
        }
        &self.drawn
    }
}

enum Step {
    Deeper,
    Leaf(LightId),
    Dead,
}

impl LightTree {
    /// Asks for the memory that the next step below `id` reads: by the time its turn comes it has arrived.
    #[inline(always)]
    pub(crate) fn prefetch_children(&self, id: NodeId) {
        #[cfg(target_arch = "x86_64")]
        if let Some(first) = self.node(id).first_child() {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            let address: *const Pair = &raw const self.pairs[(first.0 >> 1) as usize];
            #[allow(unsafe_code, reason = "the only way to prefetch")]
            // SAFETY: a prefetch reads nothing the program can see and never faults.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>(address.cast::<i8>());
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = id;
    }

    #[inline]
    fn descend(&self, weights: NodeWeights, receiver: &Receiver, descent: &mut Descent) -> Step {
        let node = self.node(descent.node);
        let Some(first) = node.first_child() else {
            return node.light().map_or(Step::Dead, Step::Leaf);
        };
        let Some((child, p, u)) = choose(self.weigh(weights, receiver, first), descent.u) else {
            return Step::Dead;
        };
        descent.node = NodeId(first.0 + child);
        self.prefetch_children(descent.node);
        descent.pmf *= p;
        descent.u = u;
        // A product of hundreds of tiny probabilities could underflow: such a light cannot be told from none.
        if descent.pmf > 0.0 {
            Step::Deeper
        } else {
            Step::Dead
        }
    }

    /// Chooses between the children of `id` by `u` in [0, 1), as each step of [`select`](Self::select) does; `None` for
    /// a leaf, and where nothing below can light the receiver.
    pub fn choose_child(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        id: NodeId,
        u: f64,
    ) -> Option<Chosen> {
        let first = self.node(id).first_child()?;
        let (child, pmf, u) = choose(self.weigh(weights, receiver, first), u)?;
        Some(Chosen {
            child: NodeId(first.0 + child),
            pmf,
            u,
        })
    }

    /// Draws one light below `root` by `u` in [0, 1), as [`Selector::select`] with [`DeadBranch::Stop`] does for many
    /// clusters; `None` where a dead branch is met.
    pub fn select(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        root: NodeId,
        u: f64,
    ) -> Option<Selected> {
        let mut now = Descent {
            node: root,
            u,
            pmf: 1.0,
            slot: 0,
        };
        loop {
            match self.descend(weights, receiver, &mut now) {
                Step::Leaf(light) => {
                    return Some(Selected {
                        light,
                        pmf: now.pmf,
                    });
                }
                Step::Deeper => {}
                Step::Dead => return None,
            }
        }
    }

    /// Draws one light below `root` by Algorithm 1 as printed, dead branches retried.
    ///
    /// The reported probability ignores the redirected mass, so estimates are too bright: by 1 + D where a
    /// share D of the probability of a node's other child is dead.
    ///
    /// Source: Yuksel 2019, supplement, Algorithm 1.
    pub fn select_retry(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        root: NodeId,
        u: f64,
    ) -> Option<Selected> {
        let mut passed: Vec<Descent> = Vec::new();
        let mut now = Descent {
            node: root,
            u,
            pmf: 1.0,
            slot: 0,
        };
        loop {
            let before = now;
            match self.descend(weights, receiver, &mut now) {
                Step::Leaf(light) => {
                    return Some(Selected {
                        light,
                        pmf: now.pmf,
                    });
                }
                Step::Deeper => {
                    let sibling = NodeId(now.node.0 ^ 1);
                    passed.push(Descent {
                        node: sibling,
                        ..before
                    });
                }
                Step::Dead => now = passed.pop()?,
            }
        }
    }

    /// Probability of drawing each light below `root`, by enumeration, and the dead mass left over; for tests
    /// and analysis: costs a visit of every live node.
    pub fn pmf_below(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        root: NodeId,
    ) -> (Vec<(LightId, f64)>, f64) {
        let mut lights = Vec::new();
        let mut dead = 0.0;
        let mut stack = vec![(root, 1.0)];
        while let Some((id, pmf)) = stack.pop() {
            let node = self.node(id);
            match (node.light(), node.first_child()) {
                (Some(light), _) => lights.push((light, pmf)),
                (None, Some(first)) => {
                    let [w0, w1] = self.weigh(weights, receiver, first).map(f64::from);
                    let sum = w0 + w1;
                    if sum <= 0.0 {
                        dead += pmf;
                        continue;
                    }
                    for (k, w) in [w0, w1].into_iter().enumerate() {
                        if w > 0.0 {
                            stack.push((NodeId(first.0 + k as u32), pmf * w / sum));
                        }
                    }
                }
                (None, None) => dead += pmf,
            }
        }
        (lights, dead)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::build::TreeBuilder;
    use crate::lights::LightSet;
    use crate::test_lights::{
        BLACK, any_lights, any_receiver, contribution, lights_on_walls, receiver,
    };

    #[test]
    fn every_light_that_contributes_can_be_drawn_and_probabilities_sum_to_one() {
        arbtest::arbtest(|u| {
            let lights = any_lights(u)?;
            let at = any_receiver(u, &lights)?;
            let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
                return Ok(());
            };
            // A share of 10⁻²⁵ is beyond what f32 weights tell apart, and beyond any picture.
            let all: f64 = lights
                .ids()
                .map(|id| contribution(&lights, id, at.0, at.1))
                .sum();
            let black = BLACK.max(1e-25 * all);
            for weights in NodeWeights::ALL {
                let (pmfs, dead) = tree.pmf_below(weights, &receiver(at), tree.root());
                let sum: f64 = pmfs.iter().map(|p| p.1).sum::<f64>() + dead;
                assert!((sum - 1.0).abs() < 1e-9, "{weights:?}: sum {sum}");
                for id in lights.ids() {
                    let lit = contribution(&lights, id, at.0, at.1);
                    let pmf = pmfs.iter().find(|p| p.0 == id).map_or(0.0, |p| p.1);
                    assert!(
                        lit <= black || pmf > 0.0,
                        "{weights:?}: {id:?} brings {lit} to {at:?}, never drawn"
                    );
                }
            }
            Ok(())
        });
    }

    #[test]
    fn lights_are_drawn_as_often_as_reported() {
        let lights = lights_on_walls(200);
        let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
        for weights in NodeWeights::ALL {
            for at in [
                (Vec3::new(0.1, -0.9, 0.2), Vec3::Y),
                (Vec3::new(-1.0, 0.3, 0.3), Vec3::X),
            ] {
                let (pmfs, dead) = tree.pmf_below(weights, &receiver(at), tree.root());
                let mut expected = vec![0.0; lights.len() + 1];
                for (id, pmf) in pmfs {
                    expected[id.index()] = pmf;
                }
                expected[lights.len()] = dead;
                let mut observed = vec![0u64; lights.len() + 1];
                let mut rng = sampling::Rng::new(1, 0, 0, sampling::Purpose::Lights);
                let mut selector = Selector::default();
                for _ in 0..40_000 {
                    let node = std::iter::once(tree.root());
                    let drawn = selector.select(
                        &tree,
                        weights,
                        DeadBranch::Stop,
                        &receiver(at),
                        node,
                        || rng.f64(),
                    );
                    match drawn[0] {
                        Some(s) => {
                            let pmf = expected[s.light.index()];
                            assert!(
                                (s.pmf / pmf - 1.0).abs() < 1e-9,
                                "reported {} enumerated {pmf}",
                                s.pmf
                            );
                            observed[s.light.index()] += 1;
                        }
                        None => observed[lights.len()] += 1,
                    }
                }
                let test = verify::chi_square(&observed, &expected);
                // Four tests at 1e-4: false alarm 4e-4, and the seed is pinned.
                assert!(test.p_value > 1e-4, "{weights:?} at {at:?}: {test:?}");
            }
        }
    }

    /// A pair of lights below the receiver's horizon whose common box reaches above it, and one light above.
    fn dead_pair(scale: f32) -> (LightSet, Receiver) {
        let mut lights = LightSet::default();
        lights.push_point(Vec3::new(1.0, -1.5, 0.0), Vec3::splat(scale));
        lights.push_point(Vec3::new(-1.5, 1.0, 0.0), Vec3::splat(scale));
        lights.push_point(Vec3::new(9.0, 9.0, 0.0), Vec3::ONE);
        (
            lights,
            Receiver::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0).normalize()),
        )
    }

    #[test]
    fn retry_brightens_by_the_dead_mass_and_stop_does_not() {
        for scale in [0.1, 1.0, 10.0] {
            let (lights, x) = dead_pair(scale);
            let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
            let weights = NodeWeights::Yuksel2019;
            let (_, dead) = tree.pmf_below(weights, &x, tree.root());
            assert!(dead > 0.05, "the case has a dead branch: {dead}");
            let mean = |dead_branches| {
                let n = 100_000;
                let mut u = (0..n).map(|i| (f64::from(i) + 0.5) / f64::from(n));
                let mut selector = Selector::default();
                let mut sum = 0.0;
                for _ in 0..n {
                    let node = std::iter::once(tree.root());
                    let next = || u.next().expect("as many numbers as draws");
                    let drawn = selector.select(&tree, weights, dead_branches, &x, node, next);
                    sum += drawn[0].map_or(0.0, |s| {
                        if s.light == LightId(2) {
                            1.0 / s.pmf
                        } else {
                            0.0
                        }
                    });
                }
                sum / f64::from(n)
            };
            // The light above is worth 1: reached directly, and once more after each dead end.
            assert!(
                (mean(DeadBranch::Stop) - 1.0).abs() < 1e-3,
                "stop: {}",
                mean(DeadBranch::Stop)
            );
            let retry = mean(DeadBranch::Retry);
            assert!(
                (retry - (1.0 + dead)).abs() < 1e-3,
                "retry: {retry}, dead mass {dead}"
            );
        }
    }

    #[test]
    fn extreme_numbers_never_reach_a_child_of_weight_zero() {
        let tiny = f32::from_bits(1);
        for u in [0.0, 0.5, BELOW_ONE] {
            for (w, only) in [
                ([0.0, 1.0], Some(1)),
                ([1.0, 0.0], Some(0)),
                ([tiny, 0.0], Some(0)),
                ([0.0, tiny], Some(1)),
            ] {
                let (child, p, rescaled) = choose(w, u).expect("something has weight");
                assert_eq!(Some(child), only, "weights {w:?} u {u}");
                assert!(
                    p == 1.0 && (0.0..1.0).contains(&rescaled),
                    "p {p} u {rescaled}"
                );
            }
            let (_, p, rescaled) = choose([1.0, 1.0 - f32::EPSILON], u).expect("both have weight");
            assert!(
                p > 0.0 && (0.0..1.0).contains(&rescaled),
                "p {p} u {rescaled}"
            );
        }
        assert!(choose([0.0, 0.0], 0.5).is_none(), "dead");
    }

    #[test]
    fn a_random_number_lasts_down_a_deep_tree() {
        // Each level halves the probability: 40 levels use 40 bits. An f32 has 24.
        let mut lights = LightSet::default();
        for i in 0..41 {
            lights.push_point(
                Vec3::new(1.5f32.powi(i), 1.0, 0.0),
                Vec3::splat(2.0f32.powi(-i)),
            );
        }
        let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
        let x = Receiver::new(Vec3::ZERO, Vec3::Y);
        let (pmfs, dead) = tree.pmf_below(NodeWeights::Yuksel2019, &x, tree.root());
        assert_eq!(dead, 0.0, "all lights are above");
        // Walk each light's interval of u: its middle must lead to it.
        let mut found = 0;
        for (id, pmf) in &pmfs {
            let reached = (0..4000).any(|k| {
                let u = f64::from(k) / 4000.0;
                tree.select_retry(NodeWeights::Yuksel2019, &x, tree.root(), u)
                    .is_some_and(|s| s.light == *id)
            });
            found += u32::from(reached || *pmf < 1e-3);
        }
        assert_eq!(
            found as usize,
            lights.len(),
            "every likely light is found by some number"
        );
    }
}
