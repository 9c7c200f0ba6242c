//! From a hit to a point that can be shaded and that rays can leave.

use glam::{Vec2, Vec3};

use crate::brdf::Brdf;
use crate::material::Texels;
use crate::mesh::at;
use crate::prefetch::prefetch;
use crate::trace::Hit;
use crate::{ABSENT, Channel, MaterialId, Scene};

/// A point on a surface, seen from one side.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// On the triangle, up to rounding.
    pub position: Vec3,
    /// Unit geometric normal on the viewer's side.
    pub ng: Vec3,
    /// Unit shading normal, within a right angle of `ng` and of the direction to the viewer.
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
        let uvs = match self.mesh.uv_indices.get(t) {
            Some(uv) if uv[0] != ABSENT => Some(at(&self.mesh.uvs, *uv)),
            _ => None,
        };
        let uv = uvs.map_or(Vec2::ZERO, |uv| {
            uv[0] * weights[0] + uv[1] * weights[1] + uv[2] * weights[2]
        });
        let smooth = match self.mesh.normal_indices.get(t) {
            Some(n) if n[0] != ABSENT => {
                let n = at(&self.mesh.normals, *n);
                (n[0] * weights[0] + n[1] * weights[1] + n[2] * weights[2]).normalize_or(ng)
            }
            _ => ng,
        };
        let material = self.mesh.materials[t];
        let m = &self.materials[material.0 as usize];
        // Stored normals and maps are about the front, whichever side is seen.
        let front = if smooth.dot(ng) < 0.0 {
            -smooth
        } else {
            smooth
        };
        let bumped = m.normal_map.zip(uvs).and_then(|(map, uvs)| {
            let tangents = Tangents::new([a, b, c], uvs, front)?;
            let slopes = Vec3::new(m.normal_scale, m.normal_scale, 1.0);
            Some(tangents.to_world(slopes * self.textures[map.0 as usize].normal(uv)))
        });
        let side = if ng.dot(direction) > 0.0 { -1.0 } else { 1.0 };
        let (ng, ns) = (ng * side, bumped.unwrap_or(front) * side);
        let ns = if ns == ng {
            ng
        } else {
            raised(raised(ns, ng), -direction)
        };
        let number = |map: Option<Channel>| {
            map.map_or(1.0, |map| {
                self.textures[map.texture.0 as usize].channel(uv, map.index)
            })
        };
        let tint = match self.mesh.colour_indices.get(t) {
            Some(c) if c[0] != ABSENT => {
                let c = at(&self.mesh.colours, *c);
                c[0] * weights[0] + c[1] * weights[1] + c[2] * weights[2]
            }
            _ => Vec3::ONE,
        };
        let texels = Texels {
            diffuse: m
                .diffuse_map
                .map_or(tint, |map| tint * self.textures[map.0 as usize].colour(uv)),
            roughness: number(m.roughness_map),
            metallic: number(m.metallic_map),
        };
        Surface {
            position,
            ng,
            ns,
            brdf: m.brdf(&texels),
            material,
            offset: ray_offset([a, b, c]),
        }
    }

    /// Asks for what the surfaces of the first of `hits` are made of, some of them further ahead than others: who asks before
    /// each of a row of surfaces finds all in the cache.
    #[inline]
    pub fn expect(&self, hits: &[Option<Hit>]) {
        const AHEAD: usize = 8;
        let triangle = |ahead: usize| hits.get(ahead).copied().flatten();
        let mesh = &self.mesh;
        if let Some(hit) = triangle(3 * AHEAD) {
            let t = hit.triangle as usize;
            prefetch(mesh.indices.get(t));
            prefetch(mesh.uv_indices.get(t));
            prefetch(mesh.normal_indices.get(t));
            prefetch(mesh.colour_indices.get(t));
            prefetch(mesh.materials.get(t));
        }
        if let Some(hit) = triangle(2 * AHEAD) {
            let t = hit.triangle as usize;
            prefetch_at(&mesh.positions, mesh.indices.get(t));
            prefetch_at(&mesh.uvs, mesh.uv_indices.get(t));
            prefetch_at(&mesh.normals, mesh.normal_indices.get(t));
            prefetch_at(&mesh.colours, mesh.colour_indices.get(t));
        }
        if let Some(hit) = triangle(AHEAD) {
            let t = hit.triangle as usize;
            let m = &self.materials[mesh.materials[t].0 as usize];
            if let (Some(map), Some(uv)) = (m.diffuse_map, mesh.uv_indices.get(t))
                && uv[0] != ABSENT
            {
                let uv = at(&mesh.uvs, *uv);
                let uv = uv[0] * (1.0 - hit.u - hit.v) + uv[1] * hit.u + uv[2] * hit.v;
                self.textures[map.0 as usize].expect(uv);
            }
        }
    }

    /// Distance off triangle `t` at which a ray may start without meeting it again.
    pub fn ray_offset(&self, t: usize) -> f32 {
        ray_offset(self.mesh.corners(t))
    }
}

/// The same for a triangle by its corners.
fn ray_offset([a, b, c]: [Vec3; 3]) -> f32 {
    OFFSET * a.abs().max(b.abs()).max(c.abs()).max_element()
}

#[inline(always)]
fn prefetch_at<T>(values: &[T], corners: Option<&[u32; 3]>) {
    for &i in corners.into_iter().flatten() {
        prefetch(values.get(i as usize));
    }
}

/// Least cosine between a shading normal and the geometric one, and the direction to the viewer.
const LEAST_COS: f32 = 1e-3;

/// `n`, tilted toward `up` as far as it takes to be above that horizon. Both unit.
fn raised(n: Vec3, up: Vec3) -> Vec3 {
    let cos = n.dot(up);
    if cos >= LEAST_COS {
        n
    } else {
        (n + up * (2.0 * LEAST_COS - cos)).normalize_or(up)
    }
}

/// The frame that a normal map is given in: along growing u, along growing v, and the normal.
struct Tangents {
    u: Vec3,
    v: Vec3,
    n: Vec3,
}

impl Tangents {
    /// Of a triangle with unit normal `n` at the point in question. `None` when the texture has no extent on it.
    fn new(corners: [Vec3; 3], uvs: [Vec2; 3], n: Vec3) -> Option<Self> {
        let [e, f] = [corners[1] - corners[0], corners[2] - corners[0]];
        let [s, t] = [uvs[1] - uvs[0], uvs[2] - uvs[0]];
        let turn = s.perp_dot(t);
        // Only directions matter, not how far u and v reach.
        let (along_u, along_v) = (
            (e * t.y - f * s.y) * turn.signum(),
            (f * s.x - e * t.x) * turn.signum(),
        );
        let u = (along_u - n * n.dot(along_u)).try_normalize()?;
        let v = n.cross(u);
        let v = if v.dot(along_v) < 0.0 { -v } else { v };
        (turn != 0.0 && turn.is_finite()).then_some(Self { u, v, n })
    }

    fn to_world(&self, n: Vec3) -> Vec3 {
        (self.u * n.x + self.v * n.y + self.n * n.z).normalize_or(self.n)
    }
}

impl Surface {
    /// Where rays on the viewer's side start: off the surface by its own rounding error, whatever the scale.
    #[inline]
    pub fn ray_origin(&self) -> Vec3 {
        self.position + self.ng * self.offset
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Material, Mesh, Texture, TextureId};

    /// A unit square in the plane z = 0, u along `u_axis`, with a normal map of one texel.
    fn mapped(u_axis: Vec2, texel: [u8; 3]) -> Scene {
        let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE];
        let [r, g, b] = texel;
        Scene {
            mesh: Mesh {
                positions: corners.map(|p| p.extend(0.0)).to_vec(),
                uvs: corners
                    .map(|p| Vec2::new(p.dot(u_axis), p.dot(u_axis.perp())))
                    .to_vec(),
                indices: vec![[0, 1, 2]],
                uv_indices: vec![[0, 1, 2]],
                materials: vec![MaterialId(0)],
                ..Mesh::default()
            },
            materials: vec![Material {
                normal_map: Some(TextureId(0)),
                ..Material::default()
            }],
            textures: vec![Texture {
                path: String::new(),
                width: 1,
                height: 1,
                texels: vec![[r, g, b, 255]],
                has_alpha: false,
            }],
            ..Scene::default()
        }
    }

    fn seen_along(scene: &Scene, direction: Vec3) -> Surface {
        let hit = Hit {
            t: 1.0,
            triangle: 0,
            u: 0.25,
            v: 0.25,
        };
        scene.surface(&hit, direction.normalize())
    }

    #[test]
    fn a_normal_map_tilts_toward_growing_u_and_v() {
        // (64, 0, 64): 45° toward u.
        for (axis, toward) in [
            (Vec2::X, Vec3::X),
            (Vec2::Y, Vec3::Y),
            (Vec2::NEG_X, Vec3::NEG_X),
        ] {
            let s = seen_along(&mapped(axis, [192, 128, 192]), Vec3::NEG_Z);
            let expected = (toward + Vec3::Z).normalize();
            assert!(s.ns.distance(expected) < 1e-6, "u along {axis}: {}", s.ns);
        }
        let s = seen_along(&mapped(Vec2::X, [128, 192, 192]), Vec3::NEG_Z);
        assert!(
            s.ns.distance((Vec3::Y + Vec3::Z).normalize()) < 1e-6,
            "v: {}",
            s.ns
        );
        let flat = seen_along(&mapped(Vec2::X, [128, 128, 255]), Vec3::NEG_Z);
        assert_eq!(flat.ns, Vec3::Z, "a flat map changes nothing");
    }

    #[test]
    fn from_behind_a_bump_is_a_dent() {
        let scene = mapped(Vec2::X, [192, 128, 192]);
        let (front, back) = (seen_along(&scene, Vec3::NEG_Z), seen_along(&scene, Vec3::Z));
        assert!(
            front.ns.distance(-back.ns) < 1e-6,
            "{} {}",
            front.ns,
            back.ns
        );
        assert_eq!(
            back.ng,
            Vec3::NEG_Z,
            "the geometric normal is on the viewer's side"
        );
    }

    #[test]
    fn the_shading_normal_faces_the_viewer_and_stays_outside() {
        let steep = mapped(Vec2::X, [255, 128, 120]);
        for direction in [
            Vec3::new(1.0, 0.0, -0.01),
            Vec3::new(-1.0, 0.0, -0.01),
            Vec3::new(1.0, 0.0, 0.01),
            Vec3::new(1.0, 0.3, 0.0),
            Vec3::NEG_Z,
        ] {
            let s = seen_along(&steep, direction);
            let wo = -direction.normalize();
            assert!(
                s.ns.dot(wo) > 0.0,
                "along {direction}: {} away from the viewer",
                s.ns
            );
            assert!(
                s.ns.dot(s.ng) > 0.0,
                "along {direction}: {} below {}",
                s.ns,
                s.ng
            );
            assert!((s.ns.length() - 1.0).abs() < 1e-6, "unit");
        }
    }

    #[test]
    fn without_texture_coordinates_a_map_has_no_effect() {
        let mut scene = mapped(Vec2::X, [192, 128, 192]);
        scene.mesh.uvs = vec![Vec2::ZERO; 3];
        assert_eq!(seen_along(&scene, Vec3::NEG_Z).ns, Vec3::Z, "no extent");
        scene.mesh.uv_indices.clear();
        assert_eq!(seen_along(&scene, Vec3::NEG_Z).ns, Vec3::Z, "none at all");
    }
}
