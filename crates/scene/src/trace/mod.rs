//! Rays against triangles: closest hit for eye paths and particles, occlusion for shadow rays.
//!
//! The hierarchy is built by obvhs and collapsed into 8-wide nodes of our own. Two reasons: the crate's
//! triangle test leaks rays along shared edges, and a wide node lets many shadow rays be kept in
//! flight at once, which hides the memory latency that a single ray waits for.

mod bvh8;
mod cutout;
mod occlusion;
mod triangle;

use std::ops::Range;

use glam::Vec3;

use crate::Scene;
use bvh8::{Bvh8, NodeBox};
use cutout::Cutouts;
pub use occlusion::OcclusionScratch;
use triangle::WatertightRay;

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
}

impl Tracer {
    /// Builds the hierarchy; the same for any number of threads.
    ///
    /// Triangles whose material has a constant opacity below ½ are left out; an opacity map costs a texture
    /// look-up only at hits on its own triangles.
    pub fn build(scene: &Scene) -> Self {
        let cutouts = Cutouts::of(scene);
        let bvh = Bvh8::build(&scene.mesh, &cutouts);
        Self { bvh, cutouts }
    }

    /// Nearest hit, or `None`.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        if self.bvh.nodes.is_empty() {
            return None;
        }
        let mut best: Option<Hit> = None;
        let mut t_max = ray.t_max;
        let query = NodeBox::of(ray.origin, ray.direction);
        let watertight = WatertightRay::new(ray.origin, ray.direction);
        let mut stack = [(0u32, 0.0f32); bvh8::STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (link, entry) = stack[top];
            if entry > t_max {
                continue;
            }
            if let Some(range) = bvh8::leaf_range(link) {
                for triangle in &self.bvh.triangles[range] {
                    let Some(hit) = triangle.intersect(&watertight, t_max) else {
                        continue;
                    };
                    if triangle.is_cutout() && !self.cutouts.is_solid(triangle.id(), hit.u, hit.v) {
                        continue;
                    }
                    t_max = hit.t;
                    best = Some(Hit {
                        t: hit.t,
                        triangle: triangle.id(),
                        u: hit.u,
                        v: hit.v,
                    });
                }
                continue;
            }
            let node = &self.bvh.nodes[link as usize];
            let near = node.intersect(&query, t_max);
            let first = top;
            for (k, &near) in near.iter().enumerate() {
                if near == f32::INFINITY {
                    continue;
                }
                // Insertion keeps the nearest on top of the stack.
                let mut at = top;
                while at > first && stack[at - 1].1 < near {
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                stack[at] = (node.links[k], near);
                top += 1;
            }
        }
        best
    }

    /// Whether anything lies on the ray. [`occluded`](Self::occluded) answers many rays sooner.
    pub fn is_occluded(&self, ray: &Ray) -> bool {
        if self.bvh.nodes.is_empty() {
            return false;
        }
        let query = NodeBox::of(ray.origin, ray.direction);
        let watertight = WatertightRay::new(ray.origin, ray.direction);
        let mut stack = [0u32; bvh8::STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            if let Some(range) = bvh8::leaf_range(stack[top]) {
                if self.leaf_stops(range, &watertight, ray.t_max) {
                    return true;
                }
                continue;
            }
            let node = &self.bvh.nodes[stack[top] as usize];
            let near = node.intersect(&query, ray.t_max);
            for (link, near) in node.links.iter().zip(near) {
                // Written whether met or not: no branch to mispredict.
                stack[top] = *link;
                top += usize::from(near != f32::INFINITY);
            }
        }
        false
    }

    /// Whether any triangle of a leaf stops the ray.
    #[inline(always)]
    fn leaf_stops(&self, range: Range<usize>, ray: &WatertightRay, t_max: f32) -> bool {
        self.bvh.triangles[range].iter().any(|triangle| {
            triangle.intersect(ray, t_max).is_some_and(|hit| {
                !triangle.is_cutout() || self.cutouts.is_solid(triangle.id(), hit.u, hit.v)
            })
        })
    }

    /// Number of triangles that rays can hit.
    pub fn triangle_count(&self) -> usize {
        self.bvh.triangles.len()
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
