//! A tree over the gather points of one pixel.
//!
//! Source: Walter et al., "Multidimensional Lightcuts", 2006, §3: a binary tree over position and direction,
//! built anew for each pixel.

use glam::{DVec3, Vec3};
use light_tree::{Cone, Receivers};

use crate::error_bound::Reflection;
use crate::point::GatherPoint;

/// Index of a node in a [`GatherTree`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct GatherId(u32);

/// A cluster of gather points.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GatherNode {
    /// All of them, as bounds see them.
    pub(crate) receivers: Receivers,
    /// The greatest reflection of any.
    pub(crate) reflection: Reflection,
    /// Sum of their strengths.
    pub(crate) strength: DVec3,
    /// They are those in these places of the tree's order.
    first: u32,
    count: u32,
    /// Squared diagonal of the box around them.
    pub(crate) diagonal2: f32,
    /// `None` for a single point.
    pub(crate) children: Option<[GatherId; 2]>,
}

impl GatherNode {
    /// Whether the point in `place` is one of them.
    pub(crate) fn contains(&self, place: u32) -> bool {
        (self.first..self.first + self.count).contains(&place)
    }
}

/// What only building needs to know of a node.
#[derive(Debug, Clone, Copy)]
struct Extent {
    lo: Vec3,
    hi: Vec3,
    normals: Cone,
    mirrors: Option<Cone>,
}

impl Extent {
    fn of(x: &GatherPoint) -> Self {
        Self {
            lo: x.position,
            hi: x.position,
            normals: Cone::of(x.ns),
            mirrors: x.mirror().map(Cone::of),
        }
    }

    fn union(&self, other: &Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
            normals: self.normals.union(other.normals),
            mirrors: match (self.mirrors, other.mirrors) {
                (Some(a), Some(b)) => Some(a.union(b)),
                (a, b) => a.or(b),
            },
        }
    }
}

/// A point by what it is sorted by.
#[derive(Debug, Clone, Copy)]
struct Item {
    /// Position, and normal in the same unit.
    at: [f32; 6],
    point: u32,
}

/// A binary tree over gather points; memory is kept when it is built anew.
#[derive(Debug, Default)]
pub(crate) struct GatherTree {
    nodes: Vec<GatherNode>,
    items: Vec<Item>,
}

impl GatherTree {
    /// Builds the tree over `points` and returns its root; `None` when there is no point. Normals that differ by
    /// a length of 1 count like positions that differ by `per_normal`.
    pub(crate) fn build(&mut self, points: &[GatherPoint], per_normal: f32) -> Option<GatherId> {
        self.nodes.clear();
        self.items.clear();
        self.items.extend(points.iter().zip(0..).map(|(x, point)| {
            let (p, n) = (x.position, x.ns * per_normal);
            Item {
                at: [p.x, p.y, p.z, n.x, n.y, n.z],
                point,
            }
        }));
        let mut items = std::mem::take(&mut self.items);
        let root = (!items.is_empty()).then(|| self.subtree(points, &mut items, 0).0);
        self.items = items;
        root
    }

    /// The node at `id`.
    pub(crate) fn node(&self, id: GatherId) -> &GatherNode {
        &self.nodes[id.0 as usize]
    }

    /// Draws one of the points of node `id` in proportion to strength, by a number `u` in [0, 1), and returns its
    /// place in the tree's order.
    pub(crate) fn draw(&self, id: GatherId, mut u: f64) -> u32 {
        let mut node = self.node(id);
        while let Some([a, b]) = node.children {
            let (a, b) = (self.node(a), self.node(b));
            let (one, two) = (a.strength.element_sum(), b.strength.element_sum());
            // Without any strength, any point.
            let share = if one + two > 0.0 {
                one / (one + two)
            } else {
                0.5
            };
            (node, u) = if u < share {
                (a, u / share)
            } else {
                (b, (u - share) / (1.0 - share))
            };
        }
        node.first
    }

    /// The point in `place` of the tree's order, as an index into the points it was built over.
    pub(crate) fn point(&self, place: u32) -> usize {
        self.items[place as usize].point as usize
    }

    /// The point of a leaf, likewise; the first one of other nodes.
    pub(crate) fn first_point(&self, id: GatherId) -> usize {
        self.point(self.node(id).first)
    }

    /// Number of nodes.
    pub(crate) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// All nodes, children before their parents.
    pub(crate) fn ids(&self) -> impl DoubleEndedIterator<Item = GatherId> + use<> {
        (0..self.nodes.len() as u32).map(GatherId)
    }

    fn subtree(
        &mut self,
        points: &[GatherPoint],
        items: &mut [Item],
        first: u32,
    ) -> (GatherId, Extent) {
        let count = items.len() as u32;
        if let [item] = items {
            let x = &points[item.point as usize];
            let node = GatherNode {
                receivers: x.receivers(),
                reflection: Reflection::of(x),
                strength: x.strength.as_dvec3(),
                first,
                count,
                diagonal2: 0.0,
                children: None,
            };
            return (self.push(node), Extent::of(x));
        }
        // Halved along the axis of greatest extent: the depth is the logarithm of the number of points.
        let axis = longest_axis(items);
        let (left, _, _) = items.select_nth_unstable_by(items.len() / 2, |a, b| {
            a.at[axis]
                .total_cmp(&b.at[axis])
                .then(a.point.cmp(&b.point))
        });
        let half = left.len();
        let (left, right) = items.split_at_mut(half);
        let (a, extent_a) = self.subtree(points, left, first);
        let (b, extent_b) = self.subtree(points, right, first + half as u32);
        let extent = extent_a.union(&extent_b);
        let (node_a, node_b) = (self.node(a), self.node(b));
        let node = GatherNode {
            receivers: Receivers::within(extent.lo, extent.hi, extent.normals, extent.mirrors),
            reflection: node_a.reflection.max(&node_b.reflection),
            strength: node_a.strength + node_b.strength,
            first,
            count,
            diagonal2: (extent.hi - extent.lo).length_squared(),
            children: Some([a, b]),
        };
        (self.push(node), extent)
    }

    fn push(&mut self, node: GatherNode) -> GatherId {
        self.nodes.push(node);
        GatherId(self.nodes.len() as u32 - 1)
    }
}

impl GatherId {
    /// As an index into arrays of [`GatherTree::len`].
    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

fn longest_axis(items: &[Item]) -> usize {
    let extent = |d: usize| {
        let (lo, hi) = items
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), i| {
                (lo.min(i.at[d]), hi.max(i.at[d]))
            });
        hi - lo
    };
    let mut best = (0, extent(0));
    for d in 1..6 {
        let e = extent(d);
        if e > best.1 {
            best = (d, e);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::method::conformance::room;
    use crate::method::fixtures::many_points;

    #[test]
    fn every_point_is_in_one_leaf_and_below_a_node_with_its_strength() {
        for (count, per_normal) in [(1, 1.0), (2, 0.0), (3, 1.0), (64, 0.1), (257, 10.0)] {
            let mut points = many_points(&room(true));
            points.truncate(count);
            for (i, x) in points.iter_mut().enumerate() {
                x.strength = Vec3::splat((i % 3) as f32);
            }
            let mut tree = GatherTree::default();
            let root = tree.build(&points, per_normal).expect("points");
            let mut seen = vec![0; points.len()];
            let mut stack = vec![(root, 0)];
            while let Some((id, depth)) = stack.pop() {
                assert!(depth <= 9, "too deep");
                let node = tree.node(id);
                let Some(children) = node.children else {
                    seen[tree.first_point(id)] += 1;
                    continue;
                };
                let [a, b] = children.map(|c| tree.node(c));
                assert_eq!(node.strength, a.strength + b.strength, "strength");
                assert_eq!(node.count, a.count + b.count, "points");
                for place in 0..points.len() as u32 {
                    let of_children = (a.contains(place), b.contains(place));
                    assert_ne!(of_children, (true, true), "in both children");
                    let of_one = of_children.0 || of_children.1;
                    assert_eq!(node.contains(place), of_one, "place {place}");
                }
                assert!(children.iter().all(|c| c.0 < id.0), "children come first");
                stack.extend(children.map(|c| (c, depth + 1)));
            }
            assert!(seen.iter().all(|n| *n == 1), "{count} points: {seen:?}");
        }
        assert_eq!(GatherTree::default().build(&[], 1.0), None, "no points");
    }

    #[test]
    fn points_are_drawn_in_proportion_to_their_strength() {
        let mut points = many_points(&room(false));
        points.truncate(5);
        for (i, x) in points.iter_mut().enumerate() {
            x.strength = Vec3::splat(i as f32);
        }
        let mut tree = GatherTree::default();
        let root = tree.build(&points, 1.0).expect("points");
        let mut counts = [0; 5];
        for i in 0..1000 {
            let place = tree.draw(root, f64::from(i) / 1000.0);
            assert!(tree.node(root).contains(place), "place {place}");
            counts[tree.point(place)] += 1;
        }
        for (i, count) in counts.into_iter().enumerate() {
            let expected = 100 * i as i32;
            assert!(
                i32::abs(count - expected) <= 5,
                "{count} instead of {expected}"
            );
        }
    }
}
