//! Where the scene lies in the space of numbers, and how large it is there.

use glam::DVec3;

use crate::{Mesh, Scene};

/// Geometry of less extent is refused: products of three lengths within it would leave the range of `f32`.
const LEAST_EXTENT: f64 = 1e-9;

/// A scene is moved when it is farther from the origin than so many times half its extent.
const FAR: f64 = 8.0;

/// Corners of the box around all triangles; `None` when there is none.
fn bounds(mesh: &Mesh) -> Option<[DVec3; 2]> {
    let used = mesh.indices.iter().flatten();
    let positions = used.map(|&i| mesh.positions[i as usize].as_dvec3());
    positions.fold(None, |found, p| {
        let [lo, hi] = found.unwrap_or([p; 2]);
        Some([lo.min(p), hi.max(p)])
    })
}

/// Refuses geometry that is too small to tell its parts apart; else a message.
pub(super) fn check_extent(mesh: &Mesh) -> Result<(), String> {
    match bounds(mesh) {
        Some([lo, hi]) if (hi - lo).max_element() < LEAST_EXTENT => Err(format!(
            "the geometry is {:.1e} units across; expected at least {LEAST_EXTENT:e}: give it in a smaller unit",
            (hi - lo).max_element()
        )),
        _ => Ok(()),
    }
}

/// Moves a scene that lies far from the origin there.
///
/// Errors of positions are proportional to coordinates, so that a room at a distance of a million is rendered as one
/// that large would be: rays would start metres off its walls. No vertex is rounded by the move, since only those
/// axes take part in which all coordinates are within a factor of two of their middle.
pub(super) fn centre(scene: &mut Scene) {
    let Some([lo, hi]) = bounds(&scene.mesh) else {
        return;
    };
    let (middle, half) = (0.5 * (lo + hi), 0.5 * (hi - lo));
    if middle.abs().max_element() < FAR * half.max_element() {
        return;
    }
    // Sterbenz 1974: x − y is exact for y/2 <= x <= 2y. A third leaves room for the rounding of the middle.
    let exact = half.cmple(middle.abs() / 3.0);
    let origin = DVec3::select(exact, middle, DVec3::ZERO).as_vec3();
    for position in &mut scene.mesh.positions {
        *position -= origin;
    }
    for emitter in &mut scene.emitters {
        *emitter = emitter.moved_by(-origin);
    }
    scene.camera = scene.camera.moved_by(-origin);
    scene.origin = origin;
    scene.notes.remarks.push(format!(
        "the scene lies far from the origin: it is computed relative to {:?}",
        origin.to_array()
    ));
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::{CameraSpec, Emitter};

    fn triangle(corners: [Vec3; 3]) -> Scene {
        Scene {
            mesh: Mesh {
                positions: corners.to_vec(),
                indices: vec![[0, 1, 2]],
                ..Mesh::default()
            },
            emitters: vec![Emitter::Point {
                position: corners[0] + Vec3::Y,
                intensity: Vec3::ONE,
            }],
            camera: CameraSpec {
                origin: corners[1],
                target: corners[2],
                ..CameraSpec::default()
            },
            ..Scene::default()
        }
    }

    #[test]
    fn a_scene_far_from_the_origin_is_moved_there_and_no_vertex_is_rounded() {
        for far in [
            Vec3::new(1e6, 0.0, 0.0),
            Vec3::new(-1e6, 3e5, 0.7),
            Vec3::new(123.456, -789.1, 0.1),
        ] {
            let corners = [Vec3::X, Vec3::Y * 2.0, Vec3::Z * 3.0].map(|p| p + far);
            let mut scene = triangle(corners);
            centre(&mut scene);
            assert_ne!(scene.origin, Vec3::ZERO, "moved from {far}");
            for (now, file) in scene.mesh.positions.iter().zip(corners) {
                let expected = file.as_dvec3() - scene.origin.as_dvec3();
                assert_eq!(now.as_dvec3(), expected, "exactly, from {far}");
                assert!(now.length() < 8.0, "{now} is near the origin");
            }
            assert_eq!(
                scene.camera.origin, scene.mesh.positions[1],
                "the camera comes along"
            );
            let Emitter::Point { position, .. } = scene.emitters[0] else {
                panic!("another light: {:?}", scene.emitters[0]);
            };
            let above = position - scene.mesh.positions[0];
            assert!((above - Vec3::Y).length() < 0.1, "lights come along");
            assert_eq!(scene.notes.remarks.len(), 1, "a remark");
        }
    }

    #[test]
    fn a_scene_about_the_origin_stays_where_it_is() {
        for corners in [
            [Vec3::X, Vec3::Y, Vec3::Z],
            [Vec3::NEG_ONE, Vec3::ONE, Vec3::X].map(|p| p + Vec3::X * 5.0),
        ] {
            let mut scene = triangle(corners);
            centre(&mut scene);
            assert_eq!(scene.mesh.positions, corners, "vertices");
            assert_eq!(scene.origin, Vec3::ZERO, "origin");
        }
        let mut empty = Scene::default();
        centre(&mut empty);
        assert_eq!(empty.origin, Vec3::ZERO, "nothing to move");
    }

    #[test]
    fn geometry_without_extent_is_refused_with_its_size() {
        let small = triangle([Vec3::ZERO, Vec3::X * 1e-12, Vec3::Y * 1e-12]);
        let message = check_extent(&small.mesh).expect_err("too small");
        assert!(message.contains("1.0e-12"), "{message}");
        let fine = triangle([Vec3::ZERO, Vec3::X * 1e-6, Vec3::Y * 1e-12]);
        assert!(check_extent(&fine.mesh).is_ok(), "long enough");
        assert!(check_extent(&Mesh::default()).is_ok(), "none at all");
    }
}
