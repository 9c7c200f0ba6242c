//! The scene's own lights.

use glam::Vec3;

use crate::{ABSENT, Mesh, Scene};

/// A light as the scene's files give it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Emitter {
    /// Shines alike in every direction.
    Point {
        /// World space, finite.
        position: Vec3,
        /// W/sr per channel, finite, not negative, not all zero.
        intensity: Vec3,
    },
    /// Shines within a cone: at full intensity up to the inner angle, not at all beyond the outer one.
    Spot {
        /// World space, finite.
        position: Vec3,
        /// Unit axis of the cone.
        direction: Vec3,
        /// W/sr per channel inside the inner cone, finite, not negative, not all zero.
        intensity: Vec3,
        /// Cosine of the inner angle, not less than that of the outer one; the same for a hard edge.
        cos_inner: f32,
        /// Cosine of the outer angle, in −1..1.
        cos_outer: f32,
    },
    /// Parallel light from beyond the scene.
    Directional {
        /// Unit direction in which the light travels.
        direction: Vec3,
        /// W/m² per channel on a facing surface, finite, not negative, not all zero.
        irradiance: Vec3,
    },
    /// A triangle of the mesh that emits from both sides, as both sides are shaded.
    Triangle {
        /// Index into the mesh's arrays.
        triangle: u32,
        /// Mean radiance over the triangle, W/sr/m² per channel, not all zero. With a texture an estimate that is
        /// above 0 in each channel that any point emits in.
        radiance: Vec3,
        /// Bound of any point's radiance over the mean, by channel: 1 without a texture.
        peak: f32,
    },
}

/// A point of a triangle from which light leaves.
#[derive(Debug, Clone, Copy)]
pub struct EmitterPoint {
    /// On the triangle, up to rounding.
    position: Vec3,
    /// Unit normal to one side.
    normal: Vec3,
    /// How far off the triangle rays start.
    offset: f32,
    area: f32,
}

impl EmitterPoint {
    /// Unit normal on the side that `toward` lies on; `None` in the triangle's plane.
    #[inline]
    pub fn normal_toward(&self, toward: Vec3) -> Option<Vec3> {
        let height = self.normal.dot(toward - self.position);
        if height > 0.0 {
            Some(self.normal)
        } else if height < 0.0 {
            Some(-self.normal)
        } else {
            None
        }
    }

    /// Area of the triangle, scene unit².
    #[inline]
    pub fn area(&self) -> f32 {
        self.area
    }

    /// Unit normal to one of the sides.
    pub fn normal(&self) -> Vec3 {
        self.normal
    }

    /// The point, moved off the triangle to the side of `normal`, which is one of its two.
    #[inline]
    pub fn off(&self, normal: Vec3) -> Vec3 {
        self.position + normal * self.offset
    }
}

impl Mesh {
    /// Area of triangle `t`, scene unit².
    pub fn area(&self, t: usize) -> f32 {
        let [a, b, c] = self.corners(t).map(|p| p.as_dvec3());
        (0.5 * (b - a).cross(c - a).length()) as f32
    }
}

impl Scene {
    /// Whether a ray can meet light without meeting a surface that reflects it: a triangle that emits, or the
    /// environment.
    pub fn has_visible_lights(&self) -> bool {
        !self.emissive.is_empty() || self.environment.is_some()
    }

    /// Radiance that triangle `t` emits, to either side, at the barycentric weights `u`, `v` of its second and third
    /// corner; zero where it is no light, or not there.
    pub fn emitted(&self, t: usize, u: f32, v: f32) -> Vec3 {
        if !self.emissive.get(t).is_some_and(|&emits| emits) {
            return Vec3::ZERO;
        }
        let material = &self.materials[self.mesh.materials[t].0 as usize];
        if material.emission_map.is_none() && material.opacity_map.is_none() {
            return material.emission;
        }
        let Some(uvs) = self.mesh.uv_indices.get(t).filter(|uv| uv[0] != ABSENT) else {
            return material.emission;
        };
        let [a, b, c] = uvs.map(|i| self.mesh.uvs[i as usize]);
        let uv = a * (1.0 - u - v) + b * u + c * v;
        let texture = |id: crate::TextureId| &self.textures[id.0 as usize];
        let there = material
            .opacity_map
            .is_none_or(|map| material.opacity * texture(map).opacity(uv) >= 0.5);
        match material.emission_map {
            _ if !there => Vec3::ZERO,
            Some(map) => material.emission * texture(map).colour(uv),
            None => material.emission,
        }
    }

    /// The point of triangle `t` with barycentric weights `u`, `v` of its second and third corner.
    pub fn emitter_point(&self, t: usize, u: f32, v: f32) -> EmitterPoint {
        let [a, b, c] = self.mesh.corners(t);
        let normal = (b - a).as_dvec3().cross((c - a).as_dvec3());
        let twice_area = normal.length();
        EmitterPoint {
            position: a * (1.0 - u - v) + b * u + c * v,
            // No triangle is degenerate: only one that underflows has no normal, and emits nothing.
            normal: (normal / twice_area.max(f64::MIN_POSITIVE)).as_vec3(),
            area: (0.5 * twice_area) as f32,
            offset: self.ray_offset(t),
        }
    }
}

impl Emitter {
    /// The light, moved by `offset` (scene units, finite). Parallel light has no place, and a triangle stays where the
    /// mesh has it.
    pub fn moved_by(self, offset: Vec3) -> Self {
        match self {
            Self::Directional { .. } | Self::Triangle { .. } => self,
            Self::Spot {
                position,
                direction,
                intensity,
                cos_inner,
                cos_outer,
            } => Self::Spot {
                position: position + offset,
                direction,
                intensity,
                cos_inner,
                cos_outer,
            },
            Self::Point {
                position,
                intensity,
            } => Self::Point {
                position: position + offset,
                intensity,
            },
        }
    }
}
