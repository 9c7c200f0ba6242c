//! The surface area orientation heuristic.
//!
//! Source: Conty Estevez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018,
//! §4: cost = K_r (E_l A_l M_l + E_r A_r M_r), E power, A surface area, M the measure of the emission
//! directions, K_r the longest extent over the one that is split.

use std::f32::consts::PI;

use glam::{Vec3, Vec3A};

use super::{Context, Item, JUDGED, halve, partition, position_bounds};
use crate::cone::Cone;

/// Buckets along each axis, as published.
const BUCKETS: usize = 12;

/// Lights in one slice of an axis.
#[derive(Clone, Copy)]
struct Bucket {
    lo: Vec3A,
    hi: Vec3A,
    cone: Option<Cone>,
    energy: f64,
}

impl Bucket {
    const EMPTY: Self = Self {
        lo: Vec3A::INFINITY,
        hi: Vec3A::NEG_INFINITY,
        cone: None,
        energy: 0.0,
    };

    fn add(&mut self, item: &Item) {
        let position = Vec3A::from(item.position);
        self.merge(&Self {
            lo: position,
            hi: position,
            cone: Some(Cone::of(item.axis)),
            energy: f64::from(item.intensity),
        });
    }

    fn merge(&mut self, other: &Self) {
        self.lo = self.lo.min(other.lo);
        self.hi = self.hi.max(other.hi);
        self.energy += other.energy;
        self.cone = match (self.cone, other.cone) {
            (Some(a), Some(b)) => Some(a.union(b)),
            (a, b) => a.or(b),
        };
    }

    /// E A M, 0 for lights in one place. The area of lights on a line is that of a thin box: a product with an area of 0
    /// would leave them in the order they came in.
    fn cost(&self, orientation: bool) -> f64 {
        let Some(cone) = self.cone else {
            return f64::INFINITY;
        };
        let e = self.hi - self.lo;
        let area = 2.0 * (e.x * e.y + e.y * e.z + e.z * e.x);
        let size = area.max(LEAST_AREA * e.length_squared());
        let measure = if orientation {
            orientation_measure(cone)
        } else {
            1.0
        };
        self.energy * f64::from(size * measure)
    }
}

/// Least area of a box for the square of its diagonal: that of one a thousand times as long as thick.
const LEAST_AREA: f32 = 4e-3;

/// M_Ω for emission spread of a right angle beyond the cone, as of Lambertian emitters.
fn orientation_measure(cone: Cone) -> f32 {
    let theta_o = cone.cos.clamp(-1.0, 1.0).acos();
    let theta_w = (theta_o + PI / 2.0).min(PI);
    2.0 * PI * (1.0 - theta_o.cos())
        + PI / 2.0
            * (2.0 * theta_w * theta_o.sin()
                - (theta_o - 2.0 * theta_w).cos()
                - 2.0 * theta_o * theta_o.sin()
                + theta_o.cos())
}

/// Reorders `items` into the two clusters of least cost and returns the size of the first.
pub(super) fn split(context: &Context, items: &mut [Item]) -> usize {
    let n = items.len();
    if n == 2 {
        return 1;
    }
    let (lo, hi) = position_bounds(items);
    let extent = hi - lo;
    let scale = Vec3::from_array(extent.to_array().map(|e| {
        let scale = BUCKETS as f32 / e;
        if scale.is_finite() { scale } else { 0.0 }
    }));
    let bucket = |axis: usize, item: &Item| {
        (((item.position[axis] - lo[axis]) * scale[axis]) as usize).min(BUCKETS - 1)
    };
    let mut buckets = [[Bucket::EMPTY; BUCKETS]; 3];
    for item in items.iter().step_by(n.div_ceil(JUDGED).max(1)) {
        for (axis, buckets) in buckets.iter_mut().enumerate() {
            buckets[bucket(axis, item)].add(item);
        }
    }
    let mut best: Option<(f64, usize, usize)> = None;
    for (axis, buckets) in buckets.iter().enumerate() {
        if scale[axis] == 0.0 {
            continue;
        }
        // Elongated boxes are split across their length.
        let regular = f64::from(extent.max_element() / extent[axis]);
        let mut right_cost = [f64::INFINITY; BUCKETS];
        let mut right = Bucket::EMPTY;
        for b in (1..BUCKETS).rev() {
            right.merge(&buckets[b]);
            right_cost[b] = right.cost(context.oriented);
        }
        let mut left = Bucket::EMPTY;
        for b in 1..BUCKETS {
            left.merge(&buckets[b - 1]);
            let cost = regular * (left.cost(context.oriented) + right_cost[b]);
            if cost.is_finite() && best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, b));
            }
        }
    }
    let Some((_, axis, first_right)) = best else {
        return halve(items);
    };
    let left = partition(items, |i| bucket(axis, i) < first_right);
    if left == 0 || left == n {
        halve(items)
    } else {
        left
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_measure_grows_from_a_hemisphere_of_lambertian_emission_to_the_sphere() {
        // One direction with Lambertian spread has ∫ cos over the hemisphere = π; every direction has 4π.
        let one = orientation_measure(Cone::of(Vec3::Y));
        assert!((one - PI).abs() < 1e-4, "one direction: {one}");
        let all = orientation_measure(Cone::SPHERE);
        assert!((all - 4.0 * PI).abs() < 1e-4, "all directions: {all}");
    }
}
