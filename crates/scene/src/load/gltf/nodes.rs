//! Nodes: where meshes, lights and cameras stand.

use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};
use gltf::json::extensions::scene::khr_lights_punctual::{Light, Type};
use gltf::json::validation::Checked;
use gltf::json::{Node, Root};

use super::data::item;
use super::outline::Outline;
use crate::load::scene_file::FARTHEST;
use crate::{CameraSpec, Emitter};

/// A mesh at a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Instance {
    pub(super) mesh: usize,
    /// For messages.
    pub(super) node: usize,
    pub(super) transform: DAffine3,
}

/// What the scene's nodes hold.
#[derive(Debug, Default)]
pub(super) struct Placed {
    /// In the scene's order.
    pub(super) meshes: Vec<Instance>,
    /// Photometric units.
    pub(super) lights: Vec<Emitter>,
    /// The first one in perspective.
    pub(super) camera: Option<CameraSpec>,
    pub(super) skinned: usize,
}

/// Follows the nodes of the file's scene that are to be seen, depth first.
pub(super) fn place(root: &Root, outline: &Outline<'_>) -> Result<Placed, String> {
    let index = root.scene.map_or(0, |scene| scene.value());
    let scene = item(&root.scenes, index, "scene")?;
    let mut placed = Placed::default();
    let mut seen = vec![false; root.nodes.len()];
    let mut work: Vec<(usize, DAffine3)> = Vec::new();
    let roots = scene.nodes.iter().rev();
    work.extend(roots.map(|node| (node.value(), DAffine3::IDENTITY)));
    while let Some((index, parent)) = work.pop() {
        let node = item(&root.nodes, index, "a node of the scene")?;
        let field = format!("nodes[{index}]");
        if std::mem::replace(&mut seen[index], true) {
            return Err(format!(
                "{field}: found twice in the scene; expected a tree of nodes"
            ));
        }
        if outline.hides(index) {
            continue;
        }
        let transform = parent * local(node, &field)?;
        if !transform.is_finite() {
            return Err(format!("{field}: the transform overflows"));
        }
        if let Some(mesh) = node.mesh {
            placed.meshes.push(Instance {
                mesh: mesh.value(),
                node: index,
                transform,
            });
            placed.skinned += usize::from(node.skin.is_some());
        }
        let extensions = node.extensions.as_ref();
        if let Some(light) = extensions.and_then(|e| e.khr_lights_punctual.as_ref()) {
            let field = format!("{field}.extensions.KHR_lights_punctual.light");
            let lights: &[Light] = root.as_ref();
            let light = item(lights, light.light.value(), &field)?;
            placed.lights.push(emitter(light, &transform, &field)?);
        }
        if let Some(camera) = node.camera.filter(|_| placed.camera.is_none()) {
            let field = format!("{field}.camera");
            let camera = item(&root.cameras, camera.value(), &field)?;
            if let Some(perspective) = &camera.perspective {
                placed.camera = Some(view(perspective.yfov, &transform, &field)?);
            }
        }
        let children = node.children.iter().flatten().rev();
        work.extend(children.map(|child| (child.value(), transform)));
    }
    Ok(placed)
}

fn local(node: &Node, field: &str) -> Result<DAffine3, String> {
    let local = match node.matrix {
        Some(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(&matrix.map(f64::from))),
        None => {
            let vector = |found: Option<[f32; 3]>, missing| {
                found.map_or(missing, |v| Vec3::from(v).as_dvec3())
            };
            let rotation = node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |q| q.0);
            let rotation = DQuat::from_array(rotation.map(f64::from));
            if rotation.length_squared() == 0.0 || !rotation.is_finite() {
                return Err(format!(
                    "{field}.rotation: found {rotation}; expected a unit quaternion"
                ));
            }
            DAffine3::from_scale_rotation_translation(
                vector(node.scale, DVec3::ONE),
                rotation.normalize(),
                vector(node.translation, DVec3::ZERO),
            )
        }
    };
    match local.is_finite() {
        true => Ok(local),
        false => Err(format!("{field}: found a transform that is not finite")),
    }
}

/// A place in `f32`; else a message.
pub(super) fn point(found: DVec3, field: &str) -> Result<Vec3, String> {
    match found.abs().max_element() <= f64::from(FARTHEST) {
        true => Ok(found.as_vec3()),
        false => Err(format!(
            "{field}: found {found:?}; expected coordinates from -{FARTHEST:e} to {FARTHEST:e}"
        )),
    }
}

fn direction(transform: &DAffine3, along: DVec3, field: &str) -> Result<DVec3, String> {
    let found = transform.transform_vector3(along).try_normalize();
    found.ok_or_else(|| format!("{field}: the node has no extent along {along}, so no direction"))
}

/// A light, which shines along −z where it has a direction. Node scales change neither intensity nor size.
fn emitter(light: &Light, transform: &DAffine3, field: &str) -> Result<Emitter, String> {
    let intensity = Vec3::from(light.color) * light.intensity;
    if !intensity.is_finite() || intensity.min_element() < 0.0 {
        return Err(format!(
            "{field}: found color {:?} times intensity {}; expected finite numbers, none negative",
            light.color, light.intensity
        ));
    }
    let position = point(transform.translation, field)?;
    let along = || direction(transform, DVec3::NEG_Z, field).map(|d| d.as_vec3());
    match light.type_ {
        Checked::Valid(Type::Point) => Ok(Emitter::Point {
            position,
            intensity,
        }),
        Checked::Valid(Type::Directional) => Ok(Emitter::Directional {
            direction: along()?,
            irradiance: intensity,
        }),
        Checked::Valid(Type::Spot) => {
            let (inner, outer) = match &light.spot {
                Some(spot) => (spot.inner_cone_angle, spot.outer_cone_angle),
                None => return Err(format!("{field}: a spot light without `spot`")),
            };
            if !(0.0 <= inner && inner <= outer && outer <= std::f32::consts::FRAC_PI_2) {
                return Err(format!(
                    "{field}: found innerConeAngle {inner} and outerConeAngle {outer}; expected 0 ≤ inner ≤ outer ≤ π/2"
                ));
            }
            Ok(Emitter::Spot {
                position,
                direction: along()?,
                intensity,
                cos_inner: inner.cos(),
                cos_outer: outer.cos(),
            })
        }
        Checked::Invalid => Err(format!(
            "{field}: expected a directional, point or spot light"
        )),
    }
}

/// A camera, which looks along −z with y upward.
fn view(yfov: f32, transform: &DAffine3, field: &str) -> Result<CameraSpec, String> {
    if !(yfov > 0.0 && yfov < std::f32::consts::PI) {
        return Err(format!(
            "{field}: found yfov {yfov}; expected radians above 0 and below π"
        ));
    }
    let origin = point(transform.translation, field)?;
    let forward = direction(transform, DVec3::NEG_Z, field)?;
    let up = direction(transform, DVec3::Y, field)?;
    if forward.cross(up).length_squared() < 1e-10 {
        return Err(format!("{field}: the node's y and z axes are parallel"));
    }
    // As far off as the eye is from the origin: rounding does not turn the view.
    let distance = transform.translation.abs().max_element().max(1.0);
    Ok(CameraSpec {
        origin,
        target: point(transform.translation + forward * distance, field)?,
        up: up.as_vec3(),
        fov_y_deg: yfov.to_degrees(),
    })
}
