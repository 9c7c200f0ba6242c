//! The kinds of light that a tree may hold, and how each is described.

use std::f32::consts::PI;

use glam::Vec3;

use crate::cone::Cone;

/// Index of a light in a [`LightSet`](crate::LightSet).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LightId(pub u32);

impl LightId {
    /// As an index into the set's arrays.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// How a light shines and falls off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightKind {
    /// Shines alike in every direction, inverse square.
    Omni,
    /// Shines within a cone about its axis, inverse square.
    Spot,
    /// A triangle that emits from both sides: cosine emission from each of its points, inverse square.
    Triangle,
    /// A virtual spherical light: cosine emission about its axis, inverse square outside its sphere.
    Virtual,
    /// Parallel light along its axis, no attenuation.
    Directional,
    /// A cell of directions that light comes from, from beyond the scene: no attenuation.
    Environment,
}

impl LightKind {
    /// All of them, those with a place first.
    pub const ALL: [Self; 6] = [
        Self::Omni,
        Self::Spot,
        Self::Triangle,
        Self::Virtual,
        Self::Directional,
        Self::Environment,
    ];

    /// Whether the light comes from beyond the scene, without a place and without falling off.
    #[inline]
    pub fn is_distant(self) -> bool {
        matches!(self, Self::Directional | Self::Environment)
    }
}

/// The cone that a spot light shines into.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpotCone {
    /// Cosine of the angle up to which the light has its full intensity; not less than `cos_outer`.
    pub cos_inner: f32,
    /// Cosine of the angle beyond which it is dark, in −1..=1.
    pub cos_outer: f32,
}

impl SpotCone {
    /// Share of the full intensity at an angle of cosine `cos` to the axis: 1 inside, 0 outside, a cubic step between;
    /// on an edge without width 1.
    #[inline]
    pub fn falloff(&self, cos: f32) -> f32 {
        if cos >= self.cos_inner {
            return 1.0;
        }
        if cos <= self.cos_outer {
            return 0.0;
        }
        // Between them the width is not 0.
        let t = (cos - self.cos_outer) / (self.cos_inner - self.cos_outer);
        t * t * (3.0 - 2.0 * t)
    }

    /// Flux per unit of intensity, sr: the integral of [`falloff`](Self::falloff) over all directions. 0 for a cone
    /// of angle 0.
    pub fn solid_angle(&self) -> f32 {
        // The step's mean is one half.
        2.0 * PI * (1.0 - 0.5 * (self.cos_inner + self.cos_outer))
    }
}

/// A triangle that emits, as the tree sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangleLight {
    /// Its corners.
    pub corners: [Vec3; 3],
    /// Radiance × area, averaged over the triangle: intensity along the normal, W/sr.
    pub intensity: Vec3,
    /// Greatest radiance of any point over that average, by channel: 1 without a texture.
    pub peak: f32,
    /// How far off the triangle its points may be put.
    pub offset: f32,
    /// Which triangle, an index the scene understands and this crate does not.
    pub element: u32,
}

/// A cell of an environment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnvironmentCell {
    /// Holds every direction in which light travels from the cell.
    pub travel: Cone,
    /// What a surface receives that faces all of it, W/m²: radiance × solid angle, summed.
    pub irradiance: Vec3,
    /// Greatest that light drawn from the cell can be over `irradiance`, by channel.
    pub peak: f32,
    /// Which cell, an index the scene understands and this crate does not.
    pub element: u32,
}

/// A virtual light, as a particle leaves it where it hits a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualLight {
    /// Where the particle hit, moved off the surface along `normal` by the hit's error bound.
    pub position: Vec3,
    /// Unit surface normal on the side the particle came from.
    pub normal: Vec3,
    /// RGB intensity along the normal, W/sr: the power that arrives, times the share of it that leaves again, over π.
    pub intensity: Vec3,
    /// How light is sent on: `None` as by a matte surface, with the cosine to the normal.
    pub gloss: Option<Gloss>,
}

/// How a glossy surface sends on the light of a virtual light. Numbers the scene understands and this crate does not,
/// but for `peak`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gloss {
    /// Unit direction from the surface back to where the particle came from.
    pub incoming: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// Share of the light that leaves again, which `intensity` counts.
    pub reflectance: Vec3,
    /// Diffuse reflectance.
    pub diffuse: Vec3,
    /// Specular reflectance.
    pub specular: Vec3,
    /// Roughness.
    pub alpha: f32,
    /// Whether the specular part grows toward grazing angles, over a diffuse part that gets what it leaves.
    pub is_coat: bool,
    /// Greatest that the light sends in any direction beyond what a matte light of its intensity sends, over that
    /// intensity; ≥ 0.
    pub peak: f32,
}

/// The scalar by which lights are weighed: the mean of the channels, above 0 wherever a channel is.
#[inline]
pub fn luminance(c: Vec3) -> f32 {
    (c.x + c.y + c.z) * (1.0 / 3.0)
}
