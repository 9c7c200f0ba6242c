//! An 8-wide bounding volume hierarchy, as rays read it.

use glam::{Vec3, Vec3A};

use super::build::MAX_DEPTH;
use super::triangle::TriangleBlock;

/// Children of a node.
pub(crate) const WIDTH: usize = 8;
/// Entries a traversal stack needs: every level leaves at most 7 behind, and eight are written at once.
pub(crate) const STACK: usize = 7 * MAX_DEPTH + 8;
/// Set in a link to a block of triangles, whose other bits are its index.
const LEAF: u32 = 1 << 31;
/// A link that leads nowhere, below all others on a stack.
pub(crate) const NOWHERE: u32 = u32::MAX;

/// A number for each child.
pub(crate) type Lanes = [f32; WIDTH];
/// Links that a ray has yet to follow. There is always room for eight more.
pub(crate) type Stack = [u32; STACK];

/// Eight boxes, coordinate by coordinate, and what lies in them. Unused slots hold an infinitely distant point.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(crate) struct Node8 {
    /// Least x, y, z, then greatest x, y, z.
    pub(crate) bounds: [Lanes; 6],
    pub(crate) links: [u32; WIDTH],
}

/// The hierarchy; `nodes` is empty when there is no triangle.
#[derive(Debug, Default)]
pub(crate) struct Bvh8 {
    pub(crate) nodes: Vec<Node8>,
    pub(crate) blocks: Vec<TriangleBlock>,
    pub(crate) triangle_count: usize,
}

/// A ray prepared for box tests.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NodeRay {
    pub(crate) origin: Vec3,
    pub(crate) inverse: Vec3,
}

/// A ray prepared for box tests whose answer it waits for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OrderedRay {
    pub(crate) ray: NodeRay,
    /// The reciprocal direction, longer by [`FAR_SLACK`].
    pub(crate) inverse_far: Vec3,
    /// For each axis the row of bounds that the ray comes to first, and the other.
    pub(crate) rows: [[u8; 2]; 3],
}

/// Widens the far end of the slabs by 4 ulp, so that rounding never loses a box that the ray enters
/// (Ize 2013, "Robust BVH Ray Traversal").
pub(crate) const FAR_SLACK: f32 = 1.000_000_5;

impl NodeRay {
    #[inline(always)]
    pub(crate) fn of(origin: Vec3, direction: Vec3) -> Self {
        // A finite reciprocal for 0 keeps 0 · ∞ out of the slab test.
        let inverse = Vec3::select(
            direction.abs().cmpgt(Vec3::splat(1e-30)),
            direction.recip(),
            Vec3::splat(1e30).copysign(direction),
        );
        Self { origin, inverse }
    }
}

impl OrderedRay {
    #[inline(always)]
    pub(crate) fn of(origin: Vec3, direction: Vec3) -> Self {
        let ray = NodeRay::of(origin, direction);
        let is_backward = ray.inverse.cmplt(Vec3::ZERO);
        let rows = [0, 1, 2].map(|axis| match is_backward.test(axis.into()) {
            true => [axis + 3, axis],
            false => [axis, axis + 3],
        });
        Self {
            ray,
            inverse_far: ray.inverse * FAR_SLACK,
            rows,
        }
    }
}

impl Node8 {
    pub(super) const EMPTY: Self = Self {
        bounds: [[f32::INFINITY; WIDTH]; 6],
        links: [0; WIDTH],
    };

    pub(super) fn set(&mut self, slot: usize, lo: Vec3A, hi: Vec3A, link: u32) {
        for axis in 0..3 {
            self.bounds[axis][slot] = lo[axis];
            self.bounds[axis + 3][slot] = hi[axis];
        }
        self.links[slot] = link;
    }
}

/// Whether a link leads to a node. One that does not leads to a block of triangles, or [`NOWHERE`].
#[inline(always)]
pub(crate) fn is_inner(link: u32) -> bool {
    link & LEAF == 0
}

/// Which node or block a link leads to.
#[inline(always)]
pub(crate) fn index_of(link: u32) -> usize {
    (link & !LEAF) as usize
}

impl Bvh8 {
    /// Adds a block and returns the link that leads to it.
    pub(super) fn push_block(&mut self, block: TriangleBlock) -> u32 {
        assert!(
            self.blocks.len() < (NOWHERE & !LEAF) as usize,
            "too many triangles for links of 32 bits"
        );
        self.blocks.push(block);
        LEAF | (self.blocks.len() - 1) as u32
    }

    /// Heap memory in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node8>() + self.blocks.len() * size_of::<TriangleBlock>()
    }
}
