//! Top-down binned splits over position and emission axis.
//!
//! A split is sought along the three axes of space and, where lights have directions, the three of
//! the direction, by the cluster metric of Walter et al. 2005 (§3.1, eq. for cluster size):
//! ‖I‖ (α² + c² (1 − cos β)²), α the box diagonal, β the half angle of the directions. Splitting by direction
//! matters for virtual lights: both sides of a wall, and the walls of a corner, are close in space and light
//! different places.
//!
//! There c is the diagonal of the whole, which sorts the lights of a hall by direction first: each cluster's box is then
//! the hall, and a point in it is near all of them and far from most of their lights. Here c is a quarter of it. With a
//! million virtual lights that halves the variance of Stochastic Lightcuts, and rids it of its brightest outliers.

use glam::Vec3A;

use super::{Context, Item, JUDGED, halve, partition};
use crate::block::{Lanes, WIDTH};
use crate::wide::by_width;

/// Bins that an axis is divided into, a power of two.
const BINS: usize = 16;
const DIMENSIONS: usize = 6;
/// c² of the metric over the squared diagonal of the whole.
pub(super) const DIRECTION: f32 = 1.0 / 16.0;

/// Lights that fall into one slice along one axis.
#[derive(Clone, Copy)]
pub(super) struct Bin {
    lo: Vec3A,
    hi: Vec3A,
    axis_lo: Vec3A,
    axis_hi: Vec3A,
    /// 0 without a light.
    intensity: f64,
}

impl Bin {
    pub(super) const EMPTY: Self = Self {
        lo: Vec3A::INFINITY,
        hi: Vec3A::NEG_INFINITY,
        axis_lo: Vec3A::INFINITY,
        axis_hi: Vec3A::NEG_INFINITY,
        intensity: 0.0,
    };

    #[inline(always)]
    pub(super) fn of(item: &Item) -> Self {
        let (position, axis) = (Vec3A::from(item.position), Vec3A::from(item.axis));
        Self {
            lo: position,
            hi: position,
            axis_lo: axis,
            axis_hi: axis,
            intensity: f64::from(item.intensity),
        }
    }

    #[inline(always)]
    pub(super) fn merge(&mut self, other: &Self) {
        self.lo = self.lo.min(other.lo);
        self.hi = self.hi.max(other.hi);
        self.axis_lo = self.axis_lo.min(other.axis_lo);
        self.axis_hi = self.axis_hi.max(other.axis_hi);
        self.intensity += other.intensity;
    }

    /// ‖I‖ (α² + c² (1 − cos β)²) with the cone taken from the box around the axes: its half diagonal is
    /// the chord 2 sin(β/2), so 1 − cos β = diagonal²/8. `c2` is c², 0 where directions do not count.
    #[inline(always)]
    pub(super) fn cost(&self, c2: f32) -> f64 {
        let alpha2 = (self.hi - self.lo).length_squared();
        let spread = (self.axis_hi - self.axis_lo).length_squared() / 8.0;
        self.intensity * f64::from(alpha2 + c2 * spread * spread)
    }
}

/// Numbers that a cluster may be split along: three of the position and three of the axis.
struct Grid {
    lo: Lanes,
    /// Reciprocals of extents, 0 where all lights agree.
    scale: Lanes,
}

impl Grid {
    #[inline(always)]
    fn over(items: &[Item], stride: usize) -> Self {
        let mut all = Bin::EMPTY;
        let mut i = 0;
        while i < items.len() {
            all.merge(&Bin::of(&items[i]));
            i += stride;
        }
        let (mut lo, mut scale) = ([0.0; WIDTH], [0.0; WIDTH]);
        for d in 0..DIMENSIONS {
            let (least, most) = match d {
                0..3 => (all.lo[d], all.hi[d]),
                _ => (all.axis_lo[d - 3], all.axis_hi[d - 3]),
            };
            lo[d] = least;
            let per_extent = 1.0 / (most - least);
            // The scale must not be 0/0.
            if per_extent.is_finite() {
                scale[d] = per_extent;
            }
        }
        Self { lo, scale }
    }

    /// The bins of a light.
    #[inline(always)]
    fn places(&self, item: &Item) -> [u32; WIDTH] {
        let (p, a) = (item.position, item.axis);
        let at = [p.x, p.y, p.z, a.x, a.y, a.z, 0.0, 0.0];
        let mut places = [0; WIDTH];
        for k in 0..WIDTH {
            // From 1 to 2, where the first bits behind the point are the bin's number.
            let place = (at[k] - self.lo[k]) * self.scale[k] + 1.0;
            let place = if place < LAST { place } else { LAST };
            places[k] =
                place.to_bits() >> (f32::MANTISSA_DIGITS - 1 - BINS.ilog2()) & (BINS as u32 - 1);
        }
        places
    }
}

/// The last number before 2.
const LAST: f32 = 2.0 - f32::EPSILON;

/// Reorders `items` into two clusters of least cost and returns the size of the first.
pub(super) fn split(context: &Context, items: &mut [Item]) -> usize {
    let Some(Cut {
        grid,
        d,
        first_right,
    }) = cut(items, context.c2)
    else {
        return halve(items);
    };
    let (lo, scale) = (grid.lo[d], grid.scale[d]);
    let end = 1.0 + first_right as f32 / BINS as f32;
    // Lights that were not judged may be out of range.
    let left = match d {
        0..3 => partition(items, |i| (i.position[d] - lo) * scale + 1.0 < end),
        _ => partition(items, |i| (i.axis[d - 3] - lo) * scale + 1.0 < end),
    };
    if left == 0 || left == items.len() {
        halve(items)
    } else {
        left
    }
}

/// Where a cluster is divided.
struct Cut {
    grid: Grid,
    d: usize,
    first_right: usize,
}

fn cut(items: &[Item], c2: f32) -> Option<Cut> {
    by_width!(cut_avx2(items, c2), cut_with(items, c2))
}

/// The same code and the same bits, eight lanes to an instruction.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn cut_avx2(items: &[Item], c2: f32) -> Option<Cut> {
    cut_with(items, c2)
}

#[inline(always)]
fn cut_with(items: &[Item], c2: f32) -> Option<Cut> {
    let stride = items.len().div_ceil(JUDGED).max(1);
    let grid = Grid::over(items, stride);
    let mut used = [0; DIMENSIONS];
    let mut count = 0;
    for d in 0..DIMENSIONS {
        used[count] = d;
        count += usize::from(grid.scale[d] > 0.0 && (d < 3 || c2 > 0.0));
    }
    let used = &used[..count];
    let mut bins = [[Bin::EMPTY; BINS]; DIMENSIONS];
    let mut i = 0;
    while i < items.len() {
        let (places, light) = (grid.places(&items[i]), Bin::of(&items[i]));
        for &d in used {
            bins[d][places[d] as usize % BINS].merge(&light);
        }
        i += stride;
    }
    let mut least = f64::INFINITY;
    let mut best = None;
    for &d in used {
        let bins = &bins[d];
        let mut right_cost = [0.0; BINS];
        let mut right = Bin::EMPTY;
        for b in (1..BINS).rev() {
            right.merge(&bins[b]);
            right_cost[b] = match right.intensity > 0.0 {
                true => right.cost(c2),
                false => f64::INFINITY,
            };
        }
        let mut left = Bin::EMPTY;
        for b in 1..BINS {
            left.merge(&bins[b - 1]);
            if left.intensity > 0.0 {
                let cost = left.cost(c2) + right_cost[b];
                if cost < least {
                    (least, best) = (cost, Some((d, b)));
                }
            }
        }
    }
    let (d, first_right) = best?;
    Some(Cut {
        grid,
        d,
        first_right,
    })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sampling::{Purpose, Rng, uniform_sphere};

    use super::*;

    #[test]
    fn wide_and_narrow_instructions_cut_in_the_same_place() {
        let mut rng = Rng::new(9, 0, 0, Purpose::Build);
        for round in 0..100 {
            let mut item = |id| Item {
                position: Vec3::new(rng.f32(), rng.f32(), (round % 2) as f32 * rng.f32()),
                intensity: 0.1 + rng.f32(),
                axis: uniform_sphere([rng.f32(), rng.f32()]),
                id,
            };
            let items: Vec<Item> = (0..17 + 10 * round).map(&mut item).collect();
            let of = |cut: Option<Cut>| cut.map(|cut| (cut.d, cut.first_right));
            let (fast, plain) = (of(cut(&items, 0.1)), of(cut_with(&items, 0.1)));
            assert!(fast.is_some() && fast == plain, "{fast:?} and {plain:?}");
        }
    }
}
