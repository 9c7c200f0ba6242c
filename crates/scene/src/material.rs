//! What surfaces are made of, as the MTL file says it.

use glam::Vec3;

use crate::TextureId;

/// Index into [`Scene::materials`](crate::Scene::materials).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct MaterialId(pub u32);

/// One MTL material. Colours are linear RGB.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// `newmtl` name.
    pub name: String,
    /// `Kd`, diffuse reflectance, each channel in [0, 1].
    pub diffuse: Vec3,
    /// `map_Kd`; multiplies `diffuse`.
    pub diffuse_map: Option<TextureId>,
    /// `Ks`, specular reflectance, each channel in [0, 1]; with `diffuse`, no channel sums above 1. With a
    /// `diffuse_map` that holds at each point: see [`Scene::surface`](crate::Scene::surface).
    pub specular: Vec3,
    /// `Ns`, Phong exponent, in [0, 1e6].
    pub exponent: f32,
    /// `Ke`, emitted radiance, W/sr/m², finite and not negative.
    pub emission: Vec3,
    /// `map_Ke`; multiplies `emission`.
    pub emission_map: Option<TextureId>,
    /// `d`, in [0, 1]; below ½ the surface is not there.
    pub opacity: f32,
    /// `map_d`: where its value times `opacity` is below ½ the surface is not there.
    pub opacity_map: Option<TextureId>,
}

impl Default for Material {
    /// Grey, for faces that name no material.
    fn default() -> Self {
        Self {
            name: "default".into(),
            diffuse: Vec3::splat(0.5),
            diffuse_map: None,
            specular: Vec3::ZERO,
            exponent: 1.0,
            emission: Vec3::ZERO,
            emission_map: None,
            opacity: 1.0,
            opacity_map: None,
        }
    }
}
