//! Rays like those of a render: ten shadow rays from each point that the camera sees to points where light would be after a
//! bounce, and diffuse bounces. Raced against Embree's, and measured by `cargo bench -p manylight-scene`.

use glam::Vec3;
use manylight_scene::trace::{Ray, Tracer};
use manylight_scene::{Camera, Scene, Surface};
use sampling::{Purpose, Rng, cosine_hemisphere};

const WIDTH: u32 = 320;
const HEIGHT: u32 = 180;
const SHADOW_RAYS: usize = 10;
const BOUNCES: usize = 4;

/// What is traced.
pub(crate) struct Rays {
    pub(crate) shadow: Vec<Ray>,
    pub(crate) bounce: Vec<Ray>,
}

pub(crate) fn rays_of(scene: &Scene, tracer: &Tracer) -> Rays {
    let camera = Camera::new(&scene.camera, WIDTH, HEIGHT);
    let mut rng = Rng::new(1, 0, 0, Purpose::Build);
    let surface = |ray: &Ray| -> Option<Surface> {
        let hit = tracer.closest(ray)?;
        Some(scene.surface(&hit, ray.direction))
    };
    let from = |origin, direction| Ray {
        origin,
        direction,
        t_max: f32::INFINITY,
    };
    let mut seen = Vec::new();
    for pixel in 0..WIDTH * HEIGHT {
        let (x, y) = ((pixel % WIDTH) as f32, (pixel / WIDTH) as f32);
        seen.extend(surface(&from(
            camera.origin(),
            camera.direction(x + rng.f32(), y + rng.f32()),
        )));
    }
    let mut bounce = Vec::new();
    for s in &seen {
        let (right, up) = s.ng.any_orthonormal_pair();
        for _ in 0..BOUNCES {
            let (d, _) = cosine_hemisphere([rng.f32(), rng.f32()]);
            bounce.push(from(s.ray_origin(), right * d.x + up * d.y + s.ng * d.z));
        }
    }
    let lights: Vec<Surface> = bounce.iter().step_by(BOUNCES).filter_map(surface).collect();
    let mut shadow = Vec::new();
    for s in &seen {
        let faces = |light: &&Surface| {
            let to: Vec3 = light.position - s.position;
            to.dot(s.ng) > 0.0 && to.dot(light.ng) < 0.0
        };
        let drawn: Vec<&Surface> = (0..8 * SHADOW_RAYS)
            .map(|_| &lights[(f64::from(rng.f32()) * lights.len() as f64) as usize % lights.len()])
            .filter(faces)
            .take(SHADOW_RAYS)
            .collect();
        shadow.extend(
            drawn
                .iter()
                .map(|light| Ray::between(s.ray_origin(), light.ray_origin())),
        );
    }
    Rays { shadow, bounce }
}
