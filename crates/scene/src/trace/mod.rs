//! Rays against triangles: closest hit for eye paths and particles, occlusion for shadow rays.
//!
//! Nodes have eight boxes and blocks four triangles, so that one pass of vector code tests them all; a wide node
//! also lets many shadow rays be kept in flight at once, which hides the memory latency that a single ray waits
//! for. AVX2 and AVX-512 are used where the processor has them, with the same bits (`width`).

mod build;
mod bvh8;
mod cutout;
mod forest;
mod nearest;
mod occlusion;
mod single;
mod triangle;
mod width;

use glam::Vec3;

use crate::Scene;
use bvh8::Bvh8;
use cutout::Cutouts;
pub use nearest::NearestScratch;
pub use occlusion::OcclusionScratch;
use width::Widest;

/// A ray, or with `t_max` = 1 the segment from `origin` to `origin + direction`.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Start, moved off its surface.
    pub origin: Vec3,
    /// Any length but zero.
    pub direction: Vec3,
    /// Hits are sought for 0 < t < t_max, in units of `direction`.
    pub t_max: f32,
}

impl Ray {
    /// The open segment between two points that have both been moved off their surfaces.
    #[inline]
    pub fn between(from: Vec3, to: Vec3) -> Self {
        // The last 10⁻⁵ of the way belongs to the surface that the far point lies on.
        Self {
            origin: from,
            direction: to - from,
            t_max: 1.0 - 1e-5,
        }
    }
}

/// Where a ray met a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// In units of the ray's direction.
    pub t: f32,
    /// Index into the mesh's arrays.
    pub triangle: u32,
    /// Barycentric weight of the second corner.
    pub u: f32,
    /// Barycentric weight of the third corner.
    pub v: f32,
}

/// The scene's geometry, ready for rays.
#[derive(Debug)]
pub struct Tracer {
    bvh: Bvh8,
    cutouts: Cutouts,
    widest: Widest,
}

impl Tracer {
    /// Builds the hierarchy; the same for any number of threads.
    ///
    /// Triangles whose material has a constant opacity below ½ are left out; an opacity map costs a texture
    /// look-up only at hits on its own triangles.
    pub fn build(scene: &Scene) -> Self {
        let cutouts = Cutouts::of(scene);
        let bvh = Bvh8::build(&scene.mesh, &cutouts);
        Self {
            bvh,
            cutouts,
            widest: Widest::detect(),
        }
    }

    /// Number of triangles that rays can hit.
    pub fn triangle_count(&self) -> usize {
        self.bvh.triangle_count
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        self.bvh.bytes()
    }

    /// Whether any triangle needs a texture look-up to know if it is there.
    pub fn has_cutouts(&self) -> bool {
        self.cutouts.any()
    }
}

#[cfg(test)]
mod tests;
