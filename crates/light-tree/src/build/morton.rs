//! Splits along the Morton curve.
//!
//! Source: Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020: lights are sorted by 30-bit Morton codes and
//! a perfect binary tree is put over them.

use glam::Vec3;

use super::Item;

/// Bits a coordinate.
const BITS: u32 = 10;

/// The box that codes divide.
#[derive(Clone, Copy)]
pub(super) struct Curve {
    lo: Vec3,
    scale: Vec3,
}

impl Curve {
    /// A curve through the box from `lo` to `hi`.
    pub(super) fn over(lo: Vec3, hi: Vec3) -> Self {
        let scale = (hi - lo).to_array().map(|e| {
            let scale = (1u32 << BITS) as f32 / e;
            if scale.is_finite() { scale } else { 0.0 }
        });
        Self {
            lo,
            scale: Vec3::from_array(scale),
        }
    }

    /// Position along the curve.
    pub(super) fn code(&self, position: Vec3) -> u32 {
        let cell = (position - self.lo) * self.scale;
        // The cast saturates: the last cell is closed, and not-a-number is 0.
        let [x, y, z] = cell.to_array().map(|c| (c as u32).min((1 << BITS) - 1));
        spread(x) | spread(y) << 1 | spread(z) << 2
    }

    /// Where the sorted `items` change in the highest bit of their codes; the middle where they all agree.
    pub(super) fn split(&self, items: &[Item]) -> usize {
        let code = |i: &Item| self.code(i.position);
        let (Some(first), Some(last)) = (items.first().map(code), items.last().map(code)) else {
            return 0;
        };
        if first == last {
            return items.len() / 2;
        }
        let highest = 1 << (31 - (first ^ last).leading_zeros());
        items.partition_point(|i| code(i) & highest == 0)
    }
}

/// Size of the first half of a perfect binary tree over `n` ≥ 2 lights, padded behind the last.
pub(super) fn perfect_half(n: usize) -> usize {
    n.next_power_of_two() / 2
}

/// The low 10 bits of `v`, two zeros between each.
fn spread(v: u32) -> u32 {
    let v = (v | v << 16) & 0x0300_00ff;
    let v = (v | v << 8) & 0x0300_f00f;
    let v = (v | v << 4) & 0x030c_30c3;
    (v | v << 2) & 0x0924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_interleave_the_cells() {
        let curve = Curve::over(Vec3::ZERO, Vec3::splat(1024.0));
        assert_eq!(curve.code(Vec3::new(1.0, 0.0, 0.0)), 0b001, "x");
        assert_eq!(curve.code(Vec3::new(0.0, 2.0, 3.0)), 0b110_100, "y and z");
        assert_eq!(
            curve.code(Vec3::splat(1024.0)),
            (1 << 30) - 1,
            "the far corner is in the last cell"
        );
        assert_eq!(
            Curve::over(Vec3::ONE, Vec3::ONE).code(Vec3::ONE),
            0,
            "no extent"
        );
    }

    #[test]
    fn a_perfect_tree_fills_its_first_half() {
        assert_eq!(
            [2, 3, 4, 5, 8, 9].map(perfect_half),
            [1, 2, 2, 4, 4, 8],
            "sizes of the first half"
        );
    }
}
