//! The `lights` list of `scene.ron`.

use crate::load::environment;
use crate::load::scene_file::{LightEntry, PointLight};
use crate::load::{SceneText, unreadable};
use crate::{Emitter, Environment, LoadNotes, SceneError};

/// What the list asks for.
#[derive(Debug, Default)]
pub(super) struct Lights {
    /// In file order.
    pub(super) emitters: Vec<Emitter>,
    /// Whether triangles whose material emits are lights.
    pub(super) emissive: bool,
    pub(super) environment: Option<Environment>,
}

/// Reads all lights; `from_files` are those of the geometry files, in photometric units. Those without power are counted and left out.
pub(super) fn read(
    entries: &[LightEntry],
    scene: &SceneText<'_>,
    from_files: &[Emitter],
    notes: &mut LoadNotes,
) -> Result<Lights, SceneError> {
    let mut used_files = from_files.is_empty();
    let mut lights = Lights::default();
    let mut environment_at = None;
    for (i, entry) in entries.iter().enumerate() {
        let field = format!("lights[{i}]");
        match entry {
            LightEntry::Points(file) => {
                let points = points(scene, &field, file)?;
                lights.emitters.extend(points.iter().map(point));
            }
            &LightEntry::Point {
                position,
                intensity,
            } => lights.emitters.push(point(&PointLight {
                position,
                intensity,
            })),
            LightEntry::Spot {
                position,
                direction,
                intensity,
                cos_inner,
                cos_outer,
            } => {
                if cos_inner.0 < cos_outer.0 {
                    let message = format!(
                        "found {}; expected at least cos_outer, which is {}",
                        cos_inner.0, cos_outer.0
                    );
                    return Err(scene.error(&format!("{field}.cos_inner"), message));
                }
                lights.emitters.push(Emitter::Spot {
                    position: position.0,
                    direction: direction.0,
                    intensity: intensity.0,
                    cos_inner: cos_inner.0,
                    cos_outer: cos_outer.0,
                });
            }
            LightEntry::Directional {
                direction,
                irradiance,
            } => lights.emitters.push(Emitter::Directional {
                direction: direction.0,
                irradiance: irradiance.0,
            }),
            LightEntry::FromFile { lumens_per_watt } => {
                used_files = true;
                let scale = lumens_per_watt.0.recip();
                let converted = from_files.iter().map(|light| scaled(light, scale));
                lights.emitters.extend(converted);
            }
            LightEntry::Emissive => lights.emissive = true,
            LightEntry::Environment {
                radiance,
                image,
                scale,
            } => {
                if let Some(first) = environment_at.replace(i) {
                    let message = format!(
                        "a second environment beside lights[{first}]; expected one at most"
                    );
                    return Err(scene.error(&field, message));
                }
                lights.environment = match (radiance, image) {
                    (Some(radiance), None) if scale.is_none() => Environment::constant(radiance.0),
                    (None, Some(image)) => {
                        let scale = scale.as_ref().map_or(1.0, |scale| scale.0);
                        environment::load(scene, &format!("{field}.image"), image, scale)?
                    }
                    _ => {
                        let message = "expected Environment(radiance: (r, g, b)) or \
                             Environment(image: \"sky.exr\", scale: 1.0)";
                        return Err(scene.error(&field, message));
                    }
                };
                notes.black_environments += usize::from(lights.environment.is_none());
            }
        }
    }
    if !used_files {
        notes.remarks.push(format!(
            "{} lights of geometry files are not among the scene's lights: `FromFile` would be",
            from_files.len()
        ));
    }
    let all = lights.emitters.len();
    lights.emitters.retain(has_power);
    notes.zero_power_lights += all - lights.emitters.len();
    Ok(lights)
}

fn point(light: &PointLight) -> Emitter {
    Emitter::Point {
        position: light.position.0,
        intensity: light.intensity.0,
    }
}

/// A light times `scale`.
fn scaled(light: &Emitter, scale: f32) -> Emitter {
    let mut light = *light;
    match &mut light {
        Emitter::Point { intensity, .. } | Emitter::Spot { intensity, .. } => *intensity *= scale,
        Emitter::Directional { irradiance, .. } => *irradiance *= scale,
        Emitter::Triangle { radiance, .. } => *radiance *= scale,
    }
    light
}

fn has_power(emitter: &Emitter) -> bool {
    let colour = match *emitter {
        Emitter::Point { intensity, .. } => intensity,
        // A cone of angle 0 lets no light out.
        Emitter::Spot { cos_outer, .. } if cos_outer >= 1.0 => return false,
        Emitter::Spot { intensity, .. } => intensity,
        Emitter::Directional { irradiance, .. } => irradiance,
        Emitter::Triangle { radiance, .. } => radiance,
    };
    colour.max_element() > 0.0
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
