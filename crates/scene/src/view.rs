//! Camera rays.

use glam::{Mat3, Mat4, Vec3, Vec4};

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

    /// To the left-handed space in which the camera is at the origin: x to the right, y up, z into the picture.
    pub fn world_to_camera(&self) -> Mat4 {
        let axes = [self.right, self.up, self.forward].map(Vec3::normalize);
        let turn = Mat3::from_cols_array_2d(&axes.map(|axis| axis.to_array())).transpose();
        Mat4::from_mat3(turn) * Mat4::from_translation(-self.origin)
    }

    /// To the space in which (0, 0) is the picture's upper left corner and (1, 1) its lower right one, after the division
    /// by w; the third coordinate is 1 over the depth.
    pub fn world_to_ndc(&self) -> Mat4 {
        let (half_width, half_height) = (self.right.length(), self.up.length());
        let project = Mat4::from_cols(
            Vec4::new(0.5 / half_width, 0.0, 0.0, 0.0),
            Vec4::new(0.0, -0.5 / half_height, 0.0, 0.0),
            Vec4::new(0.5, 0.5, 0.0, 1.0),
            Vec4::new(0.0, 0.0, 1.0, 0.0),
        );
        project * self.world_to_camera()
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
    fn matrices_say_where_rays_go() {
        let spec = CameraSpec {
            origin: Vec3::new(3.0, -2.0, 7.0),
            target: Vec3::new(1.0, 0.5, -4.0),
            up: Vec3::Y,
            fov_y_deg: 50.0,
        };
        let camera = Camera::new(&spec, 200, 100);
        for (x, y) in [(0.0, 0.0), (200.0, 0.0), (30.0, 80.0)] {
            let seen = camera.origin() + camera.direction(x, y) * 5.0;
            let place = camera.world_to_ndc().project_point3(seen);
            let expected = Vec3::new(x / 200.0, y / 100.0, place.z);
            assert!(place.distance(expected) < 1e-5, "{place} is not {expected}");
            let local = camera.world_to_camera().transform_point3(seen);
            assert!((local.length() - 5.0).abs() < 1e-5, "a distance: {local}");
            assert!(local.z > 0.0, "in front: {local}");
            assert!((local.x > 0.0) == (x > 100.0), "right is right: {local}");
            assert!((local.y > 0.0) == (y < 50.0), "up is up: {local}");
        }
    }

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
