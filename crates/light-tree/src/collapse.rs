//! Collapsing a binary tree to eight children a node.

use rayon::prelude::*;

use crate::block::{Block, Cluster, LEAST_DIST2, Lanes, WIDTH};
use crate::fill::{Beneath, Fill};
use crate::lights::LightSet;
use crate::packed::PackedBlock;
use crate::tree::{LightTree, NodeId};
use crate::wide::WideTree;

/// Nodes with up to so many lights are collapsed by one thread each.
const SHARE: u32 = 4096;

/// What does not change.
struct Collapse<'a> {
    tree: &'a LightTree,
    fill: Fill<'a>,
    scale: f32,
    /// Of an intensity, in the whole.
    share: f32,
}

/// The blocks of a node and of those below it, depth first, so that neighbours in space are neighbours in memory.
#[derive(Default)]
struct Part {
    /// Their children are counted from the first.
    blocks: Vec<PackedBlock>,
    parallel: Vec<Lanes>,
    depth: u32,
    left: Vec<Left>,
}

/// A node whose blocks are left to another part.
struct Left {
    node: NodeId,
    /// Its first block is this lane's of this block.
    parent: (usize, usize),
    /// Blocks of this part that come before its own.
    before: usize,
    depth: u32,
}

impl WideTree {
    /// Collapses the binary `tree`: each node takes up to eight descendants of one of its nodes as children. The same for any
    /// number of threads.
    pub fn collapse(tree: &LightTree, lights: &LightSet) -> Self {
        let collapse = Collapse::of(tree, lights);
        let whole = collapse.whole();
        Self {
            blocks: whole.blocks,
            parallel: whole.parallel,
            oriented: !tree.cones.is_empty(),
            scale: collapse.scale,
            depth: whole.depth,
        }
    }
}

impl<'a> Collapse<'a> {
    fn of(tree: &'a LightTree, lights: &LightSet) -> Self {
        let diagonal = tree.diagonal2.sqrt();
        let scale = if diagonal > 0.0 {
            2.0f32.powi(-(diagonal.log2().round() as i32).clamp(-60, 60))
        } else {
            1.0
        };
        let root = tree.node(tree.root());
        let total = root.intensity + tree.directional_intensity(tree.root()) / (scale * scale);
        let share = if total > 0.0 && total.is_finite() {
            1.0 / total
        } else {
            1.0
        };
        Self {
            tree,
            fill: Fill::of(tree, lights, 1.0 / (scale * scale)),
            scale,
            share,
        }
    }

    /// The blocks of all the tree. Those of nodes with few lights are made side by side, and put among those above them.
    fn whole(&self) -> Part {
        let root = self.tree.root();
        let mut top = self.part(root, 1, SHARE);
        let parts: Vec<Part> = top
            .left
            .par_iter()
            .map(|left| self.part(left.node, left.depth, 0))
            .collect();
        if parts.is_empty() {
            return top;
        }
        // Blocks of parts up to each, and where it begins.
        let mut sums = vec![0];
        let mut starts = Vec::with_capacity(parts.len());
        for (left, part) in top.left.iter().zip(&parts) {
            let sum = sums[starts.len()];
            starts.push(left.before + sum);
            sums.push(sum + part.blocks.len());
        }
        for block in &mut top.blocks {
            block.move_children(|child| {
                let passed = top.left.partition_point(|left| left.before <= child);
                child + sums[passed]
            });
        }
        for (left, &start) in top.left.iter().zip(&starts) {
            let (block, lane) = left.parent;
            top.blocks[block].clusters[lane] = Cluster(start as u32);
        }
        // Of which part the block in a place is, and which of it.
        let origin = |place: usize| {
            let begun = starts.partition_point(|&start| start <= place);
            match begun.checked_sub(1) {
                Some(last) if place - starts[last] < parts[last].blocks.len() => {
                    (Some(last), place - starts[last])
                }
                _ => (None, place - sums[begun]),
            }
        };
        let count = top.blocks.len() + sums[parts.len()];
        let block = |place: usize| match origin(place) {
            (Some(part), at) => {
                let mut block = parts[part].blocks[at].clone();
                block.move_children(|child| child + starts[part]);
                block
            }
            (None, at) => top.blocks[at].clone(),
        };
        let parallel = |place: usize| match origin(place) {
            (Some(part), at) => parts[part].parallel[at],
            (None, at) => top.parallel[at],
        };
        let parallel_count = if top.parallel.is_empty() { 0 } else { count };
        Part {
            blocks: (0..count).into_par_iter().map(block).collect(),
            parallel: (0..parallel_count).into_par_iter().map(parallel).collect(),
            depth: parts
                .iter()
                .fold(top.depth, |most, part| most.max(part.depth)),
            left: Vec::new(),
        }
    }

    /// The blocks of `root`, which is `depth` edges above lights of its own, and of all below it that have more than `most` lights.
    fn part(&self, root: NodeId, depth: u32, most: u32) -> Part {
        let count = self.fill.node(root).count.min(SHARE) as usize;
        let mut part = Part {
            blocks: Vec::with_capacity(count / 5 + 1),
            ..Part::default()
        };
        let mut work = vec![(root, None::<(usize, usize)>, depth)];
        while let Some((node, parent, depth)) = work.pop() {
            let index = part.blocks.len();
            if let Some(parent) = parent {
                if self.fill.node(node).count <= most {
                    part.left.push(Left {
                        node,
                        parent,
                        before: index,
                        depth,
                    });
                    continue;
                }
                let (block, lane) = parent;
                part.blocks[block].clusters[lane] = Cluster(index as u32);
            }
            part.depth = part.depth.max(depth);
            let members = self.fill.members(node);
            for (lane, &member) in members.iter().enumerate().rev() {
                if self.tree.node(member).light().is_none() {
                    work.push((member, Some((index, lane)), depth + 1));
                }
            }
            let (block, parallel) = self.block(&members);
            part.blocks.push(PackedBlock::of(&block));
            if !self.tree.directional.is_empty() {
                part.parallel.push(parallel);
            }
        }
        part
    }

    /// The block of these nodes, and their parallel light.
    fn block(&self, members: &[NodeId]) -> (Block, Lanes) {
        let (tree, scale, share) = (self.tree, self.scale, self.share);
        let mut block = Block::EMPTY;
        let mut parallel = [0.0; WIDTH];
        for (lane, &member) in members.iter().enumerate() {
            let node = tree.node(member);
            let cone = tree.emission(member).as_cosine();
            for axis in 0..3 {
                if node.has_positions() {
                    block.lo[axis][lane] = node.lo[axis] * scale;
                    block.hi[axis][lane] = node.hi[axis] * scale;
                }
                block.axis[axis][lane] = cone.axis[axis];
            }
            block.cos[lane] = cone.cos;
            block.intensity[lane] = node.intensity * share;
            let Beneath { count, radii, .. } = self.fill.node(member);
            let [least, greatest] = radii.map(|radius| radius * scale);
            let diagonal = (node.hi - node.lo) * scale;
            block.radius[lane] = greatest;
            block.near2[lane] = (diagonal.length_squared() / (4.0 * count as f32))
                .max(1.5 * least * least)
                .max(LEAST_DIST2);
            if !node.has_positions() {
                block.near2[lane] = LEAST_DIST2;
            }
            parallel[lane] = tree.directional_intensity(member) * share / (scale * scale);
            // Which block holds an inner node's children is known when that is added.
            block.clusters[lane] = node.light().map_or(Cluster(0), Cluster::of_light);
        }
        (block, parallel)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sampling::{Purpose, Rng, uniform_sphere};

    use super::*;
    use crate::build::TreeBuilder;

    #[test]
    fn parts_together_are_what_one_part_would_be() {
        let mut rng = Rng::new(4, 0, 0, Purpose::Build);
        let mut lights = LightSet::default();
        for i in 0..40_000 {
            let colour = Vec3::splat(0.1 + rng.f32());
            let direction = uniform_sphere([rng.f32(), rng.f32()]).normalize();
            match i {
                0..3 => lights.push_directional(direction, colour),
                _ => lights.push_point(direction * rng.f32(), colour),
            };
        }
        let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
        let collapse = Collapse::of(&tree, &lights);
        let (whole, one) = (collapse.whole(), collapse.part(tree.root(), 1, 0));
        let top = collapse.part(tree.root(), 1, SHARE);
        assert!(top.left.len() > 8, "{} parts", top.left.len());
        assert_eq!(whole.depth, one.depth, "depth");
        assert!(whole.parallel == one.parallel, "parallel light");
        assert!(!whole.parallel.is_empty(), "has parallel light");
        let text = |part: &Part| format!("{:?}", part.blocks);
        assert!(text(&whole) == text(&one), "blocks");
    }
}
