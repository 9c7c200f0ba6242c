//! An 8-wide bounding volume hierarchy, collapsed from obvhs' binary one.

use std::ops::Range;
use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;

use super::cutout::Cutouts;
use super::triangle::TraceTriangle;
use crate::Mesh;

/// Children of a node.
pub(crate) const WIDTH: usize = 8;
/// Entries a traversal stack needs: every level leaves at most 7 behind. Trees deeper than
/// [`MAX_DEPTH`] are rebuilt balanced.
pub(crate) const STACK: usize = 7 * MAX_DEPTH + 8;
const MAX_DEPTH: usize = 40;
/// Most triangles in a leaf.
const LEAF_SIZE: u32 = 4;

/// Set in a link to triangles; then bits 27..31 hold the count − 1 and the rest the first triangle.
const LEAF: u32 = 1 << 31;
const FIRST_BITS: u32 = 27;

/// Eight boxes, coordinate by coordinate, and what lies in them. Unused slots hold an inverted box.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(crate) struct Node8 {
    lo: [[f32; WIDTH]; 3],
    hi: [[f32; WIDTH]; 3],
    pub(crate) links: [u32; WIDTH],
}

/// The hierarchy; `nodes` is empty when there is no triangle.
#[derive(Debug, Default)]
pub(crate) struct Bvh8 {
    pub(crate) nodes: Vec<Node8>,
    pub(crate) triangles: Vec<TraceTriangle>,
}

/// A ray prepared for box tests.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NodeBox {
    origin: [f32; 3],
    inverse: [f32; 3],
}

impl NodeBox {
    #[inline]
    pub(crate) fn of(origin: Vec3, direction: Vec3) -> Self {
        // A finite reciprocal for 0 keeps 0 · ∞ out of the slab test.
        let inverse = direction.to_array().map(|d| {
            if d.abs() > 1e-30 {
                1.0 / d
            } else {
                1e30f32.copysign(d)
            }
        });
        Self {
            origin: origin.to_array(),
            inverse,
        }
    }
}

/// Widens the far end of each slab by 4 ulp, so that rounding never loses a box that the ray enters
/// (Ize 2013, "Robust BVH Ray Traversal").
const FAR_SLACK: f32 = 1.000_000_5;

impl Node8 {
    const EMPTY: Self = Self {
        lo: [[f32::INFINITY; WIDTH]; 3],
        hi: [[f32::NEG_INFINITY; WIDTH]; 3],
        links: [0; WIDTH],
    };

    fn set(&mut self, slot: usize, bounds: &Aabb, link: u32) {
        for (axis, (lo, hi)) in bounds
            .min
            .to_array()
            .into_iter()
            .zip(bounds.max.to_array())
            .enumerate()
        {
            self.lo[axis][slot] = lo;
            self.hi[axis][slot] = hi;
        }
        self.links[slot] = link;
    }

    /// Entry distance of each child that the ray meets before `t_max`, infinity for the others.
    #[inline(always)]
    pub(crate) fn intersect(&self, ray: &NodeBox, t_max: f32) -> [f32; WIDTH] {
        let mut near = [0.0f32; WIDTH];
        let mut far = [t_max; WIDTH];
        for axis in 0..3 {
            let (o, inv) = (ray.origin[axis], ray.inverse[axis]);
            // Which end is entered first depends on the ray alone: choosing the arrays once leaves
            // straight vector code.
            let (entry, exit) = if inv >= 0.0 {
                (&self.lo[axis], &self.hi[axis])
            } else {
                (&self.hi[axis], &self.lo[axis])
            };
            for k in 0..WIDTH {
                let a = (entry[k] - o) * inv;
                let b = (exit[k] - o) * inv * FAR_SLACK;
                near[k] = if a > near[k] { a } else { near[k] };
                far[k] = if b < far[k] { b } else { far[k] };
            }
        }
        for k in 0..WIDTH {
            near[k] = if near[k] <= far[k] {
                near[k]
            } else {
                f32::INFINITY
            };
        }
        near
    }
}

/// The triangles of a leaf link; `None` for an inner node.
#[inline]
pub(crate) fn leaf_range(link: u32) -> Option<Range<usize>> {
    if link & LEAF == 0 {
        return None;
    }
    let first = (link & ((1 << FIRST_BITS) - 1)) as usize;
    let count = ((link & !LEAF) >> FIRST_BITS) as usize + 1;
    Some(first..first + count)
}

impl Bvh8 {
    pub(crate) fn build(mesh: &Mesh, cutouts: &Cutouts) -> Self {
        let ids: Vec<u32> = (0..mesh.len() as u32)
            .filter(|&t| !cutouts.is_gone(t as usize))
            .collect();
        if ids.is_empty() {
            return Self::default();
        }
        assert!(
            ids.len() < 1 << FIRST_BITS,
            "{} triangles; at most {} can be traced",
            ids.len(),
            1 << FIRST_BITS
        );
        let boxes: Vec<Aabb> = ids
            .iter()
            .map(|&t| {
                let [a, b, c] = mesh.corners(t as usize).map(Vec3A::from);
                Aabb::new(a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        let params = BvhBuildParams {
            max_prims_per_leaf: LEAF_SIZE,
            ..BvhBuildParams::medium_build()
        };
        let binary = build_bvh2(&boxes, params, &mut Duration::default());
        let mut bvh = Self {
            nodes: Vec::new(),
            triangles: Vec::with_capacity(ids.len()),
        };
        let triangle = |slot: u32| {
            let t = ids[slot as usize];
            TraceTriangle::new(mesh.corners(t as usize), t, cutouts.is_mapped(t as usize))
        };
        if bvh.collapse(&binary, triangle).is_none() {
            let order = binary.primitive_indices.clone();
            bvh = Self {
                nodes: Vec::new(),
                triangles: Vec::with_capacity(ids.len()),
            };
            bvh.balance(&boxes, &order, triangle);
        }
        bvh
    }

    /// Turns the binary tree into a wide one; `None` when that is too deep for the traversal stacks.
    fn collapse(&mut self, binary: &Bvh2, triangle: impl Fn(u32) -> TraceTriangle) -> Option<()> {
        self.nodes.push(Node8::EMPTY);
        // (wide node to fill, its binary nodes, depth)
        let mut work = vec![(0usize, widest(binary, 0), 1usize)];
        while let Some((wide, members, depth)) = work.pop() {
            if depth > MAX_DEPTH {
                return None;
            }
            for (slot, &member) in members.iter().enumerate() {
                let node = &binary.nodes[member as usize];
                let link = if node.is_leaf() {
                    let slots =
                        node.first_index as usize..(node.first_index + node.prim_count) as usize;
                    self.push_leaf(binary.primitive_indices[slots].iter().map(|&p| triangle(p)))
                } else {
                    self.nodes.push(Node8::EMPTY);
                    let child = self.nodes.len() - 1;
                    work.push((child, widest(binary, member), depth + 1));
                    child as u32
                };
                self.nodes[wide].set(slot, node.aabb(), link);
            }
        }
        Some(())
    }

    fn push_leaf(&mut self, triangles: impl Iterator<Item = TraceTriangle>) -> u32 {
        let first = self.triangles.len();
        self.triangles.extend(triangles);
        let count = (self.triangles.len() - first) as u32;
        assert!((1..=16).contains(&count), "a leaf of {count} triangles");
        LEAF | ((count - 1) << FIRST_BITS) | first as u32
    }

    /// For the rare input whose binary tree is a chain (many nearly coincident triangles): an 8-ary tree
    /// over the builder's order, of logarithmic depth whatever the boxes.
    #[cold]
    fn balance(&mut self, boxes: &[Aabb], order: &[u32], triangle: impl Fn(u32) -> TraceTriangle) {
        self.nodes.push(Node8::EMPTY);
        let mut work = vec![(0usize, 0..order.len())];
        while let Some((wide, range)) = work.pop() {
            let step = range.len().div_ceil(WIDTH).max(LEAF_SIZE as usize);
            for (slot, from) in range.clone().step_by(step).enumerate() {
                let part = from..(from + step).min(range.end);
                let bounds = order[part.clone()]
                    .iter()
                    .fold(Aabb::empty(), |b, &i| b.union(&boxes[i as usize]));
                let link = if part.len() <= LEAF_SIZE as usize {
                    self.push_leaf(order[part].iter().map(|&p| triangle(p)))
                } else {
                    self.nodes.push(Node8::EMPTY);
                    let child = self.nodes.len() - 1;
                    work.push((child, part));
                    child as u32
                };
                self.nodes[wide].set(slot, &bounds, link);
            }
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node8>() + self.triangles.len() * size_of::<TraceTriangle>()
    }
}

/// Up to eight binary nodes that together cover `node`: the largest inner one is opened until none fits.
fn widest(binary: &Bvh2, node: u32) -> Vec<u32> {
    let mut members = vec![node];
    while members.len() < WIDTH {
        let area = |m: u32| binary.nodes[m as usize].aabb().half_area();
        let Some((slot, &open)) = members
            .iter()
            .enumerate()
            .filter(|(_, m)| !binary.nodes[**m as usize].is_leaf())
            .max_by(|a, b| area(*a.1).total_cmp(&area(*b.1)))
        else {
            break;
        };
        let first = binary.nodes[open as usize].first_index;
        members[slot] = first;
        members.push(first + 1);
    }
    members
}
