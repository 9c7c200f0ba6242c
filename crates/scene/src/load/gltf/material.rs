//! Materials: metallic-roughness, as the renderer has it too.

use std::collections::BTreeMap;

use glam::{Mat2, Vec2, Vec3};
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::material::AlphaMode;
use gltf::json::texture::WrappingMode;
use gltf::json::validation::Checked;
use procedural::SceneFile;

use super::data::{Data, Resource, item, resource};
use crate::brdf::LEAST_ALPHA;
use crate::load::source::Source;
use crate::load::{Parts, texture};
use crate::{Channel, Material, MaterialId, TextureId};

/// Which texture coordinates a material's textures are looked up at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Coordinates {
    /// `TEXCOORD_…`.
    pub(super) set: u32,
    matrix: Mat2,
    offset: Vec2,
}

impl Coordinates {
    /// Of a set and `KHR_texture_transform`, which may name another set.
    fn new(set: u32, transform: Option<&TextureTransform>) -> Self {
        let Some(transform) = transform else {
            return Self {
                set,
                matrix: Mat2::IDENTITY,
                offset: Vec2::ZERO,
            };
        };
        // The image lies with v downward, where turning counter-clockwise has the other sign.
        let turn = Mat2::from_angle(-transform.rotation.0);
        Self {
            set: transform.tex_coord.unwrap_or(set),
            matrix: turn * Mat2::from_diagonal(Vec2::from(transform.scale.0)),
            offset: Vec2::from(transform.offset.0),
        }
    }

    /// Coordinates with v upward of those in the file, whose v points down.
    pub(super) fn apply(&self, uv: [f32; 2]) -> Vec2 {
        let uv = self.matrix * Vec2::from(uv) + self.offset;
        Vec2::new(uv.x, 1.0 - uv.y)
    }
}

/// A material of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    pub(super) id: MaterialId,
    /// `None` where it has no texture.
    pub(super) coordinates: Option<Coordinates>,
}

/// Adds all materials to `parts`; in the file's order.
pub(super) fn read(
    parts: &mut Parts,
    data: &Data<'_>,
    source: &Source,
    name: &str,
) -> Result<Vec<Look>, String> {
    let mut images = Images {
        data,
        source,
        name,
        ids: BTreeMap::new(),
        repeated: 0,
    };
    let mut looks = Vec::new();
    for (i, from) in data.root.materials.iter().enumerate() {
        let look = material(parts, &mut images, i, from);
        looks.push(look.map_err(|message| match &from.name {
            Some(name) => format!("{message} (material `{name}`)"),
            None => message,
        })?);
    }
    if images.repeated > 0 {
        let (shown, count) = (source.shown(name), images.repeated);
        parts.notes.remarks.push(format!(
            "{shown}: {count} uses of textures that should be clamped or mirrored beyond their edges: all are repeated"
        ));
    }
    Ok(looks)
}

fn material(
    parts: &mut Parts,
    images: &mut Images<'_>,
    index: usize,
    from: &gltf::json::Material,
) -> Result<Look, String> {
    let field = format!("materials[{index}]");
    let shown = images.source.shown(images.name);
    let pbr = &from.pbr_metallic_roughness;
    let at = |key: &str| format!("{field}.pbrMetallicRoughness.{key}");
    let [r, g, b, alpha] = pbr.base_color_factor.0;
    for factor in pbr.base_color_factor.0 {
        share(factor, &at("baseColorFactor"))?;
    }
    let roughness = share(pbr.roughness_factor.0, &at("roughnessFactor"))?;
    let metallic = share(pbr.metallic_factor.0, &at("metallicFactor"))?;

    let mut coordinates: Option<Coordinates> = None;
    let mut texture = |parts: &mut Parts, key: &str, index, used: Coordinates| {
        let field = format!("{field}.{key}");
        let first = *coordinates.get_or_insert(used);
        if first != used {
            parts.notes.remarks.push(format!(
                "{shown}: {field} has texture coordinates of its own: it is shown with those of the material's \
                 first texture"
            ));
        }
        images.id(parts, index, &field)
    };
    let info = |info: &gltf::json::texture::Info| {
        let extensions = info.extensions.as_ref();
        let transform = extensions.and_then(|e| e.texture_transform.as_ref());
        (
            info.index.value(),
            Coordinates::new(info.tex_coord, transform),
        )
    };
    let mut info_texture = |parts: &mut Parts, key, from: &Option<gltf::json::texture::Info>| {
        let from = from.as_ref().map(info);
        from.map(|(index, used)| texture(parts, key, index, used))
            .transpose()
    };
    let diffuse_map = info_texture(parts, "baseColorTexture", &pbr.base_color_texture)?;
    let rough_metal = info_texture(
        parts,
        "metallicRoughnessTexture",
        &pbr.metallic_roughness_texture,
    )?;
    let emission_map = info_texture(parts, "emissiveTexture", &from.emissive_texture)?;
    let (normal_map, normal_scale) = match &from.normal_texture {
        Some(normal) => {
            let used = Coordinates::new(normal.tex_coord, None);
            let map = texture(parts, "normalTexture", normal.index.value(), used)?;
            (Some(map), normal.scale)
        }
        None => (None, 1.0),
    };
    if !normal_scale.is_finite() {
        return Err(format!(
            "{field}.normalTexture.scale: found {normal_scale}; expected a finite number"
        ));
    }
    let strength = from
        .extensions
        .as_ref()
        .and_then(|e| e.emissive_strength.as_ref());
    let strength = strength.map_or(1.0, |strength| strength.emissive_strength.0);
    let emission = Vec3::from(from.emissive_factor.0) * strength;
    if !emission.is_finite() || emission.min_element() < 0.0 {
        return Err(format!(
            "{field}.emissiveFactor: found {:?} times {strength}; expected finite numbers, none negative",
            from.emissive_factor.0
        ));
    }

    let (opacity, opacity_map) = match from.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) => (1.0, None),
        Checked::Valid(mode) => {
            let cutoff = match mode {
                AlphaMode::Mask => from.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0),
                _ => 0.5,
            };
            if !(cutoff >= 0.0 && cutoff.is_finite()) {
                return Err(format!(
                    "{field}.alphaCutoff: found {cutoff}; expected a finite number, not negative"
                ));
            }
            match cutoff > 0.0 {
                // Below the cut-off is below one half.
                true => ((0.5 * alpha / cutoff).min(f32::MAX), diffuse_map),
                false => (1.0, None),
            }
        }
        Checked::Invalid => {
            return Err(format!("{field}.alphaMode: expected OPAQUE, MASK or BLEND"));
        }
    };
    let name = match &from.name {
        Some(name) => name.clone(),
        None => field.clone(),
    };
    if from.alpha_mode == Checked::Valid(AlphaMode::Blend) {
        parts.notes.remarks.push(format!(
            "{shown}: material `{name}` blends: it is cut out where its alpha is below one half"
        ));
    }
    let id = parts.materials.len();
    if opacity_map.is_some() {
        parts.alpha_maps.push(id);
    }
    let channel = |index| move |texture| Channel { texture, index };
    parts.materials.push(Material {
        name,
        diffuse: Vec3::new(r, g, b),
        diffuse_map,
        specular: Vec3::ZERO,
        alpha: (roughness * roughness).max(LEAST_ALPHA),
        metallic: Some(metallic),
        roughness_map: rough_metal.map(channel(1)),
        metallic_map: rough_metal.map(channel(2)),
        normal_map,
        normal_scale,
        emission,
        emission_map,
        opacity,
        opacity_map,
    });
    Ok(Look {
        // Fewer than the bytes of the file.
        id: MaterialId(u32::try_from(id).unwrap_or(u32::MAX)),
        coordinates,
    })
}

fn share(found: f32, field: &str) -> Result<f32, String> {
    match (0.0..=1.0).contains(&found) {
        true => Ok(found),
        false => Err(format!("{field}: found {found}; expected 0 to 1")),
    }
}

/// The images of the file that are in use.
struct Images<'a> {
    data: &'a Data<'a>,
    source: &'a Source,
    /// The glTF file's.
    name: &'a str,
    ids: BTreeMap<usize, TextureId>,
    /// Textures with edges that should not be repeated.
    repeated: usize,
}

impl Images<'_> {
    /// The image of a texture, which `field` names.
    fn id(&mut self, parts: &mut Parts, texture: usize, field: &str) -> Result<TextureId, String> {
        let root = self.data.root;
        let texture = item(&root.textures, texture, &format!("{field}.index"))?;
        if let Some(sampler) = texture.sampler {
            let sampler = item(&root.samplers, sampler.value(), "textures: sampler")?;
            let repeats = |mode| mode == Checked::Valid(WrappingMode::Repeat);
            let all = repeats(sampler.wrap_s) && repeats(sampler.wrap_t);
            self.repeated += usize::from(!all);
        }
        let index = texture.source.value();
        if let Some(&id) = self.ids.get(&index) {
            return Ok(id);
        }
        let image = item(&root.images, index, "textures: source")?;
        let place = format!("images[{index}]");
        let held = |bytes: Vec<u8>| {
            let folder = self.source.shown(self.name);
            let name = place.clone();
            let files = [SceneFile { name, bytes }].into();
            (Source::Memory { folder, files }, place.clone())
        };
        let (source, name) = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                let found = resource(self.name, uri);
                match found.map_err(|message| format!("{place}.uri: {message}"))? {
                    Resource::Data(bytes) => held(bytes),
                    Resource::File(name) => (self.source.clone(), name),
                }
            }
            (None, Some(view)) => {
                let (bytes, _) = self
                    .data
                    .view(view.value(), &format!("{place}.bufferView"))?;
                held(bytes.to_vec())
            }
            (None, None) => return Err(format!("{place}: expected a uri or a bufferView")),
        };
        let id = parts.textures.id(texture::Wanted {
            shown: source.shown(&name),
            source,
            name,
            named_by: format!("{}: {field}: {place}", self.source.shown(self.name)),
        });
        self.ids.insert(index, id);
        Ok(id)
    }
}
