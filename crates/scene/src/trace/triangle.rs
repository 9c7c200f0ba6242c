//! A watertight ray–triangle test, four triangles at a time.

use glam::{Vec3, Vec4};

use super::Ray;

/// Triangles of a block.
pub(crate) const BLOCK: usize = 4;

/// Up to four triangles as rays read them, coordinate by coordinate: original corners, so that neighbours
/// compute a shared edge from the same numbers. An empty place holds a point, which nothing meets.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub(crate) struct TriangleBlock {
    a: [Vec4; 3],
    b: [Vec4; 3],
    c: [Vec4; 3],
    /// Indices into the mesh, with [`CUTOUT`] where hits must ask the opacity map.
    tags: [u32; BLOCK],
}

const CUTOUT: u32 = 1 << 31;

/// A ray prepared for triangle tests.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WatertightRay {
    origin: Vec3,
    direction: Vec3,
}

/// Where a ray meets the triangles of a block.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BlockHits {
    /// Bit k is set where triangle k is met.
    pub(crate) mask: u32,
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

/// Four vectors, coordinate by coordinate.
type Vectors = [Vec4; 3];

#[inline(always)]
fn splat(v: Vec3) -> Vectors {
    [Vec4::splat(v.x), Vec4::splat(v.y), Vec4::splat(v.z)]
}

#[inline(always)]
fn plus(a: Vectors, b: Vectors) -> Vectors {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn minus(a: Vectors, b: Vectors) -> Vectors {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn cross(a: Vectors, b: Vectors) -> Vectors {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
fn dot(a: Vectors, b: Vectors) -> Vec4 {
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
        TriangleHit {
            t: self.t[k],
            u: self.v[k] / self.sum[k],
            v: self.w[k] / self.sum[k],
        }
    }
}

impl TriangleBlock {
    pub(crate) const EMPTY: Self = Self {
        a: [Vec4::ZERO; 3],
        b: [Vec4::ZERO; 3],
        c: [Vec4::ZERO; 3],
        tags: [0; BLOCK],
    };

    /// Puts triangle `id` into place `k`.
    pub(crate) fn set(&mut self, k: usize, corners: [Vec3; 3], id: u32, cutout: bool) {
        assert!(id < CUTOUT, "triangle index {id} does not fit 31 bits");
        for (to, from) in [&mut self.a, &mut self.b, &mut self.c]
            .into_iter()
            .zip(corners)
        {
            for axis in 0..3 {
                to[axis][k] = from[axis];
            }
        }
        self.tags[k] = id | if cutout { CUTOUT } else { 0 };
    }

    #[inline(always)]
    pub(crate) fn id(&self, k: usize) -> u32 {
        self.tags[k] & !CUTOUT
    }

    /// The triangles in places that are not empty.
    #[cfg(test)]
    pub(crate) fn ids(&self) -> Vec<u32> {
        let is_empty = |k: usize| {
            [self.a, self.b, self.c]
                .iter()
                .flatten()
                .all(|v| v[k] == 0.0)
        };
        let used = (0..BLOCK).filter(|&k| !is_empty(k));
        used.map(|k| self.id(k)).collect()
    }

    #[inline(always)]
    pub(crate) fn is_cutout(&self, k: usize) -> bool {
        self.tags[k] & CUTOUT != 0
    }

    /// Hits with 0 < t < `t_max`. Both sides count; a ray in a triangle's plane misses it.
    ///
    /// The sign of each Plücker product tells on which side of an edge the ray passes; a neighbour computes
    /// the exact negative for a shared edge. Source: Davidovič et al. 2012, "3D Rasterization".
    #[inline(always)]
    pub(crate) fn intersect(&self, ray: &WatertightRay, t_max: f32) -> BlockHits {
        let (origin, direction) = (splat(ray.origin), splat(ray.direction));
        let (a, b, c) = (
            minus(self.a, origin),
            minus(self.b, origin),
            minus(self.c, origin),
        );
        let (ca, ab, bc) = (minus(c, a), minus(a, b), minus(b, c));
        // Weight of b is the volume spanned with the edge c–a, and so on.
        let v = dot(cross(ca, plus(c, a)), direction);
        let w = dot(cross(ab, plus(a, b)), direction);
        let u = dot(cross(bc, plus(b, c)), direction);
        let sum = u + v + w;
        let slack = sum.abs() * EDGE_SLACK;
        let (least, greatest) = (u.min(v).min(w), u.max(v).max(w));
        let inside = (least.cmpge(-slack) | greatest.cmple(slack)) & sum.cmpne(Vec4::ZERO);
        let normal = cross(ca, ab);
        // Parallel to the plane 0/0 or x/0: NaN and infinity fail the range test.
        let t = dot(normal, a) / dot(normal, direction);
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
