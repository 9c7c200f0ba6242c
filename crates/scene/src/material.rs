//! What surfaces are made of, as an MTL or glTF file says it.

use glam::Vec3;

use crate::brdf::{Brdf, Fresnel, LEAST_ALPHA};
use crate::{Channel, TextureId};

/// Index into [`Scene::materials`](crate::Scene::materials).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct MaterialId(pub u32);

/// One material; the keys named are those of MTL, and a glTF one is the same with `metallic` given. Colours are linear
/// RGB.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// `newmtl` name, or the glTF material's.
    pub name: String,
    /// `Kd`, diffuse reflectance, each channel in [0, 1].
    pub diffuse: Vec3,
    /// `map_Kd`; multiplies `diffuse`.
    pub diffuse_map: Option<TextureId>,
    /// `Ks`, specular reflectance, each channel in [0, 1]; with `diffuse`, no channel sums above 1. With a
    /// `diffuse_map` that holds at each point: see [`Scene::surface`](crate::Scene::surface). Without effect where
    /// `metallic` says what is reflected.
    pub specular: Vec3,
    /// GGX roughness α of what is specular, in [0.001, 1]: from `Ns` by [`alpha_of_exponent`], or the square
    /// of `Pr`.
    pub alpha: f32,
    /// `Pm`, in [0, 1]; given where the file has `Pr` or `Pm`. The surface is then a mix of a dielectric (a clear coat
    /// of index 1.5 over `diffuse`) at 0 and of a metal that reflects `diffuse` at 1.
    pub metallic: Option<f32>,
    /// `map_Pr`, or the green of glTF's metallicRoughnessTexture: multiplies the roughness, so its square multiplies
    /// `alpha`.
    pub roughness_map: Option<Channel>,
    /// `map_Pm`, or the blue of glTF's metallicRoughnessTexture; multiplies `metallic`.
    pub metallic_map: Option<Channel>,
    /// `norm`, or `map_Bump` where that is a normal map: shading normals in tangent space.
    pub normal_map: Option<TextureId>,
    /// What the normal map's slopes are multiplied by, finite; glTF's `scale`, 1 otherwise.
    pub normal_scale: f32,
    /// `Ke`, emitted radiance, W/sr/m², finite and not negative.
    pub emission: Vec3,
    /// `map_Ke`; multiplies `emission`.
    pub emission_map: Option<TextureId>,
    /// `d`, or half of glTF's alpha over its cut-off; not negative. Below ½ the surface is not there.
    pub opacity: f32,
    /// `map_d`: where its value times `opacity` is below ½ the surface is not there.
    pub opacity_map: Option<TextureId>,
}

/// GGX roughness of a highlight about as wide as that of a Phong lobe: α = √(2 / (`Ns` + 2)), the value at which
/// both distributions of facet normals have the same peak; at least 0.001.
pub fn alpha_of_exponent(exponent: f32) -> f32 {
    (2.0 / (exponent + 2.0)).sqrt().clamp(LEAST_ALPHA, 1.0)
}

/// What a material's maps, and for `diffuse` vertex colours too, hold at one point; 1 where there is none.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Texels {
    pub(crate) diffuse: Vec3,
    pub(crate) roughness: f32,
    pub(crate) metallic: f32,
}

/// Reflectance along the normal of a dielectric of index 1.5.
const DIELECTRIC: f32 = 0.04;

impl Material {
    /// Whether any of its points has a specular lobe.
    pub fn is_glossy(&self) -> bool {
        self.specular != Vec3::ZERO || self.metallic.is_some()
    }

    /// Reflection where the maps have `texels`; never more than arrives.
    pub(crate) fn brdf(&self, texels: &Texels) -> Brdf {
        let base = self.diffuse * texels.diffuse;
        let alpha = match self.roughness_map {
            Some(_) => (self.alpha * texels.roughness * texels.roughness).max(LEAST_ALPHA),
            None => self.alpha,
        };
        match self.metallic {
            Some(factor) => {
                let metallic = factor * texels.metallic;
                Brdf {
                    diffuse: base * (1.0 - metallic),
                    specular: Vec3::splat(DIELECTRIC).lerp(base, metallic),
                    alpha,
                    fresnel: Fresnel::Schlick,
                }
            }
            None => {
                // Loading limits Kd + Ks where there is no map; a bright texel is limited here.
                let scale = (base + self.specular).max(Vec3::ONE).recip();
                Brdf {
                    diffuse: base * scale,
                    specular: self.specular * scale,
                    alpha,
                    fresnel: Fresnel::Constant,
                }
            }
        }
    }
}

impl Default for Material {
    /// Grey, for faces that name no material.
    fn default() -> Self {
        Self {
            name: "default".into(),
            diffuse: Vec3::splat(0.5),
            diffuse_map: None,
            specular: Vec3::ZERO,
            alpha: 1.0,
            metallic: None,
            roughness_map: None,
            metallic_map: None,
            normal_map: None,
            normal_scale: 1.0,
            emission: Vec3::ZERO,
            emission_map: None,
            opacity: 1.0,
            opacity_map: None,
        }
    }
}
