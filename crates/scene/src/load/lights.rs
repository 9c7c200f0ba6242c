//! The `lights` list of `scene.ron`.

use crate::load::scene_file::{LightEntry, PointLight};
use crate::load::{SceneText, unreadable};
use crate::{Emitter, LoadNotes, SceneError};

/// Reads all lights, in file order; those without power are counted and left out.
pub(super) fn read(
    entries: &[LightEntry],
    scene: &SceneText<'_>,
    notes: &mut LoadNotes,
) -> Result<Vec<Emitter>, SceneError> {
    let mut lights = Vec::new();
    for (i, entry) in entries.iter().enumerate() {
        let field = format!("lights[{i}]");
        let unsupported = match entry {
            LightEntry::Points(file) => {
                lights.extend(points(scene, &field, file)?);
                continue;
            }
            &LightEntry::Point {
                position,
                intensity,
            } => {
                lights.push(PointLight {
                    position,
                    intensity,
                });
                continue;
            }
            LightEntry::Spot { .. } => "Spot lights are",
            LightEntry::Directional { .. } => "Directional lights are",
            LightEntry::Emissive => "Emissive lights (triangles whose material emits) are",
            LightEntry::Environment { .. } => "Environment lights are",
        };
        let expected = "expected Points(\"lights.ron\") or Point(position: …, intensity: …)";
        let message = format!("{unsupported} not supported yet; {expected}");
        return Err(scene.error(&field, message));
    }
    let all = lights.len();
    lights.retain(|light| light.intensity.0.max_element() > 0.0);
    notes.zero_power_lights += all - lights.len();
    let emitters = lights.iter().map(|light| Emitter::Point {
        position: light.position.0,
        intensity: light.intensity.0,
    });
    Ok(emitters.collect())
}

/// The lights in `file`, which `field` of the scene names.
fn points(scene: &SceneText<'_>, field: &str, file: &str) -> Result<Vec<PointLight>, SceneError> {
    let (source, name) = scene.resolve(field, file)?;
    let bytes = source.read(&name);
    let bytes = bytes.map_err(|e| scene.error(field, unreadable(&source, &name, &e)))?;
    let shown = source.shown(&name);
    let text = ron_file::text(&shown, &bytes)?;
    Ok(ron_file::parse(&shown, text, &[], &[])?)
}
