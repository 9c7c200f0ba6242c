//! Triangle geometry.

use glam::{Vec2, Vec3};

use crate::MaterialId;

/// Marks a corner without a normal, texture coordinate or colour.
pub const ABSENT: u32 = u32::MAX;

/// Triangles with shared vertices. All attribute index arrays are as long as `indices`, or empty when
/// no triangle has that attribute.
#[derive(Debug, Default, Clone)]
pub struct Mesh {
    /// World-space positions, finite.
    pub positions: Vec<Vec3>,
    /// Unit shading normals.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, v up as in OBJ (v = 0 is the bottom row of the image).
    pub uvs: Vec<Vec2>,
    /// Colours of vertices, linear RGB, each channel in [0, 1]: between corners they are interpolated, and multiply the
    /// diffuse colour of the material.
    pub colours: Vec<Vec3>,
    /// Three indices into `positions` a triangle; no triangle is degenerate, no two have the same positions.
    pub indices: Vec<[u32; 3]>,
    /// Indices into `normals`; [`ABSENT`] in all three corners where the triangle shades flat.
    pub normal_indices: Vec<[u32; 3]>,
    /// Indices into `uvs`; [`ABSENT`] in all three corners where there are none.
    pub uv_indices: Vec<[u32; 3]>,
    /// Indices into `colours`; [`ABSENT`] in all three corners where there are none.
    pub colour_indices: Vec<[u32; 3]>,
    /// One a triangle.
    pub materials: Vec<MaterialId>,
}

impl Mesh {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// Whether there is no triangle at all.
    pub fn is_empty(&self) -> bool {
        self.indices.is_empty()
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.positions[..])
            + size_of_val(&self.normals[..])
            + size_of_val(&self.uvs[..])
            + size_of_val(&self.colours[..])
            + size_of_val(&self.indices[..])
            + size_of_val(&self.normal_indices[..])
            + size_of_val(&self.uv_indices[..])
            + size_of_val(&self.colour_indices[..])
            + size_of_val(&self.materials[..])
    }

    /// Corner positions of triangle `t`.
    #[inline]
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        at(&self.positions, self.indices[t])
    }
}

/// What `values` hold for three corners.
#[inline(always)]
pub(crate) fn at<T: Copy>(values: &[T], [a, b, c]: [u32; 3]) -> [T; 3] {
    // No `map`: it is not compiled into its caller.
    [values[a as usize], values[b as usize], values[c as usize]]
}
