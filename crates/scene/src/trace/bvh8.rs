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
/// What links count: eight bytes, by which addresses are multiplied at no cost.
type Step = [f32; WIDTH / STEPS];
/// Steps of a row.
const STEPS: usize = 4;
/// Set in a link to a block of triangles.
const LEAF: u32 = 1;
/// A link that leads nowhere, below all others on a stack. To ask for its memory is to ask for the root's.
pub(crate) const NOWHERE: u32 = 2;

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
///
/// Made by [`Bvh8::node`] alone, which asks whether all rows are there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node8<'a> {
    rows: &'a [Row],
    link: u32,
}

/// The hierarchy; `rows` is empty when there is no triangle.
///
/// Nodes and blocks lie in one array, so that a link says where its first cache line is without asking which of both it
/// leads to: it is the number of [`Step`]s before it, and [`LEAF`].
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
    pub(crate) rows: [[usize; 2]; 3],
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
        // Of the direction itself: its reciprocal is waited for.
        let backward = direction.is_negative_bitmask() as usize;
        let rows = |axis: usize| {
            let first = 3 * (backward >> axis & 1);
            [axis + first, axis + 3 - first]
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
        assert!(row < NODE, "a node has seven rows");
        #[allow(unsafe_code, reason = "the sum of addresses is part of the load")]
        // SAFETY: whoever made the node has asked.
        let [bounds] = unsafe { rows_at(self.rows, row, self.link) };
        bounds
    }

    /// Where child `k` is.
    #[inline(always)]
    pub(crate) fn link(&self, k: usize) -> u32 {
        self.links()[k].to_bits()
    }

    /// The bits of all links.
    #[inline(always)]
    pub(crate) fn links(&self) -> &Lanes {
        self.bounds(LINKS)
    }
}

/// Whether a link that leads somewhere leads to a node, and not to a block of triangles.
#[inline(always)]
pub(crate) fn is_inner(link: u32) -> bool {
    link & LEAF == 0
}

/// 1 when a link leads nowhere, else 0.
#[inline(always)]
pub(crate) fn nowhere_bit(link: u32) -> u32 {
    (link & NOWHERE) >> 1
}

/// 1 when a link leads to a block of triangles, else 0.
#[inline(always)]
pub(crate) fn block_bit(link: u32) -> u32 {
    link & LEAF
}

/// The numbers of `N` rows, of which the first is `row` rows behind the one that `link` leads to.
///
/// # Safety
/// All of them are among `rows`.
#[inline(always)]
#[allow(unsafe_code, reason = "the sum of addresses is part of the load")]
unsafe fn rows_at<const N: usize>(rows: &[Row], row: usize, link: u32) -> &[Lanes; N] {
    // What a traversal keeps is added first, and the link, which it waits for, by the load itself.
    let steps = rows.as_ptr().wrapping_add(row).cast::<Step>();
    // SAFETY: as the caller promises; rows hold numbers and nothing else.
    unsafe { &*steps.wrapping_add(link as usize).cast() }
}

impl Bvh8 {
    /// The node that `link` leads to.
    #[inline(always)]
    pub(crate) fn node(&self, link: u32) -> Node8<'_> {
        self.assert_holds(link, NODE);
        Node8 {
            rows: &self.rows,
            link,
        }
    }

    /// The block that `link` leads to.
    #[inline(always)]
    pub(crate) fn block(&self, link: u32) -> TriangleBlock<'_> {
        let link = link.wrapping_sub(LEAF);
        self.assert_holds(link, BLOCK_ROWS);
        #[allow(unsafe_code, reason = "the sum of addresses is part of the load")]
        // SAFETY: that was just asked.
        TriangleBlock(unsafe { rows_at(&self.rows, 0, link) })
    }

    #[inline(always)]
    fn assert_holds(&self, link: u32, rows: usize) {
        let (end, all) = (rows * STEPS, self.rows.len() * STEPS);
        assert!(
            u64::from(link) + end as u64 <= all as u64,
            "a link leads to what was put there"
        );
    }

    /// Asks for the memory that `link` will read; nothing where the processor offers no way to.
    #[inline(always)]
    pub(crate) fn prefetch(&self, link: u32) {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            // A node touches four cache lines, and a block three: a number that depended on the link would be a branch. The
            // bit that tells them apart is a step, and changes no line.
            let steps = self.rows.as_ptr().cast::<Step>();
            let address = steps.wrapping_add(link as usize).cast::<i8>();
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
