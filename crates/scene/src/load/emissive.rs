//! Which triangles are lights.

use glam::{DVec2, DVec3, Vec2, Vec3};

use crate::{ABSENT, Emitter, MaterialId, Scene, Texture};

/// Texels that are looked at one by one for a triangle; where it covers more, the whole picture stands for them.
const MOST_TEXELS: f64 = 65_536.0;

/// A point that emits less than this part of the brightest gets no less of the sampling than this part.
const LEAST_SHARE: f32 = 1e-3;

/// Makes lights of all triangles whose material emits. Those that are black all over, not there, or so large that
/// their power is not finite, are counted.
pub(super) fn find(scene: &mut Scene) {
    let emits = |m: &MaterialId| scene.materials[m.0 as usize].emission.max_element() > 0.0;
    let wanted: Vec<usize> = (0..scene.mesh.len())
        .filter(|&t| emits(&scene.mesh.materials[t]))
        .collect();
    if wanted.is_empty() {
        return;
    }
    let brightest: Vec<Vec3> = scene.textures.iter().map(Texture::brightest).collect();
    // What is asked of the scene while means are taken.
    scene.emissive = vec![true; scene.mesh.len()];
    let mut emissive = vec![false; scene.mesh.len()];
    for t in wanted {
        let light = light(scene, t, &brightest).filter(|light| {
            let Emitter::Triangle { radiance, .. } = light else {
                return false;
            };
            let power = *radiance * scene.mesh.area(t) * std::f32::consts::TAU;
            power.is_finite() && power.max_element() > 0.0
        });
        match light {
            Some(light) => {
                emissive[t] = true;
                scene.emitters.push(light);
            }
            None => scene.notes.dark_emissive_triangles += 1,
        }
    }
    scene.emissive = if emissive.contains(&true) {
        emissive
    } else {
        Vec::new()
    };
}

/// The light that triangle `t` is; `None` where no point of it emits.
fn light(scene: &Scene, t: usize, brightest: &[Vec3]) -> Option<Emitter> {
    let material = &scene.materials[scene.mesh.materials[t].0 as usize];
    if material.opacity < 0.5 {
        return None;
    }
    let triangle = u32::try_from(t).ok()?;
    let uvs = scene.mesh.uv_indices.get(t).filter(|uv| uv[0] != ABSENT);
    let maps = [material.emission_map, material.opacity_map];
    let plain = Emitter::Triangle {
        triangle,
        radiance: material.emission,
        peak: 1.0,
    };
    let Some(uvs) = uvs.filter(|_| maps.iter().any(Option::is_some)) else {
        return Some(plain);
    };
    let uvs = uvs.map(|i| scene.mesh.uvs[i as usize]);
    let most = match material.emission_map {
        Some(map) => {
            let texture = &scene.textures[map.0 as usize];
            material.emission * brightest_of(texture, uvs, brightest[map.0 as usize])
        }
        None => material.emission,
    };
    if most == Vec3::ZERO {
        return None;
    }
    let steps = maps.iter().flatten().map(|map| {
        let texture = &scene.textures[map.0 as usize];
        let size = Vec2::new(texture.width as f32, texture.height as f32);
        let extent = (uvs[1] - uvs[0]).abs().max((uvs[2] - uvs[0]).abs()) * size;
        (extent.max_element() * 2.0).clamp(4.0, 256.0) as u32
    });
    let mean = mean(scene, t, steps.max().unwrap_or(4));
    // The support rule: what any point emits in a channel, the light has some of.
    let radiance = mean.max(most * LEAST_SHARE);
    let peak = (0..3)
        .filter(|&c| radiance[c] > 0.0)
        .map(|c| most[c] / radiance[c])
        .fold(1.0, f32::max);
    Some(Emitter::Triangle {
        triangle,
        radiance,
        peak,
    })
}

/// Mean of the radiance at the middles of `steps`² equal parts of the triangle.
fn mean(scene: &Scene, t: usize, steps: u32) -> Vec3 {
    let mut sum = DVec3::ZERO;
    let third = 1.0 / (3.0 * steps as f32);
    for i in 0..steps {
        for j in 0..steps - i {
            let (u, v) = (i as f32 / steps as f32, j as f32 / steps as f32);
            sum += scene.emitted(t, u + third, v + third).as_dvec3();
            // The part that points the other way.
            if i + j + 1 < steps {
                sum += scene
                    .emitted(t, u + 2.0 * third, v + 2.0 * third)
                    .as_dvec3();
            }
        }
    }
    (sum / f64::from(steps * steps)).as_vec3()
}

/// The brightest of the texels that the triangle with these coordinates may show, by channel.
fn brightest_of(texture: &Texture, uvs: [Vec2; 3], of_all: Vec3) -> Vec3 {
    let [a, b, c] = uvs.map(|uv| uv.as_dvec2());
    let size = DVec2::new(f64::from(texture.width), f64::from(texture.height));
    // Looking up blends neighbours.
    let lo = (a.min(b).min(c) * size).floor() - 1.0;
    let hi = (a.max(b).max(c) * size).ceil() + 1.0;
    let extent = hi - lo;
    let texels = extent.x * extent.y;
    if texels.is_nan() || texels > MOST_TEXELS {
        return of_all;
    }
    let mut most = Vec3::ZERO;
    for y in 0..extent.y as u32 {
        for x in 0..extent.x as u32 {
            let at = (lo + 0.5 + DVec2::new(f64::from(x), f64::from(y))) / size;
            most = most.max(texture.colour(at.as_vec2()));
        }
    }
    most
}
