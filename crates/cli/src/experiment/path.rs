//! Where camera and lights are in a frame.

use glam::Vec3;
use scene::{CameraSpec, Emitter, Scene};

use super::spec::{Animation, Keys, Path};

/// The camera and lights that a scene file gives, to begin each frame from.
#[derive(Debug, Clone)]
pub(crate) struct Still {
    camera: CameraSpec,
    emitters: Vec<Emitter>,
}

impl Still {
    /// Of a scene as it was loaded.
    pub(crate) fn of(scene: &Scene) -> Self {
        Self {
            camera: scene.camera,
            emitters: scene.emitters.clone(),
        }
    }

    /// Gives `scene` camera and lights of a frame; of the still where there is no animation.
    pub(crate) fn pose(&self, scene: &mut Scene, animation: Option<&Animation>, frame: u32) {
        scene.camera = self.camera;
        scene.emitters.clone_from(&self.emitters);
        let Some(animation) = animation else {
            return;
        };
        let progress = f64::from(frame) / f64::from(animation.frames.0 - 1);
        match &animation.path {
            Path::Camera(keys) => {
                let camera = CameraSpec {
                    origin: at(keys, progress, |key| key.origin.0),
                    target: at(keys, progress, |key| key.target.0),
                    ..self.camera
                };
                // Keys are in the coordinates of the files.
                scene.camera = camera.moved_by(-scene.origin);
            }
            Path::Lights(keys) => {
                let offset = at(keys, progress, |key| key.0);
                for emitter in &mut scene.emitters {
                    *emitter = emitter.moved_by(offset);
                }
            }
        }
    }
}

/// Whether lights differ from frame to frame.
pub(crate) fn moves_lights(animation: Option<&Animation>) -> bool {
    animation.is_some_and(|a| matches!(a.path, Path::Lights(_)))
}

/// The point at `progress` (0 at the first key, 1 at the last) of a path whose keys are equally far apart in time.
fn at<K>(keys: &Keys<K>, progress: f64, point: impl Fn(&K) -> Vec3) -> Vec3 {
    let steps = keys.0.len() - 1;
    let place = progress * steps as f64;
    let before = (place as usize).min(steps - 1);
    let (a, b) = (point(&keys.0[before]), point(&keys.0[before + 1]));
    a.as_dvec3()
        .lerp(b.as_dvec3(), place - before as f64)
        .as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::spec::{FrameCount, Offset};

    fn lights(keys: &[Vec3]) -> Animation {
        Animation {
            frames: FrameCount(5),
            path: Path::Lights(Keys(keys.iter().map(|&k| Offset(k)).collect())),
        }
    }

    #[test]
    fn frames_go_evenly_through_all_keys_and_begin_from_the_still_each_time() {
        let mut scene = Scene {
            emitters: vec![Emitter::Point {
                position: Vec3::ONE,
                intensity: Vec3::ONE,
            }],
            ..Scene::default()
        };
        let still = Still::of(&scene);
        let path = lights(&[Vec3::ZERO, Vec3::X, Vec3::new(1.0, 2.0, 0.0)]);
        let mut found = Vec::new();
        for frame in 0..5 {
            still.pose(&mut scene, Some(&path), frame);
            let Emitter::Point { position, .. } = scene.emitters[0] else {
                panic!("another light: {:?}", scene.emitters[0]);
            };
            found.push(position - Vec3::ONE);
        }
        let expected = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.0, 1.0), (1.0, 2.0)];
        let expected = expected.map(|(x, y)| Vec3::new(x, y, 0.0));
        assert_eq!(found, expected, "positions");
        still.pose(&mut scene, None, 0);
        assert_eq!(scene.emitters, still.emitters, "still");
    }
}
