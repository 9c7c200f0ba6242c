//! Integer hashing and tiling value noise for textures.

/// A well-mixed 32-bit hash of two cell coordinates and a seed.
pub(crate) fn hash(x: u32, y: u32, seed: u32) -> u32 {
    let mut h =
        x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297A_2D39);
    h ^ (h >> 15)
}

/// The hash as a number in [0, 1).
pub(crate) fn uniform(x: u32, y: u32, seed: u32) -> f32 {
    (hash(x, y, seed) >> 8) as f32 / 16_777_216.0
}

/// Value noise in [0, 1] on a lattice of `cells` × `cells` over the unit square, repeating.
pub(crate) fn value(u: f32, v: f32, cells: u32, seed: u32) -> f32 {
    let scale = cells as f32;
    let (x, y) = (u.rem_euclid(1.0) * scale, v.rem_euclid(1.0) * scale);
    let (i, j) = (x as u32 % cells, y as u32 % cells);
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    let (fx, fy) = (ease(x.fract()), ease(y.fract()));
    let at = |a: u32, b: u32| uniform(a % cells, b % cells, seed);
    let low = at(i, j) * (1.0 - fx) + at(i + 1, j) * fx;
    let high = at(i, j + 1) * (1.0 - fx) + at(i + 1, j + 1) * fx;
    low * (1.0 - fy) + high * fy
}

/// Three octaves of [`value`], in [0, 1].
pub(crate) fn cloud(u: f32, v: f32, cells: u32, seed: u32) -> f32 {
    let octave = |k: u32| value(u, v, cells << k, seed.wrapping_add(k));
    (octave(0) * 4.0 + octave(1) * 2.0 + octave(2)) / 7.0
}
