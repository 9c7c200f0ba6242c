//! Building the hierarchy: obvhs' binary one, collapsed to eight boxes a node and four triangles a block.

use std::time::Duration;

use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::bvh2::node::Bvh2Node;
use rayon::prelude::*;

use super::bvh8::{Bvh8, WIDTH};
use super::cutout::Cutouts;
use super::forest::Forests;
use super::triangle::{BLOCK, block_of};
use crate::Mesh;
use crate::tagged::Tagged;

/// Levels that are taken from the binary tree.
const COLLAPSED_LEVELS: usize = 40;
/// Levels that an even division by eight needs at most.
const EVEN_LEVELS: usize = 11;
/// Nodes on the way to any block.
pub(super) const MAX_DEPTH: usize = COLLAPSED_LEVELS + EVEN_LEVELS;

/// Triangles lie upon one another when the middles of their boxes fall into the same of so many parts of the scene's extent.
const PARTS: f32 = 65_536.0;
/// More than so many upon one another are one primitive to the builder, whose time is quadratic in the size of a pile.
const PILE: usize = 64;

impl Bvh8 {
    /// The hierarchy of all triangles that rays can meet.
    pub(crate) fn build(mesh: &Mesh, cutouts: &Cutouts) -> Self {
        let triangles: Vec<u32> = (0..mesh.len() as u32)
            .filter(|&t| !cutouts.is_gone(t as usize))
            .collect();
        if triangles.is_empty() {
            return Self::default();
        }
        let mut build = Build {
            mesh,
            cutouts,
            primitives: Primitives::of(mesh, triangles),
            bvh: Self::default(),
        };
        let boxes = build.boxes();
        let params = BvhBuildParams {
            max_prims_per_leaf: BLOCK as u32,
            ..BvhBuildParams::medium_build()
        };
        let binary = on_a_deep_stack(|| build_bvh2(&boxes, params, &mut Duration::default()));
        if build.collapse(&binary).is_none() {
            // The tree of some input is a chain.
            build.bvh = Self::default();
            let triangles = build.primitives.all(&binary.primitive_indices);
            build.evenly(&triangles);
        }
        build.bvh.triangle_count = build.primitives.triangles.len();
        build.bvh
    }
}

/// The builder calls itself level by level, and a fan of slivers becomes a chain.
fn on_a_deep_stack<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    // Address space; memory is taken as deep as it is used.
    let thread = std::thread::Builder::new().stack_size(1 << 28);
    std::thread::scope(|scope| match thread.spawn_scoped(scope, work) {
        Ok(thread) => match thread.join() {
            Ok(done) => done,
            Err(panic) => std::panic::resume_unwind(panic),
        },
        Err(error) => panic!("no thread for the ray tracer's build: {error}"),
    })
}

fn bounds(mesh: &Mesh, triangle: u32) -> Aabb {
    let [a, b, c] = mesh.corners(triangle as usize).map(Vec3A::from);
    Aabb::new(a.min(b).min(c), a.max(b).max(c))
}

/// What the builder sees: triangles, and piles of them.
pub(super) struct Primitives {
    triangles: Vec<u32>,
    /// Where each primitive's triangles begin, and where the last one's end.
    starts: Vec<u32>,
}

impl Primitives {
    pub(super) fn of(mesh: &Mesh, triangles: Vec<u32>) -> Self {
        let centres: Vec<Vec3A> = triangles
            .par_iter()
            .map(|&t| bounds(mesh, t).center())
            .collect();
        let nothing = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let (lo, hi) = centres
            .iter()
            .fold(nothing, |(lo, hi), &c| (lo.min(c), hi.max(c)));
        let scale = PARTS / (hi - lo).max(Vec3A::splat(f32::MIN_POSITIVE));
        let part = |centre: Vec3A| ((centre - lo) * scale).as_uvec3().to_array();
        let tagged = |(centre, triangle)| Tagged::new(part(centre), triangle);
        let mut sorted: Vec<Tagged> = centres.into_iter().zip(triangles).map(tagged).collect();
        sorted.par_sort_unstable();
        let mut primitives = Self {
            triangles: Vec::with_capacity(sorted.len()),
            starts: Vec::with_capacity(sorted.len() + 1),
        };
        for pile in sorted.chunk_by(|a, b| a.key() == b.key()) {
            for (i, triangle) in pile.iter().map(|t| t.tag()).enumerate() {
                if i == 0 || pile.len() <= PILE {
                    primitives.starts.push(primitives.triangles.len() as u32);
                }
                primitives.triangles.push(triangle);
            }
        }
        primitives.starts.push(primitives.triangles.len() as u32);
        primitives
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// The triangles of all `primitives`, in their order.
    fn all(&self, primitives: &[u32]) -> Vec<u32> {
        let triangles = primitives.iter().flat_map(|&p| self.triangles(p));
        triangles.copied().collect()
    }

    fn triangles(&self, primitive: u32) -> &[u32] {
        let at = primitive as usize;
        &self.triangles[self.starts[at] as usize..self.starts[at + 1] as usize]
    }
}

/// A hierarchy under construction.
struct Build<'a> {
    mesh: &'a Mesh,
    cutouts: &'a Cutouts,
    primitives: Primitives,
    bvh: Bvh8,
}

impl Build<'_> {
    fn boxes(&self) -> Vec<Aabb> {
        (0..self.primitives.len() as u32)
            .into_par_iter()
            .map(|p| self.bounds(self.primitives.triangles(p)))
            .collect()
    }

    fn bounds(&self, triangles: &[u32]) -> Aabb {
        triangles
            .iter()
            .fold(Aabb::empty(), |all, &t| all.union(&bounds(self.mesh, t)))
    }

    fn push_block(&mut self, triangles: &[u32]) -> u32 {
        let block = block_of(triangles.iter().map(|&t| {
            let at = t as usize;
            (self.mesh.corners(at), t, self.cutouts.is_mapped(at))
        }));
        self.bvh.push_block(block)
    }

    /// Turns the binary tree into a wide one; `None` when that is too deep for the traversal stacks.
    fn collapse(&mut self, binary: &Bvh2) -> Option<()> {
        let count = |&p: &u32| self.primitives.triangles(p).len() as u32;
        let forests = Forests::of(binary, |leaf| {
            let leaf = &binary.nodes[leaf as usize];
            primitives_of(binary, leaf).iter().map(count).sum()
        });
        let root = self.bvh.push_node();
        // (wide node to fill, its binary nodes, depth)
        let mut work = vec![(root, forests.members(binary, 0), 1)];
        while let Some((wide, members, depth)) = work.pop() {
            if depth > COLLAPSED_LEVELS {
                return None;
            }
            for (slot, &member) in members.iter().enumerate() {
                let node = &binary.nodes[member as usize];
                let link = if !forests.is_block(member) {
                    let child = self.bvh.push_node();
                    work.push((child, forests.members(binary, member), depth + 1));
                    child
                } else {
                    let triangles = self.primitives.all(&primitives_below(binary, member));
                    if triangles.len() <= BLOCK {
                        self.push_block(&triangles)
                    } else {
                        self.evenly(&triangles)
                    }
                };
                let bounds = node.aabb();
                self.bvh.set(wide, slot, bounds.min, bounds.max, link);
            }
        }
        Some(())
    }

    /// Adds an 8-ary tree over `triangles` in their order, of logarithmic depth wherever they are, and returns the link to it.
    #[cold]
    fn evenly(&mut self, triangles: &[u32]) -> u32 {
        let root = self.bvh.push_node();
        let mut work = vec![(root, 0..triangles.len())];
        while let Some((wide, range)) = work.pop() {
            let step = range.len().div_ceil(WIDTH).max(BLOCK);
            for (slot, from) in range.clone().step_by(step).enumerate() {
                let part = from..(from + step).min(range.end);
                let bounds = self.bounds(&triangles[part.clone()]);
                let link = if part.len() <= BLOCK {
                    self.push_block(&triangles[part])
                } else {
                    let child = self.bvh.push_node();
                    work.push((child, part));
                    child
                };
                self.bvh.set(wide, slot, bounds.min, bounds.max, link);
            }
        }
        root
    }
}

/// The primitives of a leaf.
fn primitives_of<'a>(binary: &'a Bvh2, leaf: &Bvh2Node) -> &'a [u32] {
    let first = leaf.first_index as usize;
    &binary.primitive_indices[first..first + leaf.prim_count as usize]
}

/// The primitives of all leaves below `node`, or its own: the builder moves subtrees about, so that they do not lie side by
/// side.
fn primitives_below(binary: &Bvh2, node: u32) -> Vec<u32> {
    let mut primitives = Vec::new();
    let mut work = vec![node];
    while let Some(node) = work.pop() {
        let node = &binary.nodes[node as usize];
        if node.is_leaf() {
            primitives.extend_from_slice(primitives_of(binary, node));
        } else {
            work.extend([node.first_index + 1, node.first_index]);
        }
    }
    primitives
}
