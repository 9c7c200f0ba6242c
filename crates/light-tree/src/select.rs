//! Hierarchical importance sampling: one light from a cluster.

use crate::bounds::Receiver;
use crate::light::LightId;
use crate::prefetch::prefetch;
use crate::tree::{LightTree, NodeId};
use crate::weight::NodeWeights;
use crate::wide::by_width;

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
}

/// One of many descents, at an inner node.
#[derive(Debug, Clone, Copy)]
struct Active {
    /// The first of the node's children.
    first: NodeId,
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
    let (right, pmf, rest) = choose_live(weights, u);
    (pmf > 0.0).then_some((right as u32, pmf, rest))
}

/// As [`choose`]; where both weights are 0, the probability is no number, or 0.
#[inline(always)]
fn choose_live(weights: [f32; 2], u: f64) -> (u64, f64, f64) {
    let (w0, w1) = (f64::from(weights[0]), f64::from(weights[1]));
    let sum = w0 + w1;
    debug_assert!(sum.is_finite(), "weights {weights:?}");
    // Selected, not branched on: the outcome is random, and a wrong guess costs more than the sums.
    // A child of weight 0 is never taken: scaled < w0 fails for w0 = 0 and holds for w0 = sum.
    let scaled = u * sum;
    let right = (scaled >= w0) & (w1 > 0.0);
    let (w, passed) = if right { (w1, w0) } else { (w0, 0.0) };
    let rest = ((scaled - passed) / w).clamp(0.0, BELOW_ONE);
    (u64::from(right), w / sum, rest)
}

/// Draws one light from each of many clusters, all descending side by side so that the memory latencies of
/// one hide behind the others'. Memory is kept between receivers.
#[derive(Debug, Clone, Default)]
pub struct Selector {
    active: Vec<Active>,
    drawn: Vec<Option<Selected>>,
    steps: Vec<FourSteps>,
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
            self.drawn.push(None);
            match dead_branches {
                DeadBranch::Stop => self.begin(tree, node, u, slot),
                DeadBranch::Retry => {
                    self.drawn[slot] = tree.select_retry(weights, receiver, node, u);
                }
            }
        }
        self.descend_all(tree, weights, receiver);
        &self.drawn
    }

    /// Begins a descent below `node`, whose result is that of `slot`.
    fn begin(&mut self, tree: &LightTree, node: NodeId, u: f64, slot: usize) {
        let node = tree.node(node);
        match node.first_child() {
            Some(first) => self.active.push(Active {
                first,
                u,
                pmf: 1.0,
                slot,
            }),
            None => self.drawn[slot] = node.light().map(|light| Selected { light, pmf: 1.0 }),
        }
    }

    /// Goes on with all descents to their ends.
    fn descend_all(&mut self, tree: &LightTree, weights: NodeWeights, receiver: &Receiver) {
        by_width!(
            self.descend_all_avx2(tree, weights, receiver),
            self.descend_all_with(tree, weights, receiver)
        )
    }

    /// The same code and the same bits, eight nodes to an instruction.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn descend_all_avx2(&mut self, tree: &LightTree, weights: NodeWeights, receiver: &Receiver) {
        self.descend_all_with(tree, weights, receiver);
    }

    #[inline(always)]
    fn descend_all_with(&mut self, tree: &LightTree, weights: NodeWeights, receiver: &Receiver) {
        let Self {
            active,
            drawn,
            steps,
        } = self;
        while !active.is_empty() {
            // First where all go, without a branch: the processor works on several steps at once.
            steps.clear();
            let mut from = 0;
            while from < active.len() {
                let count = (active.len() - from).min(FOUR);
                let mut firsts = [NodeId(0); FOUR];
                let mut u = [0.0f64; FOUR];
                for k in 0..FOUR {
                    // Where there are not so many the last is weighed again.
                    let descent = &active[from + k.min(count - 1)];
                    (firsts[k], u[k]) = (descent.first, descent.u);
                }
                let weighed = tree.weigh_four(weights, receiver, firsts);
                let mut step = FourSteps::NONE;
                for k in 0..FOUR {
                    let chosen = choose_live([weighed[0][k], weighed[1][k]], u[k]);
                    (step.right[k], step.pmf[k], step.u[k]) = chosen;
                }
                steps.push(step);
                from += count;
            }
            let mut kept = 0;
            for i in 0..active.len() {
                let (step, k) = (&steps[i / FOUR], i % FOUR);
                let mut descent = active[i];
                descent.pmf *= step.pmf[k];
                // Else both weights are 0, or a product of hundreds of tiny probabilities has underflowed: such a light
                // cannot be told from none.
                if descent.pmf > 0.0 {
                    descent.u = step.u[k];
                    let child = NodeId(descent.first.0 + step.right[k] as u32);
                    match tree.node(child).first_child() {
                        None => {
                            let light = tree.node(child).light();
                            drawn[descent.slot] = light.map(|light| Selected {
                                light,
                                pmf: descent.pmf,
                            });
                        }
                        Some(first) => {
                            tree.prefetch_children(child);
                            descent.first = first;
                            active[kept] = descent;
                            kept += 1;
                        }
                    }
                }
            }
            active.truncate(kept);
        }
    }
}

/// Descents that take a step together.
const FOUR: usize = 4;

/// Where four descents go: what [`choose_live`] says of each.
#[derive(Debug, Clone, Copy)]
struct FourSteps {
    right: [u64; FOUR],
    pmf: [f64; FOUR],
    u: [f64; FOUR],
}

impl FourSteps {
    const NONE: Self = Self {
        right: [0; FOUR],
        pmf: [0.0; FOUR],
        u: [0.0; FOUR],
    };
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

    /// [`weigh`](Self::weigh) of four nodes' children: of the first, and of the second.
    #[inline(always)]
    fn weigh_four(
        &self,
        weights: NodeWeights,
        receiver: &Receiver,
        firsts: [NodeId; FOUR],
    ) -> [[f32; FOUR]; 2] {
        if weights == NodeWeights::Yuksel2019 {
            return self.weigh_pairs::<FOUR, { 2 * FOUR }>(receiver, firsts);
        }
        let mut weighed = [[0.0; FOUR]; 2];
        for k in 0..FOUR {
            let [a, b] = self.weigh(weights, receiver, firsts[k]);
            (weighed[0][k], weighed[1][k]) = (a, b);
        }
        weighed
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
