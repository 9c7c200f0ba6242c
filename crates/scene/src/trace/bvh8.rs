//! An 8-wide bounding volume hierarchy, as rays read it.

use glam::{Vec3, Vec3A};

use super::build::MAX_DEPTH;
use super::triangle::{BLOCK_ROWS, TriangleBlock};

/// Children of a node.
pub(crate) const WIDTH: usize = 8;
/// Entries a traversal stack needs: every level leaves at most 7 behind, and eight are written at once.
pub(crate) const STACK: usize = 7 * MAX_DEPTH + 8;
/// Rows of a node.
pub(crate) const NODE: usize = 7;
/// The last of them: links, bit by bit.
const LINKS: usize = 6;
/// Links count quarters of rows: that many bytes are what addresses are multiplied by at no cost.
const STEPS: usize = 4;
/// Set in a link to a block of triangles.
const LEAF: u32 = 1;
/// A link that leads nowhere, below all others on a stack.
pub(crate) const NOWHERE: u32 = u32::MAX;

/// A number for each child.
pub(crate) type Lanes = [f32; WIDTH];
/// Links that a ray has yet to follow. There is always room for eight more.
pub(crate) type Stack = [u32; STACK];

/// Half a cache line.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub(crate) struct Row(pub(crate) Lanes);

/// Eight boxes, coordinate by coordinate: least x, y, z, greatest x, y, z, and what lies in them. Unused slots hold an
/// infinitely distant point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node8<'a>(&'a [Lanes; NODE]);

/// The hierarchy; `rows` is empty when there is no triangle.
///
/// Nodes and blocks lie in one array, so that a link says where its first cache line is without asking which of both it
/// leads to: it is the number of that row in [`STEPS`], and [`LEAF`].
#[derive(Debug, Default)]
pub(crate) struct Bvh8 {
    pub(crate) rows: Vec<Row>,
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
        let rows = |axis: u8| match is_backward.test(axis.into()) {
            true => [axis + 3, axis],
            false => [axis, axis + 3],
        };
        Self {
            ray,
            inverse_far: ray.inverse * FAR_SLACK,
            rows: [rows(0), rows(1), rows(2)],
        }
    }
}

impl Node8<'_> {
    /// Bounds of all children in one coordinate.
    #[inline(always)]
    pub(crate) fn bounds(&self, row: usize) -> &Lanes {
        &self.0[row]
    }

    /// Where child `k` is.
    #[inline(always)]
    pub(crate) fn link(&self, k: usize) -> u32 {
        self.0[LINKS][k].to_bits()
    }

    /// The bits of all links.
    #[inline(always)]
    pub(crate) fn links(&self) -> &Lanes {
        &self.0[LINKS]
    }
}

/// Whether a link leads to a node. One that does not leads to a block of triangles, or [`NOWHERE`].
#[inline(always)]
pub(crate) fn is_inner(link: u32) -> bool {
    link & LEAF == 0
}

impl Bvh8 {
    /// The node that `link` leads to.
    #[inline(always)]
    pub(crate) fn node(&self, link: u32) -> Node8<'_> {
        Node8(self.rows_at(link))
    }

    /// The block that `link` leads to.
    #[inline(always)]
    pub(crate) fn block(&self, link: u32) -> TriangleBlock<'_> {
        TriangleBlock(self.rows_at(link.wrapping_sub(LEAF)))
    }

    /// The numbers in `N` rows.
    #[inline(always)]
    fn rows_at<const N: usize>(&self, link: u32) -> &[Lanes; N] {
        let (first, end) = (link as usize, self.rows.len() * STEPS);
        assert!(
            first + N * STEPS <= end,
            "links lead to where something was put"
        );
        let rows = self.rows.as_ptr().cast::<[f32; WIDTH / STEPS]>();
        #[allow(
            unsafe_code,
            reason = "a number of a row would be a division and a multiplication before each visit"
        )]
        // SAFETY: they are within the rows, as was just asked, which hold numbers and nothing else.
        unsafe {
            &*rows.add(first).cast()
        }
    }

    /// Asks for the memory that `link` will read; nothing where the processor offers no way to.
    #[inline(always)]
    pub(crate) fn prefetch(&self, link: u32) {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            // A node touches four cache lines, and a block three: a number that depended on the link would be a branch. The
            // bit that tells them apart is a quarter of a row, and changes no line.
            let rows = self.rows.as_ptr().cast::<i8>();
            let address = rows.wrapping_add(link as usize * (size_of::<Row>() / STEPS));
            for line in 0..4 {
                #[allow(unsafe_code, reason = "the only way to prefetch")]
                // SAFETY: a prefetch reads nothing the program can see and never faults, whatever the address.
                unsafe {
                    _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(64 * line));
                }
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = link;
    }

    /// The link to what is added next.
    fn next_link(&self) -> u32 {
        let link = u32::try_from(STEPS * self.rows.len());
        link.expect("too many triangles for links of 32 bits")
    }

    /// Adds an empty node and returns the link to it.
    pub(super) fn push_node(&mut self) -> u32 {
        let link = self.next_link();
        let (nothing, nowhere) = (f32::INFINITY, f32::from_bits(NOWHERE));
        let mut node = [Row([nothing; WIDTH]); NODE];
        node[LINKS] = Row([nowhere; WIDTH]);
        self.rows.extend(node);
        link
    }

    /// Puts what `link` leads to into a slot of the node at `node`.
    pub(super) fn set(&mut self, node: u32, slot: usize, lo: Vec3A, hi: Vec3A, link: u32) {
        let rows = &mut self.rows[node as usize / STEPS..][..NODE];
        for axis in 0..3 {
            rows[axis].0[slot] = lo[axis];
            rows[axis + 3].0[slot] = hi[axis];
        }
        rows[LINKS].0[slot] = f32::from_bits(link);
    }

    /// Adds a block and returns the link that leads to it.
    pub(super) fn push_block(&mut self, block: [Row; BLOCK_ROWS]) -> u32 {
        let link = self.next_link();
        self.rows.extend(block);
        link | LEAF
    }

    /// Heap memory in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.rows.len() * size_of::<Row>()
    }
}
