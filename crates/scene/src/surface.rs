//! From a hit to a point that can be shaded and that rays can leave.

use glam::{Vec2, Vec3};

use crate::brdf::Brdf;
use crate::trace::Hit;
use crate::{ABSENT, MaterialId, Scene};

/// A point on a surface, seen from one side.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// On the triangle, up to rounding.
    pub position: Vec3,
    /// Unit geometric normal on the viewer's side.
    pub ng: Vec3,
    /// Unit shading normal on the viewer's side; within a right angle of `ng`.
    pub ns: Vec3,
    /// Reflection at this point, textures looked up.
    pub brdf: Brdf,
    /// What the surface is made of.
    pub material: MaterialId,
    /// Distance along `ng` at which a ray may start without meeting this surface again.
    offset: f32,
}

/// Error of a point on a triangle, in units of the largest coordinate involved. Interpolating three corners
/// costs about 4 roundings of 6·10⁻⁸ (Higham's γ); the triangle test on the way back as many again, magnified
/// at grazing angles. Measured on the test scenes 8 is enough; 32 leaves room.
const OFFSET: f32 = 32.0 * f32::EPSILON;

impl Scene {
    /// The surface at `hit`, seen against unit ray direction `direction`: both sides are shaded alike.
    pub fn surface(&self, hit: &Hit, direction: Vec3) -> Surface {
        let t = hit.triangle as usize;
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let [a, b, c] = self.mesh.corners(t);
        let position = a * weights[0] + b * weights[1] + c * weights[2];

        // Degenerate triangles were dropped at load: only one that underflows has no normal.
        let ng = (b - a)
            .as_dvec3()
            .cross((c - a).as_dvec3())
            .normalize_or_zero()
            .as_vec3();
        let ng = if ng.dot(direction) > 0.0 { -ng } else { ng };
        let ns = match self.mesh.normal_indices.get(t) {
            Some(n) if n[0] != ABSENT => {
                let n = n.map(|i| self.mesh.normals[i as usize]);
                let ns =
                    (n[0] * weights[0] + n[1] * weights[1] + n[2] * weights[2]).normalize_or(ng);
                if ns.dot(ng) < 0.0 { -ns } else { ns }
            }
            _ => ng,
        };
        let uv = match self.mesh.uv_indices.get(t) {
            Some(uv) if uv[0] != ABSENT => {
                let uv = uv.map(|i| self.mesh.uvs[i as usize]);
                uv[0] * weights[0] + uv[1] * weights[1] + uv[2] * weights[2]
            }
            _ => Vec2::ZERO,
        };
        let material = self.mesh.materials[t];
        Surface {
            position,
            ng,
            ns,
            brdf: self.brdf(material, uv),
            material,
            offset: self.ray_offset(t),
        }
    }

    /// Distance off triangle `t` at which a ray may start without meeting it again.
    pub fn ray_offset(&self, t: usize) -> f32 {
        let [a, b, c] = self.mesh.corners(t).map(Vec3::abs);
        OFFSET * a.max(b).max(c).max_element()
    }

    /// Reflection of `material` at texture coordinate `uv`; never more than arrives.
    fn brdf(&self, material: MaterialId, uv: Vec2) -> Brdf {
        let m = &self.materials[material.0 as usize];
        let plain = Brdf {
            diffuse: m.diffuse,
            specular: m.specular,
            exponent: m.exponent,
        };
        let Some(map) = m.diffuse_map else {
            return plain;
        };
        let diffuse = self.textures[map.0 as usize].colour(uv) * m.diffuse;
        // Loading limits Kd + Ks where there is no map; a bright texel is limited here.
        let scale = (diffuse + m.specular).max(Vec3::ONE).recip();
        Brdf {
            diffuse: diffuse * scale,
            specular: m.specular * scale,
            ..plain
        }
    }
}

impl Surface {
    /// Where rays on the viewer's side start: off the surface by its own rounding error, whatever the scale.
    #[inline]
    pub fn ray_origin(&self) -> Vec3 {
        self.position + self.ng * self.offset
    }
}
