//! A watertight ray–triangle test, four triangles at a time.

use std::ops::{Add, Mul, Sub};

use glam::{Vec3, Vec4};

use super::Ray;
use super::bvh8::{Lanes, Row, WIDTH};

/// Triangles of a block.
pub(crate) const BLOCK: usize = 4;

/// Rows of a block. Four numbers for each corner and coordinate, x of the first and second corner side by side, then y and z
/// of those, x and y of the third, and z of the third beside the tags.
pub(crate) const BLOCK_ROWS: usize = 5;

/// Row, and half of it, where one coordinate of a corner is.
#[inline(always)]
const fn place(corner: usize, axis: usize) -> (usize, usize) {
    if corner < 2 {
        (axis, corner)
    } else {
        (3 + axis / 2, axis % 2)
    }
}

/// Where the tags are.
const TAGS: (usize, usize) = (4, 1);

/// Up to four triangles as rays read them: original corners, so that neighbours compute a shared edge from the same
/// numbers. An empty place holds a point, which nothing meets.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TriangleBlock<'a>(pub(super) &'a [Lanes; BLOCK_ROWS]);

/// Set in the tag of a triangle whose hits must ask the opacity map; the other bits are its index into the mesh.
const CUTOUT: u32 = 1 << 31;

/// A ray prepared for triangle tests.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WatertightRay {
    pub(super) origin: Vec3,
    pub(super) direction: Vec3,
}

/// Where a ray meets the triangles of a block.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BlockHits {
    /// Bit k is set where triangle k is met.
    pub(super) mask: u32,
    t: Vec4,
    v: Vec4,
    w: Vec4,
    sum: Vec4,
}

/// Distance and barycentric weights of the second and third corner.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TriangleHit {
    pub(crate) t: f32,
    pub(crate) u: f32,
    pub(crate) v: f32,
}

/// Rays that miss by less than this share of the triangle still hit. Rounding in the three edge products
/// differs between the triangles around a vertex, so an exact test lets rays through there; 10⁻⁵ closed all
/// of a million aimed at vertices where 10⁻⁶ left thousands open.
const EDGE_SLACK: f32 = 1e-5;

/// Vectors, coordinate by coordinate: as many as `V` has lanes.
pub(super) type Vectors<V> = [V; 3];

/// Numbers that are computed with lane by lane.
pub(super) trait Numbers:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
}

impl Numbers for Vec4 {}

#[inline(always)]
fn splat(v: Vec3) -> Vectors<Vec4> {
    [Vec4::splat(v.x), Vec4::splat(v.y), Vec4::splat(v.z)]
}

#[inline(always)]
pub(super) fn plus<V: Numbers>(a: Vectors<V>, b: Vectors<V>) -> Vectors<V> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(super) fn minus<V: Numbers>(a: Vectors<V>, b: Vectors<V>) -> Vectors<V> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn cross<V: Numbers>(a: Vectors<V>, b: Vectors<V>) -> Vectors<V> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
pub(super) fn dot<V: Numbers>(a: Vectors<V>, b: Vectors<V>) -> V {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl WatertightRay {
    #[inline(always)]
    pub(crate) fn of(ray: &Ray) -> Self {
        Self {
            origin: ray.origin,
            direction: ray.direction,
        }
    }
}

impl BlockHits {
    /// The hit of triangle `k`, one of those in the mask.
    #[inline(always)]
    pub(crate) fn hit(&self, k: usize) -> TriangleHit {
        // An index into glam's vectors is a jump, and `map` of arrays at times a call.
        let at_k = |numbers: Vec4| numbers.to_array()[k];
        let sum = at_k(self.sum);
        TriangleHit {
            t: at_k(self.t),
            u: at_k(self.v) / sum,
            v: at_k(self.w) / sum,
        }
    }
}

/// The block of up to four triangles: their corners, indices, and whether they have an opacity map.
pub(super) fn block_of(
    triangles: impl Iterator<Item = ([Vec3; 3], u32, bool)>,
) -> [Row; BLOCK_ROWS] {
    let mut block = [Row([0.0; WIDTH]); BLOCK_ROWS];
    let mut set = |(row, half): (usize, usize), k, value| block[row].0[half * BLOCK + k] = value;
    for (k, (corners, id, is_cutout)) in triangles.enumerate() {
        assert!(
            k < BLOCK && id < CUTOUT,
            "triangle index {id} does not fit 31 bits"
        );
        for (c, corner) in corners.into_iter().enumerate() {
            (0..3).for_each(|axis| set(place(c, axis), k, corner[axis]));
        }
        let tag = id | if is_cutout { CUTOUT } else { 0 };
        set(TAGS, k, f32::from_bits(tag));
    }
    block
}

impl<'a> TriangleBlock<'a> {
    /// The numbers in half a row.
    #[inline(always)]
    fn half(self, (row, half): (usize, usize)) -> &'a [f32] {
        &self.0[row][half * BLOCK..][..BLOCK]
    }

    #[inline(always)]
    pub(super) fn corner(self, corner: usize) -> Vectors<Vec4> {
        let axis = |axis| Vec4::from_slice(self.half(place(corner, axis)));
        // `map` of arrays is at times a call, which vectors of eight do not survive.
        [axis(0), axis(1), axis(2)]
    }

    #[inline(always)]
    fn tag(self, k: usize) -> u32 {
        self.half(TAGS)[k].to_bits()
    }

    #[inline(always)]
    pub(crate) fn id(self, k: usize) -> u32 {
        self.tag(k) & !CUTOUT
    }

    /// The triangles in places that are not empty.
    #[cfg(test)]
    pub(crate) fn ids(self) -> Vec<u32> {
        let is_empty = |k: usize| (0..9).all(|at| self.half(place(at / 3, at % 3))[k] == 0.0);
        let used = (0..BLOCK).filter(|&k| !is_empty(k));
        used.map(|k| self.id(k)).collect()
    }

    #[inline(always)]
    pub(crate) fn is_cutout(self, k: usize) -> bool {
        self.tag(k) & CUTOUT != 0
    }

    /// Hits with 0 < t < `t_max`. Both sides count; a ray in a triangle's plane misses it.
    ///
    /// The sign of each Plücker product tells on which side of an edge the ray passes; a neighbour computes
    /// the exact negative for a shared edge. Source: Davidovič et al. 2012, "3D Rasterization".
    #[inline(always)]
    pub(crate) fn intersect(self, ray: &WatertightRay, t_max: f32) -> BlockHits {
        let (origin, direction) = (splat(ray.origin), splat(ray.direction));
        let (a, b, c) = (
            minus(self.corner(0), origin),
            minus(self.corner(1), origin),
            minus(self.corner(2), origin),
        );
        let (ca, ab, bc) = (minus(c, a), minus(a, b), minus(b, c));
        // Weight of b is the volume spanned with the edge c–a, and so on.
        let v = dot(cross(ca, plus(c, a)), direction);
        let w = dot(cross(ab, plus(a, b)), direction);
        let u = dot(cross(bc, plus(b, c)), direction);
        let normal = cross(ca, ab);
        let products = Products {
            edges: [u, v, w],
            height: dot(normal, a),
            descent: dot(normal, direction),
        };
        products.hits(t_max)
    }
}

/// What a ray's hits of the four triangles of a block are told from.
pub(super) struct Products {
    /// Volumes spanned with the edges opposite the first, second and third corner.
    pub(super) edges: [Vec4; 3],
    /// Products of the normal, which is not of unit length, with the way to a corner and with the ray's direction.
    pub(super) height: Vec4,
    pub(super) descent: Vec4,
}

impl Products {
    /// Hits with 0 < t < `t_max`.
    #[inline(always)]
    pub(super) fn hits(self, t_max: f32) -> BlockHits {
        let [u, v, w] = self.edges;
        let sum = u + v + w;
        let slack = sum.abs() * EDGE_SLACK;
        let (least, greatest) = (u.min(v).min(w), u.max(v).max(w));
        let inside = (least.cmpge(-slack) | greatest.cmple(slack)) & sum.cmpne(Vec4::ZERO);
        // Parallel to the plane 0/0 or x/0: NaN and infinity fail the range test.
        let t = self.height / self.descent;
        let mask = inside & t.cmpgt(Vec4::ZERO) & t.cmplt(Vec4::splat(t_max));
        BlockHits {
            mask: mask.bitmask(),
            t,
            v,
            w,
            sum,
        }
    }
}
