//! How large virtual spherical lights should be: as far as their neighbours are away.

use glam::Vec3;
use light_tree::{LightId, LightSet};
use rayon::prelude::*;

/// Lights a bucket of the search tree at most.
const BUCKET: usize = 12;
/// Most neighbours that can be asked for.
const MOST: usize = 64;
/// Radius over the median radius, at most: where lights are sparse, wider spheres would blur over whole walls and shine past
/// what is between them.
const WIDEST: f32 = 8.0;

/// Gives each virtual light the distance to its `k`-th nearest virtual neighbour as radius, `k` from 1 to 64, and at most 8
/// times the median of those; radius 0 when there are no more than `k` virtual lights.
///
/// Spheres of this size overlap about `k`-fold everywhere, which is wide enough to hide single lights where they are sparse and
/// narrow enough to keep shadows in corners where they are dense. With n lights on surfaces it shrinks as 1/√n. The same for
/// any number of threads.
///
/// Source: Hašan, Křivánek, Walter, Bala, "Virtual Spherical Lights", 2009, §5.
///
/// # Panics
/// When `k` is out of range.
pub fn set_local_radii(lights: &mut LightSet, k: usize) {
    assert!((1..=MOST).contains(&k), "{k} neighbours");
    let n = lights.virtual_count();
    if n <= k {
        lights.set_radius(0.0);
        return;
    }
    let first = lights.len() - n;
    let positions = (first..lights.len()).map(|i| lights.position(LightId(i as u32)));
    let buckets = Buckets::over(positions.collect());
    let mut radii = buckets.distances(k);
    let mut sorted = radii.clone();
    let (_, &mut median, _) = sorted.select_nth_unstable_by(n / 2, f32::total_cmp);
    let most = WIDEST * median;
    for radius in &mut radii {
        *radius = radius.min(most);
    }
    lights.set_radii(radii);
}

/// A balanced tree over points: behind a node's box come all those of its first child, then those of its second.
struct Buckets {
    /// Points with their index, bucket by bucket.
    points: Vec<(Vec3, u32)>,
    /// Least and greatest corner of each node's points.
    boxes: Vec<[Vec3; 2]>,
    /// Edges from the root to the buckets.
    levels: u32,
}

impl Buckets {
    fn over(positions: Vec<Vec3>) -> Self {
        let mut points: Vec<(Vec3, u32)> = positions.into_iter().zip(0..).collect();
        let levels = points.len().div_ceil(BUCKET).next_power_of_two().ilog2();
        let mut boxes = vec![[Vec3::ZERO; 2]; (2 << levels) - 1];
        divide(&mut points, &mut boxes, levels);
        Self {
            points,
            boxes,
            levels,
        }
    }

    /// Distance of every point to its `k`-th nearest other, in the order the points were given.
    fn distances(&self, k: usize) -> Vec<f32> {
        let mut by_place = vec![0.0f32; self.points.len()];
        by_place
            .par_chunks_mut(1024)
            .enumerate()
            .for_each(|(chunk, distances)| {
                for (i, distance) in distances.iter_mut().enumerate() {
                    *distance = self.distance(chunk * 1024 + i, k);
                }
            });
        let mut distances = vec![0.0; self.points.len()];
        for (&(_, index), distance) in self.points.iter().zip(by_place) {
            distances[index as usize] = distance;
        }
        distances
    }

    fn distance(&self, place: usize, k: usize) -> f32 {
        let p = self.points[place].0;
        // Squared distances of the k nearest so far, greatest last.
        let mut nearest = [f32::INFINITY; MOST];
        let nearest = &mut nearest[..k];
        let mut stack = [Node::default(); 64];
        let mut height = 1;
        stack[0] = Node {
            dist2: 0.0,
            at: 0,
            first: 0,
            end: self.points.len(),
            levels: self.levels,
        };
        while height > 0 {
            height -= 1;
            let node = stack[height];
            if node.dist2 >= nearest[k - 1] {
                continue;
            }
            if node.levels == 0 {
                for (i, (q, _)) in self.points[node.first..node.end].iter().enumerate() {
                    let dist2 = q.distance_squared(p);
                    if dist2 < nearest[k - 1] && node.first + i != place {
                        insert(nearest, dist2);
                    }
                }
                continue;
            }
            let children = node.children().map(|child| Node {
                dist2: self.dist2(child.at, p),
                ..child
            });
            let near = usize::from(children[1].dist2 < children[0].dist2);
            stack[height] = children[1 - near];
            stack[height + 1] = children[near];
            height += 2;
        }
        nearest[k - 1].sqrt()
    }

    /// Squared distance of `p` to the box at `at`.
    fn dist2(&self, at: usize, p: Vec3) -> f32 {
        let [lo, hi] = self.boxes[at];
        (lo - p).max(p - hi).max(Vec3::ZERO).length_squared()
    }
}

/// A node under search.
#[derive(Clone, Copy, Default)]
struct Node {
    dist2: f32,
    /// Its place among the boxes.
    at: usize,
    first: usize,
    end: usize,
    /// Levels below it.
    levels: u32,
}

impl Node {
    fn children(&self) -> [Self; 2] {
        let middle = (self.first + self.end) / 2;
        let levels = self.levels - 1;
        let below = (2 << levels) - 1;
        [
            Self {
                at: self.at + 1,
                end: middle,
                levels,
                ..*self
            },
            Self {
                at: self.at + 1 + below,
                first: middle,
                levels,
                ..*self
            },
        ]
    }
}

/// Halves the points along the longest axis of their box, `levels` times over, and notes the boxes.
fn divide(points: &mut [(Vec3, u32)], boxes: &mut [[Vec3; 2]], levels: u32) {
    let (mut lo, mut hi) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (p, _) in &*points {
        (lo, hi) = (lo.min(*p), hi.max(*p));
    }
    boxes[0] = [lo, hi];
    if levels == 0 {
        return;
    }
    let axis = (hi - lo).max_position();
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |a, b| {
        a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1))
    });
    let (left, right) = points.split_at_mut(middle);
    let below = boxes.len() / 2;
    let (boxes_left, boxes_right) = boxes[1..].split_at_mut(below);
    if middle > 4096 {
        rayon::join(
            || divide(left, boxes_left, levels - 1),
            || divide(right, boxes_right, levels - 1),
        );
    } else {
        divide(left, boxes_left, levels - 1);
        divide(right, boxes_right, levels - 1);
    }
}

/// Puts `dist2` in its place and drops the last.
fn insert(nearest: &mut [f32], dist2: f32) {
    let mut at = nearest.len() - 1;
    while at > 0 && nearest[at - 1] > dist2 {
        nearest[at] = nearest[at - 1];
        at -= 1;
    }
    nearest[at] = dist2;
}

#[cfg(test)]
mod tests {
    use super::*;
    use light_tree::VirtualLight;
    use sampling::{Purpose, Rng};

    fn lights_at(positions: impl Iterator<Item = Vec3>) -> LightSet {
        let mut lights = LightSet::default();
        lights.push_point(Vec3::ZERO, Vec3::ONE);
        for position in positions {
            lights.push_virtual(&VirtualLight {
                position,
                normal: Vec3::Y,
                intensity: Vec3::ONE,
                gloss: None,
            });
        }
        lights
    }

    #[test]
    fn the_distance_on_a_grid_is_the_grids() {
        let at = |i: u32| Vec3::new((i % 50) as f32, 0.0, (i / 50) as f32) * 0.5;
        let mut lights = lights_at((0..2500).map(at));
        let middle = LightId(1 + 25 * 50 + 25);
        set_local_radii(&mut lights, 4);
        assert_eq!(lights.radius(middle), 0.5, "four at half a unit");
        assert_eq!(
            lights.radius(LightId(1)),
            1.0,
            "in the corner two, then two"
        );
        set_local_radii(&mut lights, 8);
        assert_eq!(lights.radius(middle), 0.5 * 2.0f32.sqrt(), "the diagonal");
        let mut few = lights_at((0..4).map(at));
        set_local_radii(&mut few, 4);
        assert_eq!(few.greatest_radius(), 0.0, "no fourth neighbour");
    }

    #[test]
    fn neighbours_are_those_that_a_look_at_all_finds() {
        let mut rng = Rng::new(3, 0, 0, Purpose::Build);
        for n in [12, 13, 100, 3000] {
            // Dense and sparse places, points that coincide, and a flat box.
            let mut positions: Vec<Vec3> = (0..n)
                .map(|i| match i % 4 {
                    0 => Vec3::new(rng.f32(), 0.0, rng.f32()) * 100.0,
                    1 => Vec3::new(rng.f32(), rng.f32(), 0.0) * 1e-3,
                    2 => Vec3::new(rng.f32(), 0.0, rng.f32()),
                    _ => Vec3::splat((i / 8) as f32),
                })
                .collect();
            positions[n - 1] = Vec3::new(1e6, 0.0, 0.0);
            let found = Buckets::over(positions.clone()).distances(10);
            for (i, p) in positions.iter().enumerate() {
                let mut all: Vec<f32> = positions.iter().map(|q| q.distance_squared(*p)).collect();
                all.swap_remove(i);
                all.sort_by(f32::total_cmp);
                assert_eq!(found[i], all[9].sqrt(), "point {i} of {n}");
            }
        }
    }

    #[test]
    fn no_sphere_is_much_wider_than_most() {
        let dense = (0..400).map(|i| Vec3::new((i % 20) as f32, 0.0, (i / 20) as f32));
        let far = std::iter::once(Vec3::new(1e4, 0.0, 0.0));
        let mut lights = lights_at(dense.chain(far));
        set_local_radii(&mut lights, 4);
        assert_eq!(lights.greatest_radius(), 8.0, "eight times the usual 1");
    }
}
