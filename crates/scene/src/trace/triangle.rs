//! A watertight ray–triangle test.

use glam::Vec3;
use glam::Vec3A;

/// A triangle as rays read it: original corners, so that neighbours compute a shared edge from the same numbers.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub(crate) struct TraceTriangle {
    a: Vec3,
    b: Vec3,
    c: Vec3,
    /// Index into the mesh, with [`CUTOUT`] where hits must ask the opacity map.
    tag: u32,
}

const CUTOUT: u32 = 1 << 31;

/// A ray prepared for triangle tests.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WatertightRay {
    origin: Vec3A,
    direction: Vec3A,
}

/// Distance and barycentric weights of the second and third corner.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TriangleHit {
    pub(crate) t: f32,
    pub(crate) u: f32,
    pub(crate) v: f32,
}

impl WatertightRay {
    #[inline]
    pub(crate) fn new(origin: Vec3, direction: Vec3) -> Self {
        Self {
            origin: origin.into(),
            direction: direction.into(),
        }
    }
}

/// Rays that miss by less than this share of the triangle still hit. Rounding in the three edge products
/// differs between the triangles around a vertex, so an exact test lets rays through there; 10⁻⁵ closed all
/// of a million aimed at vertices where 10⁻⁶ left thousands open.
const EDGE_SLACK: f32 = 1e-5;

impl TraceTriangle {
    pub(crate) fn new(corners: [Vec3; 3], id: u32, cutout: bool) -> Self {
        assert!(id < CUTOUT, "triangle index {id} does not fit 31 bits");
        let [a, b, c] = corners;
        Self {
            a,
            b,
            c,
            tag: id | if cutout { CUTOUT } else { 0 },
        }
    }

    #[inline]
    pub(crate) fn id(&self) -> u32 {
        self.tag & !CUTOUT
    }

    #[inline]
    pub(crate) fn is_cutout(&self) -> bool {
        self.tag & CUTOUT != 0
    }

    /// A hit with 0 < t < `t_max`. Both sides count; a ray in the triangle's plane misses.
    ///
    /// The sign of each Plücker product tells on which side of an edge the ray passes; a neighbour computes
    /// the exact negative for a shared edge. Source: Davidovič et al. 2012, "3D Rasterization".
    #[inline]
    pub(crate) fn intersect(&self, ray: &WatertightRay, t_max: f32) -> Option<TriangleHit> {
        let (a, b, c) = (
            Vec3A::from(self.a) - ray.origin,
            Vec3A::from(self.b) - ray.origin,
            Vec3A::from(self.c) - ray.origin,
        );
        let (ca, ab, bc) = (c - a, a - b, b - c);
        // Weight of b is the volume spanned with the edge c–a, and so on.
        let v = ca.cross(c + a).dot(ray.direction);
        let w = ab.cross(a + b).dot(ray.direction);
        let u = bc.cross(b + c).dot(ray.direction);
        let sum = u + v + w;
        let slack = EDGE_SLACK * sum.abs();
        let (least, greatest) = (u.min(v).min(w), u.max(v).max(w));
        if !(least >= -slack || greatest <= slack) {
            return None;
        }
        let normal = ca.cross(ab);
        let denominator = normal.dot(ray.direction);
        // Parallel to the plane 0/0 or x/0: NaN and infinity fail the range test.
        let t = normal.dot(a) / denominator;
        if !(t > 0.0 && t < t_max) || sum == 0.0 {
            return None;
        }
        Some(TriangleHit {
            t,
            u: v / sum,
            v: w / sum,
        })
    }
}
