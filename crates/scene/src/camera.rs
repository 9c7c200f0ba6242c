//! The pinhole camera.

use glam::Vec3;
use serde::Deserialize;

/// Camera of `scene.ron`. Right-handed; the picture's up is `up` made perpendicular to the view.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSpec {
    /// Eye, scene units.
    pub origin: Vec3,
    /// Point in the middle of the picture; not equal to `origin`.
    pub target: Vec3,
    /// Any vector not parallel to the view direction.
    pub up: Vec3,
    /// Full vertical angle in degrees, above 0 and below 180.
    pub fov_y_deg: f32,
}

impl CameraSpec {
    /// The camera, moved by `offset` (scene units, finite).
    pub fn moved_by(self, offset: Vec3) -> Self {
        Self {
            origin: self.origin + offset,
            target: self.target + offset,
            ..self
        }
    }
}

impl Default for CameraSpec {
    fn default() -> Self {
        Self {
            origin: Vec3::ZERO,
            target: Vec3::NEG_Z,
            up: Vec3::Y,
            fov_y_deg: 60.0,
        }
    }
}
