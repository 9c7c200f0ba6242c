//! Camera rays.

use glam::Vec3;

use crate::CameraSpec;

/// A pinhole camera for a picture of given size.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    origin: Vec3,
    /// Direction through the middle of the picture.
    forward: Vec3,
    /// From the middle to the right and upper edge.
    right: Vec3,
    up: Vec3,
    width: f32,
    height: f32,
}

impl Camera {
    /// The camera of `spec` for a picture of `width` × `height` square pixels.
    pub fn new(spec: &CameraSpec, width: u32, height: u32) -> Self {
        let forward = (spec.target - spec.origin).normalize();
        let right = forward.cross(spec.up).normalize();
        let up = right.cross(forward);
        let half_height = (0.5 * spec.fov_y_deg.to_radians()).tan();
        let half_width = half_height * width as f32 / height as f32;
        Self {
            origin: spec.origin,
            forward,
            right: right * half_width,
            up: up * half_height,
            width: width as f32,
            height: height as f32,
        }
    }

    /// Where every ray starts.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Unit direction through position (x, y) of the picture, in pixels from the top left corner.
    #[inline]
    pub fn direction(&self, x: f32, y: f32) -> Vec3 {
        let sx = 2.0 * x / self.width - 1.0;
        let sy = 1.0 - 2.0 * y / self.height;
        (self.forward + self.right * sx + self.up * sy).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn right_is_right_and_row_zero_is_the_top() {
        let spec = CameraSpec {
            origin: Vec3::ZERO,
            target: Vec3::NEG_Z,
            up: Vec3::Y,
            fov_y_deg: 90.0,
        };
        let camera = Camera::new(&spec, 200, 100);
        let middle = camera.direction(100.0, 50.0);
        assert!(middle.distance(Vec3::NEG_Z) < 1e-6, "middle {middle}");
        let top = camera.direction(100.0, 0.0);
        assert!(
            (top.y - std::f32::consts::FRAC_1_SQRT_2).abs() < 1e-6,
            "full vertical angle: {top}"
        );
        let right = camera.direction(200.0, 50.0);
        assert!(
            right.x > 0.0 && (right.x / -right.z - 2.0).abs() < 1e-5,
            "right edge {right}"
        );
    }
}
