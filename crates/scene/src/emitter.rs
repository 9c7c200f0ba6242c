//! The scene's own lights.

use glam::Vec3;

/// A light as the scene file gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Emitter {
    /// Shines alike in every direction.
    Point {
        /// World space, finite.
        position: Vec3,
        /// W/sr per channel, finite, not negative, not all zero.
        intensity: Vec3,
    },
}

impl Emitter {
    /// The light, moved by `offset` (scene units, finite).
    pub fn moved_by(self, offset: Vec3) -> Self {
        match self {
            Self::Point {
                position,
                intensity,
            } => Self::Point {
                position: position + offset,
                intensity,
            },
        }
    }
}
