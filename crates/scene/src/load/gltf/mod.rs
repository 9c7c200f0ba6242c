//! glTF 2.0 files, as JSON beside buffers or as GLB.
//!
//! Read: meshes with the transforms of their nodes (each instance is a copy), metallic-roughness materials, textures
//! in files, data URIs and buffers, vertex colours, `KHR_lights_punctual`, `KHR_materials_emissive_strength`,
//! `KHR_texture_transform`, `KHR_mesh_quantization`, `KHR_node_visibility`, and the first camera in perspective. Both sides of a surface are
//! shaded whatever `doubleSided` says, as in Blender's own renderers. Tangents of normal maps come from the texture
//! coordinates.

mod data;
mod geometry;
mod material;
mod nodes;
mod outline;

use gltf::binary::Glb;
use gltf::json::Root;

use crate::SceneError;
use crate::load::Parts;
use crate::load::source::Source;
use data::Data;
use outline::Outline;

/// Extensions that a file may require.
const SUPPORTED: [&str; 5] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Adds the file called `name` to `parts`.
pub(super) fn read(
    parts: &mut Parts,
    source: &Source,
    name: &str,
    bytes: &[u8],
) -> Result<(), SceneError> {
    let shown = source.shown(name);
    let wrong = |message: String| SceneError::file(&shown, message);
    let (json, blob) = match bytes.starts_with(b"glTF") {
        true => container(bytes).map_err(wrong)?,
        false => (bytes, None),
    };
    let wrong_json = |e: serde_json::Error| {
        let (line, column) = (e.line(), e.column());
        let message = e.to_string();
        // It ends with the place, which comes first here.
        let message = message.split(" at line ").next().unwrap_or_default();
        SceneError::file(&format!("{shown}:{line}:{column}"), message)
    };
    let outline = Outline::read(json).map_err(wrong_json)?;
    let (json, animations) = outline.without_animations(json);
    let root = Root::from_slice(&json).map_err(wrong_json)?;
    let version = &root.asset.version;
    if !version.starts_with("2.") {
        return Err(wrong(format!(
            "asset.version: found {version:?}; expected 2.0"
        )));
    }
    let unsupported = |name: &&String| !SUPPORTED.contains(&name.as_str());
    if let Some(extension) = root.extensions_required.iter().find(unsupported) {
        let supported = SUPPORTED.join(", ");
        return Err(wrong(format!(
            "extensionsRequired: {extension} is not supported; supported are {supported}"
        )));
    }
    if animations > 0 {
        let remark = format!("{shown}: {animations} animations have no effect");
        parts.notes.remarks.push(remark);
    }
    add(parts, source, name, &root, &outline, blob).map_err(wrong)
}

/// The JSON and the binary part of a GLB.
fn container(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    // What the crate subtracts without a check.
    let length = bytes.get(8..12).and_then(|length| length.first_chunk());
    let length = length.map_or(0, |&length| u32::from_le_bytes(length));
    if length < 12 {
        return Err(format!(
            "found {length} as the length of a GLB; expected at least 12"
        ));
    }
    let glb = Glb::from_slice(bytes).map_err(|e| format!("GLB: {e}"))?;
    let (start, json) = (20, glb.json.len());
    // The parts borrow from the container: their place is fixed by the format.
    let bin = glb.bin.as_ref().map(|bin| {
        let from = start + json + 8;
        &bytes[from..from + bin.len()]
    });
    Ok((&bytes[start..start + json], bin))
}

fn add(
    parts: &mut Parts,
    source: &Source,
    name: &str,
    root: &Root,
    outline: &Outline<'_>,
    blob: Option<&[u8]>,
) -> Result<(), String> {
    let data = Data::read(root, blob, source, name)?;
    let placed = nodes::place(root, outline)?;
    let looks = material::read(parts, &data, source, name)?;
    let ignored = geometry::read(parts, &data, &looks, &placed.meshes)?;
    parts.lights.extend(placed.lights);
    parts.camera = parts.camera.or(placed.camera);
    let shown = source.shown(name);
    for (count, what) in [
        (
            ignored.points_and_lines,
            "primitives of points or lines are left out",
        ),
        (
            ignored.morph_targets,
            "primitives have morph targets, which have no effect",
        ),
        (
            ignored.without_coordinates,
            "primitives lack the texture coordinates of their material: textures are one texel there",
        ),
        (placed.skinned, "meshes have skins, which have no effect"),
    ] {
        if count > 0 {
            parts.notes.remarks.push(format!("{shown}: {count} {what}"));
        }
    }
    for extension in &root.extensions_used {
        if !SUPPORTED.contains(&extension.as_str()) {
            let remark = format!("{shown}: the extension {extension} has no effect");
            parts.notes.remarks.push(remark);
        }
    }
    Ok(())
}
