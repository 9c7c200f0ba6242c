//! Round and pointed arches: two arcs on one springing line.

use crate::trig::{acos, direction};
use glam::DVec2;

/// A symmetric arch over the springing line y = 0, centred on x = 0.
///
/// Its right arc has its centre at x = `half_span` − `radius` ≤ 0, so equal values make a round
/// arch and a greater radius a pointed one. Offsets share the centres, as cut stone does.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arch {
    pub(crate) half_span: f64,
    pub(crate) radius: f64,
}

impl Arch {
    /// Half circle.
    pub(crate) fn round(half_span: f64) -> Self {
        Self {
            half_span,
            radius: half_span,
        }
    }

    /// Pointed arch of the given height; `rise` ≥ `half_span`.
    pub(crate) fn pointed(half_span: f64, rise: f64) -> Self {
        let radius = (half_span * half_span + rise * rise) / (2.0 * half_span);
        Self { half_span, radius }
    }

    /// The parallel arch `by` metres further out.
    pub(crate) fn offset(self, by: f64) -> Self {
        Self {
            half_span: self.half_span + by,
            radius: self.radius + by,
        }
    }

    /// Height of the apex.
    pub(crate) fn rise(self) -> f64 {
        let centre = self.radius - self.half_span;
        (self.radius * self.radius - centre * centre).sqrt()
    }

    /// Right arc from springing to apex in `steps` equal steps.
    pub(crate) fn right(self, steps: usize) -> Vec<DVec2> {
        let centre = self.half_span - self.radius;
        let sweep = acos(-centre / self.radius);
        let mut points: Vec<DVec2> = (0..=steps)
            .map(|k| {
                let around = direction(sweep * k as f64 / steps as f64);
                DVec2::new(centre, 0.0) + self.radius * around
            })
            .collect();
        points[steps].x = 0.0;
        points
    }

    /// Both arcs, from the right springing over the apex to the left one.
    pub(crate) fn curve(self, steps: usize) -> Vec<DVec2> {
        let right = self.right(steps);
        let left = right.iter().rev().skip(1).map(|p| DVec2::new(-p.x, p.y));
        right.iter().copied().chain(left).collect()
    }

    /// Closed opening, counter-clockwise: `drop` metres of upright jamb under the arch.
    pub(crate) fn opening(self, steps: usize, drop: f64) -> Vec<DVec2> {
        let mut points = vec![
            DVec2::new(-self.half_span, -drop),
            DVec2::new(self.half_span, -drop),
        ];
        points.extend(self.curve(steps));
        points
    }
}
