//! Surfaces that are not there: opacity below one half.

use glam::Vec2;

use crate::{ABSENT, Scene, Texture};

/// What it takes to decide whether a hit on a triangle counts.
#[derive(Debug, Default)]
pub(crate) struct Cutouts {
    /// One a mesh triangle; empty when no material has an opacity of any kind.
    masks: Vec<Mask>,
    /// (constant opacity, map) of the materials that have a map.
    maps: Vec<(f32, Texture)>,
}

#[derive(Debug, Clone, Copy)]
enum Mask {
    Solid,
    Gone,
    Mapped { map: u32, uvs: [Vec2; 3] },
}

impl Cutouts {
    pub(crate) fn of(scene: &Scene) -> Self {
        let mut maps = Vec::new();
        let by_material: Vec<Mask> = scene
            .materials
            .iter()
            .map(|m| match m.opacity_map {
                _ if m.opacity < 0.5 => Mask::Gone,
                Some(id) => {
                    maps.push((m.opacity, scene.textures[id.0 as usize].clone()));
                    Mask::Mapped {
                        map: maps.len() as u32 - 1,
                        uvs: [Vec2::ZERO; 3],
                    }
                }
                None => Mask::Solid,
            })
            .collect();
        if by_material.iter().all(|m| matches!(m, Mask::Solid)) {
            return Self::default();
        }
        let mesh = &scene.mesh;
        let masks = (0..mesh.len())
            .map(|t| match by_material[mesh.materials[t].0 as usize] {
                Mask::Mapped { map, .. } => match mesh.uv_indices.get(t) {
                    Some(uv) if uv[0] != ABSENT => Mask::Mapped {
                        map,
                        uvs: uv.map(|i| mesh.uvs[i as usize]),
                    },
                    // Without coordinates the map cannot be looked up.
                    _ => Mask::Solid,
                },
                other => other,
            })
            .collect();
        Self { masks, maps }
    }

    /// Whether rays can never meet triangle `t`.
    pub(crate) fn is_gone(&self, t: usize) -> bool {
        matches!(self.masks.get(t), Some(Mask::Gone))
    }

    /// Whether hits on triangle `t` depend on where they are.
    pub(crate) fn is_mapped(&self, t: usize) -> bool {
        matches!(self.masks.get(t), Some(Mask::Mapped { .. }))
    }

    pub(crate) fn any(&self) -> bool {
        !self.masks.is_empty()
    }

    /// Whether triangle `id` is there at the barycentric weights `u`, `v` of its second and third corner.
    #[cold]
    pub(crate) fn is_solid(&self, id: u32, u: f32, v: f32) -> bool {
        match self.masks[id as usize] {
            Mask::Solid => true,
            Mask::Gone => false,
            Mask::Mapped { map, uvs } => {
                let uv = uvs[0] * (1.0 - u - v) + uvs[1] * u + uvs[2] * v;
                let (opacity, texture) = &self.maps[map as usize];
                opacity * texture.opacity(uv) >= 0.5
            }
        }
    }
}
