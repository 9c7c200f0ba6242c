//! The tree itself: pairs of siblings in one array.

use glam::Vec3;

use crate::build::{self, TreeBuilder};
use crate::cone::Cone;
use crate::emission::{Emission, Profile};
use crate::light::{LightId, luminance};
use crate::lights::LightSet;

/// Index of a node in a [`LightTree`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub u32);

/// A cluster of lights: the box around them and their total intensity.
///
/// 32 bytes; siblings lie side by side, so one cache line holds all that choosing between them reads.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub struct Node {
    /// Least corner of the tightest box around the positional lights; +∞ when there are none.
    pub lo: Vec3,
    /// ‖I‖: sum of the scalar intensities of the lights with inverse-square falloff.
    pub intensity: f32,
    /// Greatest corner; −∞ when there are no positional lights.
    pub hi: Vec3,
    link: u32,
}

/// Set in `Node::link` of a leaf, whose other bits are the light's id.
pub(crate) const LEAF: u32 = 1 << 31;

/// The light of a leaf, by its [`link`](Node::link).
#[inline(always)]
pub(crate) fn light_of(link: u32) -> Option<LightId> {
    (link & LEAF != 0).then_some(LightId(link & !LEAF))
}

/// More lights than this do not fit the links.
pub(crate) const MAX_LIGHTS: usize = (LEAF as usize) / 2 - 1;

impl Node {
    pub(crate) const UNUSED: Self = Self {
        lo: Vec3::INFINITY,
        intensity: 0.0,
        hi: Vec3::NEG_INFINITY,
        link: 0,
    };

    pub(crate) fn leaf(lo: Vec3, hi: Vec3, intensity: f32, light: LightId) -> Self {
        Self {
            lo,
            intensity,
            hi,
            link: LEAF | light.0,
        }
    }

    pub(crate) fn inner(lo: Vec3, hi: Vec3, intensity: f32, first_child: u32) -> Self {
        Self {
            lo,
            intensity,
            hi,
            link: first_child,
        }
    }

    /// The first of the two children, or a light: see [`light_of`].
    #[inline]
    pub(crate) fn link(&self) -> u32 {
        self.link
    }

    /// The light of a leaf; `None` for an inner node.
    #[inline]
    pub fn light(&self) -> Option<LightId> {
        light_of(self.link)
    }

    /// The first of the two children, which are neighbours; `None` for a leaf.
    #[inline]
    pub fn first_child(&self) -> Option<NodeId> {
        (self.link & LEAF == 0).then_some(NodeId(self.link))
    }

    /// Whether any light below has a position.
    #[inline]
    pub(crate) fn has_positions(&self) -> bool {
        self.lo.x <= self.hi.x
    }
}

/// Siblings share a cache line.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Pair(pub(crate) [Node; 2]);

/// A squared distance that those of several pairs are no less than, in half the memory: the upper half of a floating-point number
/// ≥ 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Floor(u16);

impl Floor {
    /// None at all.
    pub(crate) const ZERO: Self = Self(0);

    /// So many pairs have one: neighbours, most of them of one small cluster.
    pub(crate) const PAIRS: usize = 4;

    /// Of a number ≥ 0, rounded down, by less than a part in 128: the least of several is that of the least.
    #[inline]
    pub(crate) fn of(dist2: f32) -> Self {
        Self((dist2.to_bits() >> 16) as u16)
    }

    #[inline(always)]
    pub(crate) fn get(self) -> f32 {
        f32::from_bits(u32::from(self.0) << 16)
    }
}

/// Whether a tree keeps where its lights point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Directions {
    /// It does, for weights and bounds that look at it.
    #[default]
    Kept,
    /// Only where there are lights without falloff, which cannot do without: for [`NodeWeights`](crate::NodeWeights) that do not
    /// [look at it](crate::NodeWeights::directions). A light takes a third less memory. Other weights and bounds hold as
    /// well, as of lights that may point anywhere.
    Dropped,
}

/// A binary hierarchy with one light a leaf, over all lights of a [`LightSet`].
#[derive(Debug, Clone)]
pub struct LightTree {
    /// `pairs[0]` holds the root and an unused slot; children of one parent form one pair.
    pub(crate) pairs: Vec<Pair>,
    /// One per node: emission axes, or travel directions, of the lights below. Empty when all lights are omni, or nobody asks.
    pub(crate) cones: Vec<Cone>,
    /// One per node: what the cones say. Empty when it is the same for all, [`Profile::Cosine`].
    pub(crate) profiles: Vec<Profile>,
    /// ‖Iᴰ‖ per node: sum over the lights without falloff. Empty when there is none.
    pub(crate) directional: Vec<f32>,
    pub(crate) lights: usize,
    pub(crate) depth: u32,
    /// Squared diagonal of the box around all positional lights.
    pub(crate) diagonal2: f32,
    /// 1.5 r² for the least radius r of the virtual lights of the whole tree.
    pub(crate) least_dist2: f32,
    /// The same per [`Floor::PAIRS`] pairs, for virtual lights that differ in radius; otherwise empty.
    pub(crate) least_dist2_below: Vec<Floor>,
    /// None of these is greater.
    pub(crate) greatest_dist2: f32,
}

impl LightTree {
    /// Builds the tree; the same for any number of threads. `None` when there is no light.
    ///
    /// # Panics
    /// When there are more than about a billion lights.
    pub fn build(lights: &LightSet, builder: TreeBuilder) -> Option<Self> {
        Self::build_with(lights, builder, Directions::Kept)
    }

    /// As [`build`](Self::build): the same nodes, with or without what lies beside them.
    pub fn build_with(
        lights: &LightSet,
        builder: TreeBuilder,
        directions: Directions,
    ) -> Option<Self> {
        build::build(lights, builder, build::Apart::Distant, directions)
    }

    /// As [`build`](Self::build), with lights of each kind in a subtree of their own: for methods where one light
    /// stands for a cluster. Methods that draw one light of a cluster do better with lights together that are
    /// near each other: a third less variance under 120 lamps and 2000 virtual lights.
    pub fn build_by_kind(lights: &LightSet, builder: TreeBuilder) -> Option<Self> {
        build::build(lights, builder, build::Apart::Kinds, Directions::Kept)
    }

    /// The root.
    pub fn root(&self) -> NodeId {
        NodeId(0)
    }

    /// The node at `id`.
    #[inline]
    pub fn node(&self, id: NodeId) -> &Node {
        &self.pairs[(id.0 >> 1) as usize].0[(id.0 & 1) as usize]
    }

    /// Node `root` and all below it, depth first, parents before their children: one visit of each.
    pub fn nodes_below(&self, root: NodeId) -> impl Iterator<Item = NodeId> + '_ {
        // An explicit stack: a tree may be deeper than the thread's.
        let mut stack = vec![root];
        std::iter::from_fn(move || {
            let id = stack.pop()?;
            if let Some(first) = self.node(id).first_child() {
                stack.extend([NodeId(first.0 + 1), first]);
            }
            Some(id)
        })
    }

    /// The lights of the leaves below `root`, or its own, in the tree's order.
    pub fn lights_below(&self, root: NodeId) -> impl Iterator<Item = LightId> + '_ {
        self.nodes_below(root)
            .filter_map(|id| self.node(id).light())
    }

    /// Both children of a node whose first child is `first`.
    #[inline]
    pub(crate) fn pair(&self, first: NodeId) -> &[Node; 2] {
        &self.pairs[(first.0 >> 1) as usize].0
    }

    /// Emission axes (or travel directions) of the lights below; every direction for omni lights, and where they were
    /// [dropped](Directions::Dropped).
    #[inline]
    pub fn cone(&self, id: NodeId) -> Cone {
        self.cones
            .get(id.0 as usize)
            .copied()
            .unwrap_or(Cone::SPHERE)
    }

    /// Where the lights below shine, or travel.
    #[inline]
    pub fn emission(&self, id: NodeId) -> Emission {
        Emission {
            cone: self.cone(id),
            profile: self
                .profiles
                .get(id.0 as usize)
                .copied()
                .unwrap_or_default(),
        }
    }

    /// ‖Iᴰ‖: sum of the scalar irradiances of the lights below that do not fall off.
    #[inline]
    pub fn directional_intensity(&self, id: NodeId) -> f32 {
        self.directional.get(id.0 as usize).copied().unwrap_or(0.0)
    }

    /// No squared distance below this tells the lights below apart: 1.5 r², where all are virtual and of a radius of at
    /// least r. Where radii differ it may be less than that.
    #[inline]
    pub(crate) fn least_dist2(&self, id: NodeId) -> f32 {
        let pair = (id.0 >> 1) as usize;
        let below = self.least_dist2_below.get(pair / Floor::PAIRS);
        below.map_or(self.least_dist2, |floor| floor.get())
    }

    /// Number of nodes, leaves included: 2 n − 1.
    pub fn node_count(&self) -> usize {
        2 * self.lights - 1
    }

    /// Number of lights.
    pub fn light_count(&self) -> usize {
        self.lights
    }

    /// Edges from the root to the deepest leaf.
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        self.pairs.len() * size_of::<Pair>()
            + self.cones.len() * size_of::<Cone>()
            + self.profiles.len() * size_of::<Profile>()
            + self.directional.len() * size_of::<f32>()
            + self.least_dist2_below.len() * size_of::<Floor>()
    }

    /// Checks every invariant against the lights the tree was built over; for tests and `check`.
    ///
    /// Each light is in exactly one leaf, boxes and cones hold what is below them, boxes are tight,
    /// intensities are the sums of their children's within rounding.
    pub fn validate(&self, lights: &LightSet) -> Result<(), String> {
        let mut seen = vec![false; lights.len()];
        for id in self.nodes_below(self.root()) {
            match self.node(id).light() {
                Some(light) => {
                    let i = light.index();
                    if i >= seen.len() || std::mem::replace(&mut seen[i], true) {
                        return Err(format!(
                            "leaf {} holds light {i} out of range or for the second time",
                            id.0
                        ));
                    }
                    self.validate_leaf(id, light, lights)?;
                }
                None => self.validate_inner(id)?,
            }
        }
        match seen.iter().position(|s| !s) {
            Some(i) => Err(format!("light {i} is in no leaf")),
            None => Ok(()),
        }
    }

    fn validate_inner(&self, id: NodeId) -> Result<(), String> {
        let node = self.node(id);
        let Some(first) = node.first_child() else {
            return Ok(());
        };
        let children = self.pair(first);
        let (lo, hi) = (
            children[0].lo.min(children[1].lo),
            children[0].hi.max(children[1].hi),
        );
        if (lo, hi) != (node.lo, node.hi) {
            return Err(format!(
                "box of node {} is not the union of its children's",
                id.0
            ));
        }
        let sum = f64::from(children[0].intensity) + f64::from(children[1].intensity);
        if (f64::from(node.intensity) - sum).abs() > 1e-6 * sum {
            return Err(format!(
                "node {} has intensity {} but its children {sum}",
                id.0, node.intensity
            ));
        }
        for child in [first, NodeId(first.0 + 1)] {
            if !self.emission(id).holds(&self.emission(child)) {
                return Err(format!(
                    "cone of node {} does not hold that of child {}",
                    id.0, child.0
                ));
            }
        }
        Ok(())
    }

    fn validate_leaf(&self, id: NodeId, light: LightId, lights: &LightSet) -> Result<(), String> {
        let node = self.node(id);
        let scalar = luminance(lights.intensity(light));
        let distant = lights.kind(light).is_distant();
        let (positional, directional) = if distant {
            (0.0, scalar)
        } else {
            (scalar, 0.0)
        };
        let at_light = match lights.bounds(light) {
            Some(bounds) => (node.lo, node.hi) == bounds,
            None => !node.has_positions(),
        };
        if at_light
            && node.intensity == positional
            && self.directional_intensity(id) == directional
            && (self.cones.is_empty() || self.emission(id) == lights.emission(light))
        {
            Ok(())
        } else {
            Err(format!(
                "leaf {} does not describe its light {}",
                id.0, light.0
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_floor_is_a_little_less_in_the_same_order() {
        let mut last = Floor::ZERO;
        let mut dist2 = f32::MIN_POSITIVE;
        while dist2 < f32::MAX {
            let floor = Floor::of(dist2);
            let is_close = floor.get() <= dist2 && floor.get() > dist2 * (127.0 / 128.0);
            assert!(is_close && floor >= last, "{dist2} became {}", floor.get());
            (last, dist2) = (floor, dist2 * 1.37);
        }
        assert_eq!(Floor::of(0.0).get(), 0.0, "none stays none");
    }
}
