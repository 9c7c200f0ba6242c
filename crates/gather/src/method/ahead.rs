//! What was drawn for points before their turn.

use crate::point::GatherPoint;

/// Items that are kept at most, a few megabytes: where a point has thousands, they are work enough by themselves.
const MOST: usize = 1 << 17;

/// The first of `points`, so many that not too much is kept if each has `items`. The others are seen to in their turn.
pub(super) fn first_points(points: &[GatherPoint], items: u32) -> &[GatherPoint] {
    let most = MOST / items.max(1) as usize;
    &points[..points.len().min(most)]
}

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

    /// Adds a point, whose items are the next `count`.
    pub(super) fn push(&mut self, x: &GatherPoint, count: usize) {
        let from = self.points.last().map_or(0, |last| last.end);
        self.points.push(Point {
            slot: x.slot,
            bounce: x.bounce,
            end: from + count,
        });
    }

    /// The items of all points, in their order, to append some.
    pub(super) fn items(&mut self) -> &mut Vec<T> {
        &mut self.items
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

    /// Those of the point whose turn comes after so many others; none behind the last.
    pub(super) fn coming(&self, after: usize) -> &[T] {
        &self.items[self.range(self.taken + after)]
    }

    fn range(&self, point: usize) -> std::ops::Range<usize> {
        let end = |point: usize| self.points.get(point).map_or(self.items.len(), |p| p.end);
        match point {
            0 => 0..end(0),
            _ => end(point - 1)..end(point),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use light_tree::{LightSet, TreeBuilder};
    use sampling::{Purpose, Rng};
    use scene::trace::Tracer;

    use super::*;
    use crate::Inputs;
    use crate::contribution::VirtualShape;
    use crate::learned::Learned;
    use crate::method::conformance::{gather_points, radiances, room};
    use crate::method::{Method, StochasticLightcuts};
    use crate::shadow_queue::{QueueScratch, ShadowQueue};
    use crate::tile_points::TilePoints;

    #[test]
    fn lists_come_in_the_order_of_points() {
        let points: Vec<_> = gather_points(&room(false))
            .into_iter()
            .zip(0..)
            .map(|(x, slot)| GatherPoint { slot, ..x })
            .collect();
        let mut ahead = Ahead::<i32>::default();
        assert!(!ahead.has(&points[0]), "nothing was drawn yet");
        let lists = [vec![1, 2], vec![], vec![3]];
        for (x, list) in points.iter().zip(&lists) {
            ahead.push(x, list.len());
            ahead.items().extend(list);
        }
        for (i, list) in lists.iter().enumerate() {
            assert!(ahead.has(&points[i]) && !ahead.has(&points[i + 1]), "{i}");
            ahead.turn();
            assert_eq!(ahead.now(), list);
            for after in 0..3 {
                let coming = lists.get(i + 1 + after).map_or(&[][..], |list| list);
                assert_eq!(ahead.coming(after), coming, "{after} after {i}");
            }
        }
        assert!(!ahead.has(&points[3]), "all are done");
    }

    #[test]
    fn however_many_lights_a_point_has_little_is_kept() {
        let points = vec![gather_points(&room(false))[0]; 4096];
        for (items, expected) in [
            (0, 4096),
            (10, 4096),
            (1000, 131),
            (65536, 2),
            (u32::MAX, 0),
        ] {
            assert_eq!(first_points(&points, items).len(), expected, "{items} each");
        }
    }

    #[test]
    fn the_same_lights_are_drawn_ahead_and_in_turn() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        let mut lights = LightSet::default();
        for i in 0..900 {
            let (x, z) = ((i % 30) as f32 / 7.5 - 1.99, (i / 30) as f32 / 7.5 - 1.99);
            lights.push_point(glam::Vec3::new(x, 2.5, z), glam::Vec3::ONE);
        }
        let inputs = Inputs::new(lights, TreeBuilder::Binned);
        let method = StochasticLightcuts::prepare(&Default::default(), &inputs);
        let points: Vec<_> = gather_points(&scene)
            .into_iter()
            .zip(0..)
            .map(|(x, slot)| GatherPoint { slot, ..x })
            .collect();
        let stream = |slot: u32, _, purpose| Rng::new(3, u64::from(slot), 0, purpose);
        // Of the points, so many are known before their turn.
        let sums = |known: usize| -> Vec<DVec3> {
            let mut memory = QueueScratch::default();
            let shape = VirtualShape::Sphere;
            let set = &inputs.lights;
            let mut queue =
                ShadowQueue::new(&scene, set, &tracer, shape, points.len(), &mut memory);
            let mut scratch = Default::default();
            let tile = TilePoints {
                points: &points[..known],
                width: 1,
                samples: 1,
                is_milestone: true,
                centres: &[],
                probe_stream: &stream(0, 0, Purpose::Probe),
                stream: &stream,
            };
            method.begin_tile(&tile, &mut queue, &mut Learned::default(), &mut scratch);
            for x in &points {
                queue.begin_point(stream(x.slot, 0, Purpose::LightSurface));
                let rng = &mut stream(x.slot, 0, Purpose::Lights);
                method.point(x, &mut queue, rng, &mut scratch);
                queue.end_point();
            }
            radiances(queue.finish().1)
        };
        let in_turn = sums(0);
        assert!(
            in_turn.iter().any(|sum| *sum != DVec3::ZERO),
            "some are lit"
        );
        for known in [1, points.len() / 2, points.len()] {
            assert!(sums(known) == in_turn, "{known} ahead");
        }
    }
}
