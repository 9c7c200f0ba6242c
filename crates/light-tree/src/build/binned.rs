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

use glam::{Vec3, Vec3A};

use super::{Context, Item, JUDGED, halve, partition};

/// Most bins an axis is divided into.
const BINS: usize = 16;
/// c² of the metric over the squared diagonal of the whole.
const DIRECTION: f32 = 1.0 / 16.0;

/// Lights that fall into one slice along one axis.
#[derive(Clone, Copy)]
pub(super) struct Bin {
    lo: Vec3A,
    hi: Vec3A,
    axis_lo: Vec3A,
    axis_hi: Vec3A,
    intensity: f64,
    count: u32,
}

impl Bin {
    pub(super) const EMPTY: Self = Self {
        lo: Vec3A::INFINITY,
        hi: Vec3A::NEG_INFINITY,
        axis_lo: Vec3A::INFINITY,
        axis_hi: Vec3A::NEG_INFINITY,
        intensity: 0.0,
        count: 0,
    };

    #[inline]
    pub(super) fn add(&mut self, position: Vec3A, axis: Vec3A, intensity: f32) {
        self.lo = self.lo.min(position);
        self.hi = self.hi.max(position);
        self.axis_lo = self.axis_lo.min(axis);
        self.axis_hi = self.axis_hi.max(axis);
        self.intensity += f64::from(intensity);
        self.count += 1;
    }

    #[inline]
    pub(super) fn merge(&mut self, other: &Self) {
        self.lo = self.lo.min(other.lo);
        self.hi = self.hi.max(other.hi);
        self.axis_lo = self.axis_lo.min(other.axis_lo);
        self.axis_hi = self.axis_hi.max(other.axis_hi);
        self.intensity += other.intensity;
        self.count += other.count;
    }

    /// ‖I‖ (α² + c² (1 − cos β)²) with the cone taken from the box around the axes: its half diagonal is
    /// the chord 2 sin(β/2), so 1 − cos β = diagonal²/8. `c2` is c².
    pub(super) fn cost(&self, context: &Context, c2: f32) -> f64 {
        let alpha2 = (self.hi - self.lo).length_squared();
        let spread = if context.oriented {
            (self.axis_hi - self.axis_lo).length_squared() / 8.0
        } else {
            0.0
        };
        self.intensity * f64::from(alpha2 + c2 * spread * spread)
    }
}

/// Six numbers that a cluster may be split along.
#[derive(Clone, Copy)]
struct Grid {
    lo: [f32; 6],
    scale: [f32; 6],
    bins: usize,
    dims: usize,
}

impl Grid {
    /// Of up to `most` bins.
    fn over(context: &Context, items: &[Item], stride: usize, most: usize) -> Self {
        let dims = if context.oriented { 6 } else { 3 };
        let mut lo = (Vec3::INFINITY, Vec3::INFINITY);
        let mut hi = (Vec3::NEG_INFINITY, Vec3::NEG_INFINITY);
        for i in items.iter().step_by(stride) {
            lo = (lo.0.min(i.position), lo.1.min(i.axis));
            hi = (hi.0.max(i.position), hi.1.max(i.axis));
        }
        let (lo, hi) = (six(lo.0, lo.1), six(hi.0, hi.1));
        let bins = most.min(items.len()).max(2);
        // An axis without extent puts everything into bin 0; its scale must not be 0/0.
        let mut scale = [0.0; 6];
        for d in 0..dims {
            let bins = bins as f32 / (hi[d] - lo[d]);
            if bins.is_finite() {
                scale[d] = bins;
            }
        }
        Self {
            lo,
            scale,
            bins,
            dims,
        }
    }

    #[inline]
    fn bin(&self, d: usize, x: f32) -> usize {
        // The cast saturates: values outside the judged lights' range go to the end bins.
        (((x - self.lo[d]) * self.scale[d]) as usize).min(self.bins - 1)
    }
}

fn six(a: Vec3, b: Vec3) -> [f32; 6] {
    [a.x, a.y, a.z, b.x, b.y, b.z]
}

/// Reorders `items` into two clusters of least cost and returns the size of the first.
pub(super) fn split(context: &Context, items: &mut [Item]) -> usize {
    // Most clusters are small, and bins that they have no use for would be most of the work.
    match items.len() {
        2 => 1,
        3..=4 => split_into::<4>(context, items),
        5..=8 => split_into::<8>(context, items),
        _ => split_into::<BINS>(context, items),
    }
}

/// [`split`] with up to `B` bins an axis.
fn split_into<const B: usize>(context: &Context, items: &mut [Item]) -> usize {
    let n = items.len();
    let stride = n.div_ceil(JUDGED).max(1);
    let grid = Grid::over(context, items, stride, B);
    let mut bins = [[Bin::EMPTY; B]; 6];
    for item in items.iter().step_by(stride) {
        let coordinates = six(item.position, item.axis);
        let (position, axis) = (Vec3A::from(item.position), Vec3A::from(item.axis));
        for (d, bins) in bins.iter_mut().enumerate().take(grid.dims) {
            bins[grid.bin(d, coordinates[d])].add(position, axis, item.intensity);
        }
    }
    let c2 = context.diagonal2 * DIRECTION;
    let mut best: Option<(f64, usize, usize)> = None;
    for (d, bins) in bins.iter().enumerate().take(grid.dims) {
        if grid.scale[d] == 0.0 {
            continue;
        }
        let mut right_cost = [0.0; B];
        let mut right = Bin::EMPTY;
        for b in (1..grid.bins).rev() {
            right.merge(&bins[b]);
            right_cost[b] = if right.count > 0 {
                right.cost(context, c2)
            } else {
                f64::INFINITY
            };
        }
        let mut left = Bin::EMPTY;
        for b in 1..grid.bins {
            left.merge(&bins[b - 1]);
            if left.count == 0 || right_cost[b] == f64::INFINITY {
                continue;
            }
            let cost = left.cost(context, c2) + right_cost[b];
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, d, b));
            }
        }
    }
    let Some((_, d, first_right)) = best else {
        return halve(items);
    };
    let left = partition(items, |i| {
        grid.bin(d, six(i.position, i.axis)[d]) < first_right
    });
    if left == 0 || left == n {
        halve(items)
    } else {
        left
    }
}
