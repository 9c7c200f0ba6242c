//! The same light in double precision, by the shortest way: every triangle and every light, for each ray.
//!
//! It knows matte surfaces, point, spot and parallel lights. Positions, colours and camera rays are those of the
//! renderer, and everything that follows from them is computed anew, so that what differs is the renderer's rounding.

use gather::RenderSpec;
use glam::DVec3;
use light_tree::{LightKind, LightSet};
use sampling::{Purpose, Rng};
use scene::{Camera, Scene};

use crate::room::Built;

/// Mean radiance over the picture that all lights are to have, or `None` where this is not known here.
pub(crate) fn mean(built: &Built, spec: &RenderSpec) -> Option<DVec3> {
    let lights = &built.inputs.lights;
    let simple = [LightKind::Omni, LightKind::Spot, LightKind::Directional];
    let known: usize = simple.iter().map(|kind| lights.count(*kind)).sum();
    if known != lights.len() || built.scene.materials.iter().any(|m| m.is_glossy()) {
        return None;
    }
    let camera = Camera::new(&built.scene.camera, spec.width, spec.height);
    let origin = camera.origin().as_dvec3();
    let mut sum = DVec3::ZERO;
    for pixel in 0..spec.width * spec.height {
        let (x, y) = (pixel % spec.width, pixel / spec.width);
        for sample in 0..spec.spp {
            let mut rng = Rng::new(spec.seed, u64::from(pixel), u64::from(sample), Purpose::Eye);
            let [dx, dy] = [rng.f32(), rng.f32()];
            let direction = camera.direction(x as f32 + dx, y as f32 + dy);
            sum += radiance(&built.scene, lights, origin, direction.as_dvec3());
        }
    }
    Some(sum / f64::from(spec.width * spec.height * spec.spp))
}

fn radiance(scene: &Scene, lights: &LightSet, origin: DVec3, direction: DVec3) -> DVec3 {
    let triangles = 0..scene.mesh.len();
    let hits = triangles.filter_map(|t| Some((meet(scene, t, origin, direction)?, t)));
    let nearest = hits
        .filter(|(t, _)| *t > 0.0)
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((distance, triangle)) = nearest else {
        return DVec3::ZERO;
    };
    let at = origin + direction * distance;
    let [a, b, c] = scene.mesh.corners(triangle).map(|p| p.as_dvec3());
    let normal = (b - a).cross(c - a).normalize();
    let normal = -normal * normal.dot(direction).signum();
    let material = &scene.materials[scene.mesh.materials[triangle].0 as usize];
    let corners = scene.mesh.positions.iter();
    let farthest = corners.map(|p| p.as_dvec3().length()).fold(0.0, f64::max);
    let beyond = 3.0 * (farthest + at.length());
    let mut sum = DVec3::ZERO;
    for id in lights.ids() {
        let colour = lights.intensity(id).as_dvec3();
        let axis = lights.axis(id).as_dvec3();
        let (offset, falloff) = match lights.kind(id) {
            // From beyond the scene.
            LightKind::Directional => (-axis * beyond, beyond * beyond),
            kind => {
                let offset = lights.position(id).as_dvec3() - at;
                let along = -axis.dot(offset.normalize_or_zero());
                let spot = kind == LightKind::Spot;
                (
                    offset,
                    if spot {
                        falloff(lights, id, along)
                    } else {
                        1.0
                    },
                )
            }
        };
        let distance2 = offset.length_squared();
        let cos = normal.dot(offset) / distance2.sqrt();
        if cos <= 0.0 || falloff <= 0.0 {
            continue;
        }
        let others = (0..scene.mesh.len()).filter(|t| *t != triangle);
        let blocked = others
            .filter_map(|t| meet(scene, t, at, offset))
            .any(|t| t > 1e-12 && t < 1.0 - 1e-6);
        if !blocked {
            sum += colour * (falloff * cos / distance2);
        }
    }
    sum * material.diffuse.as_dvec3() / std::f64::consts::PI
}

fn falloff(lights: &LightSet, id: light_tree::LightId, cos: f64) -> f64 {
    let cone = lights.spot(id);
    let (inner, outer) = (f64::from(cone.cos_inner), f64::from(cone.cos_outer));
    match cos {
        _ if cos >= inner => 1.0,
        _ if cos <= outer => 0.0,
        _ => {
            let t = (cos - outer) / (inner - outer);
            t * t * (3.0 - 2.0 * t)
        }
    }
}

/// Where the line meets triangle `t`, in multiples of `direction`; `None` beside it or along it.
fn meet(scene: &Scene, t: usize, origin: DVec3, direction: DVec3) -> Option<f64> {
    let [a, b, c] = scene.mesh.corners(t).map(|p| p.as_dvec3());
    let (ab, ac, from) = (b - a, c - a, origin - a);
    let p = direction.cross(ac);
    let determinant = ab.dot(p);
    let u = from.dot(p) / determinant;
    let q = from.cross(ab);
    let v = direction.dot(q) / determinant;
    let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
    (determinant != 0.0 && inside).then(|| ac.dot(q) / determinant)
}
