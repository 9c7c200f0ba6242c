//! Which nodes of a binary tree share a block of eight: so that there are as few blocks as can be.
//!
//! A node that takes several places of a block rather than one spares blocks below: its own, and those of descendants that take
//! places as well. How many it spares by how many places follows from the same numbers of its two children.

use crate::block::WIDTH;
use crate::build::filled;
use crate::light::LightId;
use crate::lights::LightSet;
use crate::tree::{LightTree, Node, NodeId};

/// Up to so many lights are put into as few blocks as can be.
const FEW: u32 = 64;

/// Blocks spared by 1 to 8 places rather than one, four bits each, the lowest first. A place more spares at most one, and none
/// fewer.
#[derive(Debug, Clone, Copy, Default)]
struct Spared(u32);

/// 1 for each number of places; they are reckoned with all at once.
const ONES: u32 = 0x1111_1111;

impl Spared {
    fn by(self, places: usize) -> u32 {
        self.0 >> (4 * (places - 1)) & 15
    }

    /// What two children spare together by each number of places ≥ 2, divided as is best.
    fn both(a: Self, b: Self) -> Self {
        let mut most = 0;
        for first in 1..WIDTH {
            let more_places = u32::MAX << (4 * first);
            let sums = (b.0 << (4 * first)) + ((a.by(first) * ONES) & more_places);
            most += above(sums, most);
        }
        Self(most)
    }

    /// Of a node with these children: all that they spare, and the node's own block, less what they spare in that.
    fn of(a: Self, b: Self) -> Self {
        let both = Self::both(a, b);
        let several = !15;
        Self(above(both.0 + ONES, both.by(WIDTH) * ONES) & several)
    }
}

/// What each of eight numbers below 8 is above another, or 0.
fn above(a: u32, b: u32) -> u32 {
    // The highest bit of each is lent, and left where it was not needed.
    let rest = (a | (8 * ONES)) - b;
    let is_left = rest >> 3 & ONES;
    rest & (is_left * 7)
}

/// What the tree does not say about the lights below one of its nodes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Beneath {
    spared: Spared,
    pub(crate) count: u32,
    /// Least and greatest radius of their spheres.
    pub(crate) radii: [f32; 2],
}

impl Beneath {
    fn light(lights: &LightSet, light: LightId) -> Self {
        let radius = match lights.is_source(light) {
            true => 0.0,
            false => lights.radius(light),
        };
        Self {
            spared: Spared::default(),
            count: 1,
            radii: [radius; 2],
        }
    }

    fn of([a, b]: [Self; 2]) -> Self {
        Self {
            spared: Spared::of(a.spared, b.spared),
            count: a.count + b.count,
            radii: [a.radii[0].min(b.radii[0]), a.radii[1].max(b.radii[1])],
        }
    }
}

/// Of more pairs the ends are worked on side by side.
const SHARE: usize = 4096;

/// What lies beneath each node of a tree.
pub(crate) struct Fill<'a> {
    tree: &'a LightTree,
    /// What parallel light counts for beside intensities, in the tree's unit of length.
    parallel: f32,
    pairs: Vec<[Beneath; 2]>,
}

impl<'a> Fill<'a> {
    pub(crate) fn of(tree: &'a LightTree, lights: &LightSet, parallel: f32) -> Self {
        let mut pairs = filled([Beneath::default(); 2], tree.pairs.len());
        beneath(tree, lights, 0, &mut pairs);
        Self {
            tree,
            parallel,
            pairs,
        }
    }

    pub(crate) fn node(&self, id: NodeId) -> Beneath {
        self.pairs[(id.0 >> 1) as usize][(id.0 & 1) as usize]
    }

    /// Up to eight descendants that together are `node`, in the tree's order; the node itself when it is a light.
    ///
    /// Few blocks make long ways down. So where there are many lights the brightest node is opened first, and where there are few,
    /// which is where most blocks are, as few as can be are made.
    pub(crate) fn members(&self, node: NodeId) -> Vec<NodeId> {
        match self.node(node).count > FEW {
            true => self.brightest_first(node),
            false => self.sparing(node),
        }
    }

    fn size(&self, id: NodeId) -> f32 {
        self.tree.node(id).intensity + self.tree.directional_intensity(id) * self.parallel
    }

    fn brightest_first(&self, node: NodeId) -> Vec<NodeId> {
        let mut members = vec![node];
        while members.len() < WIDTH {
            let large = members.iter().enumerate().filter_map(|(place, &id)| {
                let first = self.tree.node(id).first_child()?;
                (self.node(id).count > WIDTH as u32).then_some((self.size(id), place, first))
            });
            let Some((_, place, first)) = large.max_by(|a, b| a.0.total_cmp(&b.0)) else {
                break;
            };
            members[place] = first;
            members.insert(place + 1, NodeId(first.0 + 1));
        }
        members
    }

    /// Where places can be divided in several ways, the brighter child gets more.
    fn sparing(&self, node: NodeId) -> Vec<NodeId> {
        let mut members = Vec::with_capacity(WIDTH);
        let mut work = vec![(node, WIDTH)];
        while let Some((id, places)) = work.pop() {
            let Some(first) = self.tree.node(id).first_child().filter(|_| places > 1) else {
                members.push(id);
                continue;
            };
            let second = NodeId(first.0 + 1);
            let (a, b) = (self.node(first), self.node(second));
            let (lights_a, lights_b) = (a.count as usize, b.count as usize);
            let (a, b) = (a.spared, b.spared);
            let places = places.min(lights_a + lights_b);
            let spares = Spared::both(a, b);
            // One place is better where more would cost a block.
            if id != node && spares.by(places) + 1 < spares.by(WIDTH) {
                members.push(id);
                continue;
            }
            let range = places.saturating_sub(lights_b).max(1)..=lights_a.min(places - 1);
            let (bright_a, bright_b) = (self.size(first), self.size(second));
            let wanted = places as f32 * bright_a / (bright_a + bright_b);
            let off = |n: usize| (n as f32 - wanted).abs();
            let best = range.max_by(|&m, &n| {
                let spared = |n: usize| a.by(n) + b.by(places - n);
                spared(m).cmp(&spared(n)).then(off(n).total_cmp(&off(m)))
            });
            let n = best.unwrap_or(1);
            work.extend([(second, places - n), (first, n)]);
        }
        members
    }
}

/// Fills in `pairs`, which are those of one subtree from its root's children on; the first has number `first` in the tree.
fn beneath(tree: &LightTree, lights: &LightSet, first: usize, pairs: &mut [[Beneath; 2]]) {
    if pairs.len() <= SHARE {
        // Children lie behind their parents.
        for at in (0..pairs.len()).rev() {
            let children = |child: usize| pairs[child - first];
            pairs[at] = pair(tree, lights, first + at, children);
        }
        return;
    }
    // Depth first: all of the first child's pairs lie before those of the second.
    let (own, below) = pairs.split_at_mut(1);
    let second = tree.pairs[first].0[1]
        .first_child()
        .filter(|child| child.0 > 0);
    let start = second.map_or(first + 1 + below.len(), |child| (child.0 >> 1) as usize);
    let (left, right) = below.split_at_mut(start - first - 1);
    rayon::join(
        || beneath(tree, lights, first + 1, left),
        || beneath(tree, lights, start, right),
    );
    let children = |child: usize| match child < start {
        true => left[child - first - 1],
        false => right[child - start],
    };
    own[0] = pair(tree, lights, first, children);
}

/// What lies beneath the nodes of pair `number`.
fn pair(
    tree: &LightTree,
    lights: &LightSet,
    number: usize,
    children: impl Fn(usize) -> [Beneath; 2],
) -> [Beneath; 2] {
    let of = |node: &Node| match (node.light(), node.first_child()) {
        (Some(light), _) => Beneath::light(lights, light),
        (None, Some(first)) if first.0 > 0 => Beneath::of(children((first.0 >> 1) as usize)),
        _ => Beneath::default(), // unused, beside the root
    };
    let [a, b] = &tree.pairs[number].0;
    [of(a), of(b)]
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::build::TreeBuilder;
    use crate::test_lights::any_lights;
    use crate::wide::WideTree;

    type Known = HashMap<(u32, usize), usize>;

    /// Fewest blocks below `node` when it takes up to so many places of its parent's, found by trying every division.
    fn fewest(tree: &LightTree, node: NodeId, places: usize, known: &mut Known) -> usize {
        let Some(first) = tree.node(node).first_child() else {
            return 0;
        };
        if let Some(&blocks) = known.get(&(node.0, places)) {
            return blocks;
        }
        let mut divided = |places: usize| {
            let of = |known: &mut Known, n: usize| {
                fewest(tree, first, n, known) + fewest(tree, NodeId(first.0 + 1), places - n, known)
            };
            (1..places).map(|n| of(known, n)).min()
        };
        let own = 1 + divided(WIDTH).unwrap_or(0);
        let blocks = divided(places).map_or(own, |blocks| blocks.min(own));
        known.insert((node.0, places), blocks);
        blocks
    }

    #[test]
    fn there_are_as_few_blocks_as_can_be() {
        let mut most = 0;
        verify::property(200, |u| {
            let lights = any_lights(u)?;
            let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
                return Ok(());
            };
            if lights.len() > FEW as usize {
                return Ok(());
            }
            let blocks = WideTree::collapse(&tree, &lights).blocks.len();
            let expected = fewest(&tree, tree.root(), 1, &mut Known::new()).max(1);
            assert_eq!(blocks, expected, "of {} lights", lights.len());
            most = most.max(blocks);
            Ok(())
        });
        assert!(most > 1, "{most} blocks");
    }
}
