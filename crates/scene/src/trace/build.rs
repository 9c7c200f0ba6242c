//! Building the hierarchy: top-down, each division by binned surface area heuristic.
//!
//! Source: Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies". Whatever the triangles (one upon
//! another, slivers, a million in one point), the time is bounded by a fixed number of passes over them, and so
//! is the depth.

use glam::{Vec3, Vec3A};
use rayon::prelude::*;

use super::bvh8::{Bvh8, Node8, WIDTH};
use super::cutout::Cutouts;
use super::triangle::{BLOCK, TriangleBlock};
use crate::Mesh;

/// Bins along each axis.
const BINS: usize = 16;
/// Levels that are divided by the heuristic. Good trees have fewer; what is left below is divided evenly.
const HEURISTIC_LEVELS: usize = 24;
/// Levels that even division by eight needs at most.
const EVEN_LEVELS: usize = 11;
/// Nodes on the way to any block.
pub(crate) const MAX_DEPTH: usize = HEURISTIC_LEVELS + EVEN_LEVELS;
/// Fewer triangles are not worth another task.
const SEQUENTIAL: usize = 4096;

/// An axis-parallel box; empty when `lo` > `hi`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) lo: Vec3A,
    pub(crate) hi: Vec3A,
}

impl Bounds {
    const EMPTY: Self = Self {
        lo: Vec3A::INFINITY,
        hi: Vec3A::NEG_INFINITY,
    };

    fn of(corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners.map(Vec3A::from);
        Self {
            lo: a.min(b).min(c),
            hi: a.max(b).max(c),
        }
    }

    #[inline]
    fn union(self, other: Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
        }
    }

    /// Half of the surface area; not finite for an empty box, which is never the better choice.
    #[inline]
    fn half_area(&self) -> f32 {
        let d = self.hi - self.lo;
        d.x * d.y + d.y * d.z + d.z * d.x
    }
}

/// A triangle to be placed.
#[derive(Debug, Clone, Copy)]
struct Reference {
    bounds: Bounds,
    triangle: u32,
}

impl Reference {
    /// Twice the middle of the box.
    #[inline]
    fn centre(&self) -> Vec3A {
        self.bounds.lo + self.bounds.hi
    }
}

/// Triangles that lie side by side, and their common box.
struct Part<'a> {
    references: &'a mut [Reference],
    bounds: Bounds,
}

/// What becomes of a part.
enum Subtree {
    Block(Vec<u32>),
    Node(Vec<(Bounds, Subtree)>),
}

impl Bvh8 {
    /// The hierarchy of all triangles that rays can meet: the same for any number of threads.
    pub(crate) fn build(mesh: &Mesh, cutouts: &Cutouts) -> Self {
        let mut references: Vec<Reference> = (0..mesh.len())
            .filter(|&t| !cutouts.is_gone(t))
            .map(|t| Reference {
                bounds: Bounds::of(mesh.corners(t)),
                triangle: t as u32,
            })
            .collect();
        if references.is_empty() {
            return Self::default();
        }
        let mut bvh = Self {
            triangle_count: references.len(),
            ..Self::default()
        };
        bvh.nodes.push(Node8::EMPTY);
        // Nodes to fill, depth first, with children side by side: neighbours in space are neighbours in memory.
        let mut work = vec![(0usize, children(Part::of(&mut references), 0))];
        while let Some((index, children)) = work.pop() {
            for (slot, (bounds, subtree)) in children.into_iter().enumerate() {
                let link = match subtree {
                    Subtree::Block(triangles) => {
                        let mut block = TriangleBlock::EMPTY;
                        for (k, &t) in triangles.iter().enumerate() {
                            let corners = mesh.corners(t as usize);
                            block.set(k, corners, t, cutouts.is_mapped(t as usize));
                        }
                        bvh.push_block(block)
                    }
                    Subtree::Node(children) => {
                        bvh.nodes.push(Node8::EMPTY);
                        let child = bvh.nodes.len() - 1;
                        work.push((child, children));
                        child as u32
                    }
                };
                bvh.nodes[index].set(slot, &bounds, link);
            }
        }
        bvh
    }
}

/// Divides a part into up to eight, and those in turn. The one of greatest area is divided first.
fn children(part: Part<'_>, level: usize) -> Vec<(Bounds, Subtree)> {
    let many = part.references.len() > SEQUENTIAL;
    let mut parts = vec![part];
    if level >= HEURISTIC_LEVELS {
        parts = parts.remove(0).evenly();
    }
    while parts.len() < WIDTH {
        let Some(widest) = (0..parts.len())
            .filter(|&i| parts[i].references.len() > BLOCK)
            .max_by(|&a, &b| {
                let area = |i: usize| parts[i].bounds.half_area();
                area(a).total_cmp(&area(b))
            })
        else {
            break;
        };
        let (left, right) = parts.swap_remove(widest).divide();
        parts.extend([left, right]);
    }
    let subtree = |part: Part<'_>| {
        let bounds = part.bounds;
        let subtree = if part.references.len() <= BLOCK {
            Subtree::Block(part.references.iter().map(|r| r.triangle).collect())
        } else {
            Subtree::Node(children(part, level + 1))
        };
        (bounds, subtree)
    };
    if many {
        parts.into_par_iter().map(subtree).collect()
    } else {
        parts.into_iter().map(subtree).collect()
    }
}

#[derive(Clone, Copy)]
struct Bin {
    bounds: Bounds,
    count: usize,
}

impl Bin {
    const EMPTY: Self = Self {
        bounds: Bounds::EMPTY,
        count: 0,
    };

    #[inline]
    fn with(self, other: Self) -> Self {
        Self {
            bounds: self.bounds.union(other.bounds),
            count: self.count + other.count,
        }
    }

    /// Cost of tracing what is in the bin: full blocks cost as much as half empty ones.
    fn cost(&self) -> f32 {
        self.bounds.half_area() * self.count.div_ceil(BLOCK) as f32
    }
}

/// Where a part is to be divided: `bin` is the last of the first half.
#[derive(Clone, Copy)]
struct Division {
    axis: usize,
    bin: usize,
}

/// Which bin a centre lies in, along each axis.
#[derive(Clone, Copy)]
struct Binning {
    lo: Vec3A,
    scale: Vec3A,
}

impl Binning {
    /// A centre that is not finite, or an extent too small to be divided, falls into the first or the last bin.
    #[inline]
    fn bins(&self, reference: &Reference) -> [usize; 3] {
        let position = (reference.centre() - self.lo) * self.scale;
        let position = position.min(Vec3A::splat(BINS as f32 - 1.0));
        [
            position.x as usize,
            position.y as usize,
            position.z as usize,
        ]
        .map(|bin| bin.min(BINS - 1))
    }
}

impl<'a> Part<'a> {
    fn of(references: &'a mut [Reference]) -> Self {
        let bounds = references
            .iter()
            .fold(Bounds::EMPTY, |b, r| b.union(r.bounds));
        Self { references, bounds }
    }

    /// Two parts of less cost together than any other two that the bins allow; halves, where nothing tells the
    /// triangles apart.
    fn divide(self) -> (Self, Self) {
        let (lo, hi) = self.centres();
        let binning = Binning {
            lo,
            scale: Vec3A::splat(BINS as f32) / (hi - lo),
        };
        let references = self.references;
        let middle = match best_division(references, &binning) {
            Some(division) => partition(references, |r| {
                binning.bins(r)[division.axis] <= division.bin
            }),
            None => references.len() / 2,
        };
        let (left, right) = references.split_at_mut(middle);
        (Self::of(left), Self::of(right))
    }

    /// Up to eight parts of about the same number of triangles, along the widest axis.
    fn evenly(self) -> Vec<Self> {
        let (lo, hi) = self.centres();
        let axis = (hi - lo).max_position();
        self.references.sort_unstable_by(|a, b| {
            let (x, y) = (a.centre()[axis], b.centre()[axis]);
            x.total_cmp(&y).then(a.triangle.cmp(&b.triangle))
        });
        let step = self.references.len().div_ceil(WIDTH).max(BLOCK);
        self.references.chunks_mut(step).map(Self::of).collect()
    }

    /// The box around the centres.
    fn centres(&self) -> (Vec3A, Vec3A) {
        let start = (Bounds::EMPTY.lo, Bounds::EMPTY.hi);
        self.references.iter().fold(start, |(lo, hi), r| {
            (lo.min(r.centre()), hi.max(r.centre()))
        })
    }
}

/// The cheapest division; `None` where all fall into one bin or no cost is finite.
fn best_division(references: &[Reference], binning: &Binning) -> Option<Division> {
    let mut bins = [[Bin::EMPTY; BINS]; 3];
    for reference in references {
        for (axis, bin) in binning.bins(reference).into_iter().enumerate() {
            let bin = &mut bins[axis][bin];
            bin.bounds = bin.bounds.union(reference.bounds);
            bin.count += 1;
        }
    }
    let mut best = None;
    let mut least = f32::INFINITY;
    for (axis, bins) in bins.iter().enumerate() {
        // Of all bins from each one on.
        let mut rest = [Bin::EMPTY; BINS + 1];
        for i in (0..BINS).rev() {
            rest[i] = rest[i + 1].with(bins[i]);
        }
        let mut left = Bin::EMPTY;
        for bin in 0..BINS - 1 {
            left = left.with(bins[bin]);
            let right = &rest[bin + 1];
            if left.count == 0 || right.count == 0 {
                continue;
            }
            let cost = left.cost() + right.cost();
            if cost < least {
                least = cost;
                best = Some(Division { axis, bin });
            }
        }
    }
    best
}

/// Brings those that are `first` to the front and returns how many they are.
fn partition(references: &mut [Reference], first: impl Fn(&Reference) -> bool) -> usize {
    let mut count = 0;
    for i in 0..references.len() {
        if first(&references[i]) {
            references.swap(count, i);
            count += 1;
        }
    }
    count
}
