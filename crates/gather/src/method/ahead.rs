//! What was drawn for points before their turn.

use crate::point::GatherPoint;

/// Lists of `T` for points that a method will be handed, in that order.
#[derive(Debug)]
pub(super) struct Ahead<T> {
    items: Vec<T>,
    points: Vec<Point>,
    /// How many points had their turn.
    taken: usize,
}

#[derive(Debug)]
struct Point {
    slot: u32,
    bounce: u32,
    /// Where its items end.
    end: usize,
}

impl<T> Default for Ahead<T> {
    fn default() -> Self {
        Self {
            items: Vec::new(),
            points: Vec::new(),
            taken: 0,
        }
    }
}

impl<T> Ahead<T> {
    pub(super) fn clear(&mut self) {
        self.items.clear();
        self.points.clear();
        self.taken = 0;
    }

    /// Adds a point with its items.
    pub(super) fn push(&mut self, x: &GatherPoint, items: impl IntoIterator<Item = T>) {
        self.items.extend(items);
        self.points.push(Point {
            slot: x.slot,
            bounce: x.bounce,
            end: self.items.len(),
        });
    }

    /// Whether `x` is the next point.
    pub(super) fn has(&self, x: &GatherPoint) -> bool {
        let next = self.points.get(self.taken);
        next.is_some_and(|next| next.slot == x.slot && next.bounce == x.bounce)
    }

    /// It is the next point's turn.
    pub(super) fn turn(&mut self) {
        self.taken += 1;
    }

    /// The items of the point whose turn it is.
    pub(super) fn now(&self) -> &[T] {
        &self.items[self.range(self.taken - 1)]
    }

    /// Those of the one after it; none where it was the last.
    pub(super) fn next(&self) -> &[T] {
        &self.items[self.range(self.taken)]
    }

    fn range(&self, point: usize) -> std::ops::Range<usize> {
        let end = |point: usize| self.points.get(point).map_or(self.items.len(), |p| p.end);
        match point {
            0 => 0..end(0),
            _ => end(point - 1)..end(point),
        }
    }
}
