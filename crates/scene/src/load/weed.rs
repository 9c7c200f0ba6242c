//! Triangles that cannot be rendered, or only cost time, are taken out.

use glam::Vec3;
use rayon::prelude::*;

use crate::tagged::Tagged;
use crate::{ABSENT, LoadNotes, Mesh};

/// A triangle lower than this part of its longest edge has no area: `f32` cannot tell its normal.
const FLATTEST: f64 = 1e-9;

/// Drops triangles without area and all but the first of triangles with the same three positions (builders
/// of bounding volume hierarchies take quadratic time on those), and attribute arrays that nobody uses.
pub(super) fn weed(mesh: &mut Mesh, notes: &mut LoadNotes) {
    let flat: Vec<bool> = (0..mesh.len()).map(|t| is_flat(mesh.corners(t))).collect();
    let repeated = repeats(mesh, &flat);
    let count = |flags: &[bool]| flags.iter().filter(|&&flag| flag).count();
    notes.degenerate_triangles += count(&flat);
    notes.duplicate_triangles += count(&repeated);
    let keep: Vec<bool> = flat
        .iter()
        .zip(&repeated)
        .map(|(&f, &r)| !f && !r)
        .collect();
    if !mesh.colour_indices.is_empty() {
        mesh.colour_indices.resize(mesh.len(), [ABSENT; 3]);
    }
    retain(&mut mesh.indices, &keep);
    retain(&mut mesh.normal_indices, &keep);
    retain(&mut mesh.uv_indices, &keep);
    retain(&mut mesh.colour_indices, &keep);
    retain(&mut mesh.materials, &keep);
    for indices in [
        &mut mesh.normal_indices,
        &mut mesh.uv_indices,
        &mut mesh.colour_indices,
    ] {
        if indices.iter().all(|corners| corners[0] == ABSENT) {
            indices.clear();
        }
    }
}

fn retain<T>(items: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    items.retain(|_| keep.next().copied().unwrap_or(true));
}

/// Whether a triangle has no area. The rule does not depend on scale; the sums are exact or nearly so, as
/// `f32` coordinates have room in `f64`.
fn is_flat(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|corner| corner.as_dvec3());
    let (ab, ac, bc) = (b - a, c - a, c - b);
    let longest2 = ab
        .length_squared()
        .max(ac.length_squared())
        .max(bc.length_squared());
    // |ab × ac| is longest edge times height; both sides are squared. Zero by zero is flat.
    ab.cross(ac).length_squared() <= FLATTEST * FLATTEST * longest2 * longest2
}

/// Marks triangles whose three positions an earlier triangle has, in whatever order.
fn repeats(mesh: &Mesh, skip: &[bool]) -> Vec<bool> {
    let names = same_positions(&mesh.positions);
    let mut triangles: Vec<Tagged> = Vec::with_capacity(mesh.len());
    for (t, corners) in (0u32..).zip(&mesh.indices) {
        if !skip[t as usize] {
            let mut key = corners.map(|i| names[i as usize]);
            key.sort_unstable();
            triangles.push(Tagged::new(key, t));
        }
    }
    triangles.par_sort_unstable();
    let mut repeated = vec![false; mesh.len()];
    for pair in triangles.windows(2) {
        if pair[0].key() == pair[1].key() {
            repeated[pair[1].tag() as usize] = true;
        }
    }
    repeated
}

/// For every vertex, a number that vertices at the same position share.
fn same_positions(positions: &[Vec3]) -> Vec<u32> {
    // Adding zero makes −0 into 0.
    let bits = |p: Vec3| (p + Vec3::ZERO).to_array().map(f32::to_bits);
    let tagged = |(&p, vertex): (&Vec3, u32)| Tagged::new(bits(p), vertex);
    let mut order: Vec<Tagged> = positions.iter().zip(0..).map(tagged).collect();
    order.par_sort_unstable();
    let mut names = vec![0; positions.len()];
    for same in order.chunk_by(|a, b| a.key() == b.key()) {
        for vertex in same {
            names[vertex.tag() as usize] = same[0].tag();
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_triangles_without_area_are_flat() {
        let (x, y) = (Vec3::X, Vec3::Y);
        for scale in [1e-15, 1e-6, 1.0, 1e6, 1e14f32] {
            let flat = |a: Vec3, b: Vec3, c: Vec3| is_flat([a * scale, b * scale, c * scale]);
            assert!(!flat(Vec3::ZERO, x, y), "a right triangle at {scale}");
            assert!(!flat(Vec3::ZERO, x, x + 1e-6 * y), "a sliver at {scale}");
            assert!(flat(x, x, y), "two corners the same at {scale}");
            assert!(flat(x, y, x), "two corners the same at {scale}");
            assert!(flat(Vec3::ZERO, x, 2.0 * x), "on a line at {scale}");
        }
        assert!(is_flat([Vec3::ZERO; 3]), "a point");
    }

    #[test]
    fn repeated_triangles_are_dropped_whatever_their_order() {
        let (z, x, y) = (Vec3::ZERO, Vec3::X, Vec3::Y);
        let mut mesh = Mesh {
            positions: vec![z, x, y, -z, x, y, Vec3::Z],
            indices: vec![[0, 1, 2], [5, 3, 4], [2, 1, 0], [0, 1, 6], [0, 3, 1]],
            materials: vec![Default::default(); 5],
            ..Mesh::default()
        };
        let mut notes = LoadNotes::default();
        weed(&mut mesh, &mut notes);
        assert_eq!(mesh.indices, [[0, 1, 2], [0, 1, 6]], "kept");
        assert_eq!(notes.duplicate_triangles, 2, "repeats");
        assert_eq!(notes.degenerate_triangles, 1, "-0 is 0");
    }
}
