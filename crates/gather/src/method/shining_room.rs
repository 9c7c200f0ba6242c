//! A room to test lights with an extent in.

use glam::{Vec2, Vec3};
use scene::{Emitter, Environment, Material, MaterialId, Scene, Texture, TextureId};

use super::conformance::room;

/// The room with lights of every kind but virtual ones: spots, panels, one of them textured, a sky.
pub(crate) fn shining_room(glossy: bool) -> Scene {
    let mut scene = room(glossy);
    let mesh = &mut scene.mesh;
    for corners in [
        [[-1.0, 2.9, -0.5], [-1.0, 2.9, 0.6], [0.3, 2.9, 0.6]],
        [[1.6, 0.4, 1.5], [1.9, 1.4, 0.8], [1.7, 0.5, 0.9]],
        [[-1.9, 0.2, 1.4], [-1.6, 1.2, 1.8], [-1.9, 1.9, 1.2]],
    ] {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners.map(Vec3::from));
        mesh.indices.push([first, first + 1, first + 2]);
        mesh.materials.push(MaterialId(1));
    }
    let triangles = mesh.indices.len();
    mesh.materials[triangles - 1] = MaterialId(2);
    mesh.uvs = [[0.0, 0.0], [2.0, 0.0], [0.0, 1.5]]
        .map(Vec2::from)
        .to_vec();
    mesh.uv_indices = vec![[0, 1, 2]; triangles];
    scene.textures.push(Texture {
        path: "two by two".into(),
        width: 2,
        height: 2,
        texels: vec![
            [255, 0, 0, 255],
            [20, 200, 0, 255],
            [0, 0, 0, 255],
            [90, 90, 255, 255],
        ],
        has_alpha: false,
    });
    let panel = Material {
        emission: Vec3::new(2.0, 1.5, 1.0),
        ..scene.materials[0].clone()
    };
    let screen = Material {
        emission_map: Some(TextureId(0)),
        ..panel.clone()
    };
    scene.materials.extend([panel, screen]);
    scene.emissive = (0..triangles).map(|t| t >= triangles - 3).collect();
    for (t, radiance, peak) in [
        (triangles - 3, Vec3::new(2.0, 1.5, 1.0), 1.0),
        (triangles - 2, Vec3::new(2.0, 1.5, 1.0), 1.0),
        // Not the texture's mean: only the noise may depend on it.
        (triangles - 1, Vec3::new(0.8, 0.5, 0.2), 5.0),
    ] {
        let triangle = t as u32;
        scene.emitters.push(Emitter::Triangle {
            triangle,
            radiance,
            peak,
        });
    }
    for i in 0..12 {
        let turn = i as f32 * 0.7;
        let (cos_inner, cos_outer) = [
            (0.9, 0.7),
            (0.8, 0.8),
            (0.0, 0.0),
            (-1.0, -1.0),
            (1.0, -1.0),
            (0.999, 0.999),
        ][i % 6];
        scene.emitters.push(Emitter::Spot {
            position: Vec3::new(1.5 * turn.cos(), 2.5, 1.5 * turn.sin()),
            direction: Vec3::new(-0.4 * turn.cos(), -1.0, -0.3 * turn.sin()).normalize(),
            intensity: Vec3::new(1.0, 0.5 + 0.1 * turn, 0.7),
            cos_inner,
            cos_outer,
        });
    }
    let sky = (0..32).map(|i| match i {
        5 => Vec3::new(20.0, 18.0, 12.0),
        _ if i < 16 => Vec3::new(0.05 * i as f32, 0.3, 0.5),
        _ => Vec3::ZERO,
    });
    scene.environment = Environment::new(8, 4, sky.collect());
    scene
}
