//! Hierarchical importance sampling: one light from a cluster.

use crate::bounds::Receiver;
use crate::light::LightId;
use crate::prefetch::prefetch;
use crate::tree::{LightTree, NodeId};
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
pub(crate) const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

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
        let children = self.node(id).first_child();
        prefetch(children.map(|first| &self.pairs[(first.0 >> 1) as usize]));
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
mod tests;
