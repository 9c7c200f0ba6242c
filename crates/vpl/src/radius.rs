//! How large virtual spherical lights should be: as far as their neighbours are away.

use glam::Vec3;
use light_tree::LightSet;
use rayon::prelude::*;

/// The neighbour that a sphere reaches to.
const NEIGHBOURS: usize = 10;
/// Radius over the median radius, at most: where lights are sparse, wider spheres would blur over whole walls and shine past
/// what is between them.
const WIDEST: f32 = 8.0;

/// Gives each virtual light the distance to its tenth nearest virtual neighbour as radius, but at most 8 times the median of
/// those; radius 0 when there are no more than ten virtual lights.
///
/// Spheres of this size overlap about tenfold everywhere, which is wide enough to hide single lights where they are sparse and
/// narrow enough to keep shadows in corners where they are dense. With n lights on surfaces it shrinks as 1/√n. The same for
/// any number of threads.
///
/// Source: Hašan, Křivánek, Walter, Bala, "Virtual Spherical Lights", 2009, §5.
pub fn set_local_radii(lights: &mut LightSet) {
    lights.set_radii(radii::<NEIGHBOURS>(&lights.virtual_positions()));
}

/// Radii of spheres at `positions` that reach the `K`-th neighbour; none when there are no more than `K`.
fn radii<const K: usize>(positions: &[Vec3]) -> Vec<f32> {
    if positions.len() <= K {
        return Vec::new();
    }
    let buckets = Buckets::over(positions);
    let found = buckets.farthest::<K>();
    let (mut radii, median) = rayon::join(
        || buckets.in_given_order(&found),
        || median(buckets.by_bucket(&found).map(|(_, dist2)| dist2).collect()),
    );
    let widest = WIDEST * median.sqrt();
    for radius in &mut radii {
        *radius = radius.sqrt().min(widest);
    }
    radii
}

/// The number that half of `numbers` exceed.
fn median(mut numbers: Vec<f32>) -> f32 {
    let middle = numbers.len() / 2;
    *numbers.select_nth_unstable_by_key(middle, |x| order(*x)).1
}

/// Ascending as the numbers are.
#[inline]
fn order(x: f32) -> i32 {
    let bits = x.to_bits() as i32;
    bits ^ (bits >> 31 & i32::MAX)
}

/// Points looked at together.
const LANES: usize = 8;
type Lanes = [f32; LANES];

/// A few points that lie together, one a lane; lanes beyond `len` repeat the last, and nothing found for them counts.
struct Bucket {
    axes: [Lanes; 3],
    /// Their places in the order in which points were given.
    indices: [u32; LANES],
    len: usize,
}

impl Bucket {
    /// Of 1 to 8 points with their index.
    fn of(points: &[(Vec3, u32)]) -> Self {
        let mut bucket = Self {
            axes: [[0.0; LANES]; 3],
            indices: [0; LANES],
            len: points.len(),
        };
        for lane in 0..LANES {
            let (p, index) = points[lane.min(points.len() - 1)];
            for axis in 0..3 {
                bucket.axes[axis][lane] = p[axis];
            }
            bucket.indices[lane] = index;
        }
        bucket
    }

    #[inline(always)]
    fn point(&self, lane: usize) -> Vec3 {
        let [x, y, z] = &self.axes;
        Vec3::new(x[lane], y[lane], z[lane])
    }

    fn bounds(&self) -> Bounds {
        let points = (0..self.len).map(|lane| self.point(lane));
        points.fold(Bounds::NONE, |bounds, p| {
            bounds.union(Bounds { lo: p, hi: p })
        })
    }

    /// Squared distances of its points to `p`. Without closures: they would not be compiled for the wider instructions.
    #[inline(always)]
    fn dist2(&self, p: Vec3) -> Lanes {
        let mut dist2 = [0.0; LANES];
        for (axis, p) in self.axes.iter().zip(p.to_array()) {
            for lane in 0..LANES {
                let away = axis[lane] - p;
                dist2[lane] += away * away;
            }
        }
        dist2
    }
}

#[derive(Clone, Copy)]
struct Bounds {
    lo: Vec3,
    hi: Vec3,
}

impl Bounds {
    const NONE: Self = Self {
        lo: Vec3::INFINITY,
        hi: Vec3::NEG_INFINITY,
    };

    fn union(self, other: Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
        }
    }

    /// Least squared distance between points of the two; rounded no higher than that of any two points, as every step is
    /// monotonic.
    #[inline(always)]
    fn dist2(&self, other: &Self) -> f32 {
        let gap = (self.lo - other.hi).max(other.lo - self.hi);
        gap.max(Vec3::ZERO).length_squared()
    }
}

/// A balanced tree over points. Node 1 is the root, and the children of node i are 2i and 2i + 1; those of the last level are
/// the buckets.
struct Buckets {
    buckets: Vec<Bucket>,
    /// By node; what is at 0 is not used.
    bounds: Vec<Bounds>,
}

impl Buckets {
    /// Over at least one point.
    fn over(positions: &[Vec3]) -> Self {
        let numbered = positions.par_iter().enumerate();
        let mut points: Vec<_> = numbered.map(|(i, &p)| (p, i as u32)).collect();
        let count = points.len().div_ceil(LANES).next_power_of_two();
        let levels = count.ilog2();
        divide(&mut points, levels);
        let bucket = |b| Bucket::of(&points[range(b, levels, points.len())]);
        let buckets: Vec<_> = (0..count).into_par_iter().map(bucket).collect();
        let mut bounds = vec![Bounds::NONE; 2 * count];
        let lowest = bounds[count..].par_iter_mut().zip(&buckets);
        lowest.for_each(|(bounds, bucket)| *bounds = bucket.bounds());
        for i in (1..count).rev() {
            bounds[i] = bounds[2 * i].union(bounds[2 * i + 1]);
        }
        Self { buckets, bounds }
    }

    /// For each bucket the squared distances of its points to their `K`-th nearest others; infinite where there is none.
    fn farthest<const K: usize>(&self) -> Vec<Lanes> {
        let buckets = (0..self.buckets.len()).into_par_iter();
        buckets.map(|b| self.farthest_of::<K>(b)).collect()
    }

    /// Index of each point, and what was `found` for it.
    fn by_bucket(&self, found: &[Lanes]) -> impl Iterator<Item = (u32, f32)> {
        let of = |(bucket, found): (&Bucket, &Lanes)| {
            let (indices, found) = (bucket.indices, *found);
            (0..bucket.len).map(move |lane| (indices[lane], found[lane]))
        };
        self.buckets.iter().zip(found).flat_map(of)
    }

    /// What was `found`, in the order the points were given.
    fn in_given_order(&self, found: &[Lanes]) -> Vec<f32> {
        let points = self.buckets.iter().map(|bucket| bucket.len).sum();
        let mut ordered = vec![0.0; points];
        for (index, found) in self.by_bucket(found) {
            ordered[index as usize] = found;
        }
        ordered
    }

    /// Squared distances of the points of bucket `b` to their `K`-th nearest others.
    fn farthest_of<const K: usize>(&self, b: usize) -> Lanes {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            #[allow(
                unsafe_code,
                reason = "the processor was asked whether it has the instructions"
            )]
            // SAFETY: the processor has AVX2.
            unsafe {
                return self.farthest_avx2::<K>(b);
            }
        }
        self.farthest_with::<K>(b)
    }

    /// The same operations, eight at a time.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn farthest_avx2<const K: usize>(&self, b: usize) -> Lanes {
        self.farthest_with::<K>(b)
    }

    #[inline(always)]
    fn farthest_with<const K: usize>(&self, b: usize) -> Lanes {
        let query = &self.buckets[b];
        let mut nearest = Nearest::<K>::NONE;
        for lane in 0..query.len {
            let mut dist2 = query.dist2(query.point(lane));
            // A point is no neighbour of itself.
            dist2[lane] = f32::INFINITY;
            nearest.insert(dist2);
        }
        let own = self.buckets.len() + b;
        let bounds = self.bounds[own];
        let mut worst = nearest.worst(query.len);
        let mut stack = [(0usize, 0.0f32); usize::BITS as usize];
        // Upward from the bucket, so that what is near comes first.
        let mut node = own;
        while node > 1 {
            stack[0] = (node ^ 1, bounds.dist2(&self.bounds[node ^ 1]));
            node /= 2;
            let mut height = 1;
            while height > 0 {
                height -= 1;
                let (at, dist2) = stack[height];
                if dist2 >= worst {
                    continue;
                }
                if let Some(bucket) = at.checked_sub(self.buckets.len()) {
                    let bucket = &self.buckets[bucket];
                    for lane in 0..bucket.len {
                        nearest.insert(query.dist2(bucket.point(lane)));
                    }
                    worst = nearest.worst(query.len);
                    continue;
                }
                let children = [2 * at, 2 * at + 1].map(|c| (c, bounds.dist2(&self.bounds[c])));
                let near = usize::from(children[1].1 < children[0].1);
                stack[height] = children[1 - near];
                stack[height + 1] = children[near];
                height += 2;
            }
        }
        nearest.last()
    }
}

/// Squared distances as whole numbers, which are in the same order. Of `f32` the lesser one would be stored where it is less:
/// instructions that take many times as long on some processors.
type Ordered = [i32; LANES];

/// The least `K` squared distances so far of each lane, in order.
struct Nearest<const K: usize>([Ordered; K]);

impl<const K: usize> Nearest<K> {
    const NONE: Self = Self([[f32::INFINITY.to_bits() as i32; LANES]; K]);

    #[inline(always)]
    fn insert(&mut self, dist2: Lanes) {
        let kept = &mut self.0;
        let mut new = [0; LANES];
        // Of what is looked at late, little is among the nearest.
        let mut nearer = 0;
        for lane in 0..LANES {
            new[lane] = dist2[lane].to_bits() as i32;
            nearer |= i32::from(new[lane] < kept[K - 1][lane]);
        }
        if nearer == 0 {
            return;
        }
        for i in (1..K).rev() {
            for lane in 0..LANES {
                kept[i][lane] = kept[i][lane].min(kept[i - 1][lane].max(new[lane]));
            }
        }
        for lane in 0..LANES {
            kept[0][lane] = kept[0][lane].min(new[lane]);
        }
    }

    /// The `K`-th least of each lane.
    #[inline(always)]
    fn last(&self) -> Lanes {
        self.0[K - 1].map(|bits| f32::from_bits(bits as u32))
    }

    /// Greatest of those of the first `lanes` lanes.
    #[inline(always)]
    fn worst(&self, lanes: usize) -> f32 {
        let mut worst = 0;
        for lane in 0..LANES {
            // Nothing found for those behind counts.
            let known = if lane < lanes { self.0[K - 1][lane] } else { 0 };
            worst = worst.max(known);
        }
        f32::from_bits(worst as u32)
    }
}

/// Which points are in bucket `b`, when `n` are halved `levels` times over.
fn range(b: usize, levels: u32, n: usize) -> std::ops::Range<usize> {
    let (mut first, mut end) = (0, n);
    for level in (0..levels).rev() {
        let middle = (first + end) / 2;
        match b >> level & 1 {
            0 => end = middle,
            _ => first = middle,
        }
    }
    first..end
}

/// Halves the points along the longest axis of their box, `levels` times over.
fn divide(points: &mut [(Vec3, u32)], levels: u32) {
    if levels == 0 {
        return;
    }
    let (mut lo, mut hi) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (p, _) in &*points {
        (lo, hi) = (lo.min(*p), hi.max(*p));
    }
    let axis = (hi - lo).max_position();
    let middle = points.len() / 2;
    match axis {
        0 => halve(points, |p| p.x),
        1 => halve(points, |p| p.y),
        _ => halve(points, |p| p.z),
    }
    let (left, right) = points.split_at_mut(middle);
    if middle > 4096 {
        rayon::join(|| divide(left, levels - 1), || divide(right, levels - 1));
    } else {
        divide(left, levels - 1);
        divide(right, levels - 1);
    }
}

/// Puts the lower half by `coordinate` first, of equal ones those that were given first.
fn halve(points: &mut [(Vec3, u32)], coordinate: impl Fn(Vec3) -> f32) {
    let middle = points.len() / 2;
    // One number each, so that comparing takes no branch.
    let key = |&(p, i): &(Vec3, u32)| i64::from(order(coordinate(p))) << 32 | i64::from(i);
    points.select_nth_unstable_by_key(middle, key);
}

#[cfg(test)]
mod tests {
    use super::*;
    use light_tree::{LightId, VirtualLight};
    use sampling::{Purpose, Rng};

    #[test]
    fn the_distance_on_a_grid_is_the_grids() {
        let at = |i: u32| Vec3::new((i % 50) as f32, 0.0, (i / 50) as f32) * 0.5;
        let grid: Vec<Vec3> = (0..2500).map(at).collect();
        let middle = 25 * 50 + 25;
        let fourth = radii::<4>(&grid);
        assert_eq!(fourth[middle], 0.5, "four at half a unit");
        assert_eq!(fourth[0], 1.0, "in the corner two, then two");
        let diagonal = 0.5 * 2.0f32.sqrt();
        assert_eq!(radii::<8>(&grid)[middle], diagonal, "the diagonal");
        assert!(radii::<4>(&grid[..4]).is_empty(), "no fourth neighbour");
    }

    #[test]
    fn only_virtual_lights_have_a_radius() {
        let mut lights = LightSet::default();
        lights.push_point(Vec3::ZERO, Vec3::ONE);
        for i in 0..11 {
            lights.push_virtual(&VirtualLight {
                position: Vec3::X * i as f32,
                normal: Vec3::Y,
                intensity: Vec3::ONE,
                gloss: None,
            });
        }
        set_local_radii(&mut lights);
        let found = [1, 6, 11].map(|i| lights.radius(LightId(i)));
        assert_eq!(found, [10.0, 5.0, 10.0], "the tenth along a line");
    }

    #[test]
    fn neighbours_are_those_that_a_look_at_all_finds() {
        let mut rng = Rng::new(3, 0, 0, Purpose::Build);
        for n in [11, 12, 13, 100, 3000] {
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
            let buckets = Buckets::over(&positions);
            let found = buckets.in_given_order(&buckets.farthest::<10>());
            for (i, p) in positions.iter().enumerate() {
                let mut all: Vec<f32> = positions.iter().map(|q| q.distance_squared(*p)).collect();
                all.swap_remove(i);
                all.sort_by(f32::total_cmp);
                assert_eq!(found[i], all[9], "point {i} of {n}");
            }
        }
    }

    #[test]
    fn no_sphere_is_much_wider_than_most() {
        let dense = (0..400).map(|i| Vec3::new((i % 20) as f32, 0.0, (i / 20) as f32));
        let far = std::iter::once(Vec3::new(1e4, 0.0, 0.0));
        let found = radii::<4>(&dense.chain(far).collect::<Vec<_>>());
        assert_eq!(found[400], 8.0, "eight times the usual 1");
    }
}
