//! The lowest levels of a tree, bottom-up: of the few lights that a cluster has left, the two clusters of least cost are
//! joined until there is one.
//!
//! Fifteen of sixteen nodes lie there. Bins would be filled for each, and most of them stay empty.
//!
//! Source: Walter et al., "Lightcuts", 2005, §3.1 (greedy pairing); the metric is that of the [binned](super::binned) splits.

use super::Item;
use crate::wide::by_width;

/// Most lights that are joined.
pub(super) const FEW: usize = 16;
/// So many take half the work.
const FEWER: usize = 8;

/// Which clusters were joined: lights are numbered from 0, and clusters from their number on as they are made; the last is
/// the whole.
pub(super) struct Joined {
    pub(super) children: [[u8; 2]; FEW - 1],
    /// Lights of each, lights included.
    pub(super) sizes: [u8; 2 * FEW - 1],
}

/// No pair.
const NONE: u32 = u32::MAX;
/// The last bits of a pair's key are the places of both, four each. Those above them say how many joins are below the higher of
/// both, up to 3: clusters that coincide make a tree that is hardly deeper than it must be.
const LEVEL: u32 = 1 << 8;
/// The others are of the cost.
const COST: u32 = !(4 * LEVEL - 1);

/// Clusters, number by number, in `N` places.
struct Clusters<const N: usize> {
    /// Least and greatest position and axis.
    lo: [[f32; N]; 6],
    hi: [[f32; N]; 6],
    /// As shares of the brightest light's.
    intensity: [f32; N],
    /// Joins below, in units of [`LEVEL`].
    level: [u32; N],
    /// [`NONE`] in places without a cluster.
    unused: [u32; N],
}

impl<const N: usize> Clusters<N> {
    #[inline(always)]
    fn of(items: &[Item]) -> Self {
        let mut lo = [[0.0; N]; 6];
        let mut intensity = [0.0; N];
        let mut unused = [NONE; N];
        let mut brightest = 0.0f32;
        for (k, item) in items.iter().enumerate() {
            for axis in 0..3 {
                lo[axis][k] = item.position[axis];
                lo[3 + axis][k] = item.axis[axis];
            }
            intensity[k] = item.intensity;
            brightest = brightest.max(item.intensity);
            unused[k] = 0;
        }
        // So that no product is too small or too large for the type.
        for intensity in &mut intensity {
            *intensity /= brightest;
        }
        Self {
            lo,
            hi: lo,
            intensity,
            level: [0; N],
            unused,
        }
    }

    /// The keys of cluster `i` with each other: in the order of their costs. `c2` is c² of the metric.
    #[inline(always)]
    fn keys(&self, i: usize, c2: f32) -> [u32; N] {
        let (mut alpha2, mut chord2) = ([0.0; N], [0.0; N]);
        for axis in 0..3 {
            self.add_extent2(axis, i, &mut alpha2);
            self.add_extent2(3 + axis, i, &mut chord2);
        }
        let mut keys = [NONE; N];
        for k in 0..N {
            let spread = chord2[k] * 0.125;
            let size = alpha2[k] + c2 * spread * spread;
            let cost = (self.intensity[i] + self.intensity[k]) * size;
            let level = self.level[i].max(self.level[k]);
            // Numbers ≥ 0 are in the order of their bits.
            let key = cost.to_bits() & COST | level | (16 * i + k) as u32;
            let own = if k == i { NONE } else { 0 };
            keys[k] = key | self.unused[k] | own;
        }
        keys
    }

    /// Adds the square of the extent that cluster `i` and each other have together.
    #[inline(always)]
    fn add_extent2(&self, axis: usize, i: usize, sum: &mut [f32; N]) {
        let (lo, hi) = (&self.lo[axis], &self.hi[axis]);
        let (own_lo, own_hi) = (lo[i], hi[i]);
        for k in 0..N {
            let lo = if lo[k] < own_lo { lo[k] } else { own_lo };
            let hi = if hi[k] > own_hi { hi[k] } else { own_hi };
            sum[k] += (hi - lo) * (hi - lo);
        }
    }

    /// Puts the union of `i` and `j` in the place of `i`.
    #[inline(always)]
    fn join(&mut self, i: usize, j: usize) {
        for axis in 0..6 {
            let lo = self.lo[axis][i].min(self.lo[axis][j]);
            let hi = self.hi[axis][i].max(self.hi[axis][j]);
            put(&mut self.lo[axis], i, lo);
            put(&mut self.hi[axis], i, hi);
        }
        let intensity = self.intensity[i] + self.intensity[j];
        put(&mut self.intensity, i, intensity);
        let level = self.level[i].max(self.level[j]) + LEVEL;
        put(&mut self.level, i, level.min(3 * LEVEL));
        put(&mut self.unused, j, NONE);
    }
}

/// Changes one place, and writes them all: they are read together at once, which would wait for a smaller write.
#[inline(always)]
fn put<T: Copy, const N: usize>(lanes: &mut [T; N], place: usize, value: T) {
    for (k, lane) in lanes.iter_mut().enumerate() {
        *lane = if k == place { value } else { *lane };
    }
}

/// Joins 2 to [`FEW`] lights. `c2` is c² of the metric, 0 where directions do not count.
pub(super) fn join(items: &[Item], c2: f32) -> Joined {
    by_width!(join_avx2(items, c2), join_all(items, c2))
}

/// The same code and the same bits, eight lanes to an instruction.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn join_avx2(items: &[Item], c2: f32) -> Joined {
    join_all(items, c2)
}

#[inline(always)]
fn join_all(items: &[Item], c2: f32) -> Joined {
    if items.len() <= FEWER {
        join_in::<FEWER>(items, c2)
    } else {
        join_in::<FEW>(items, c2)
    }
}

#[inline(always)]
fn join_in<const N: usize>(items: &[Item], c2: f32) -> Joined {
    let n = items.len();
    let mut clusters = Clusters::<N>::of(items);
    let mut joined = Joined {
        children: [[0; 2]; FEW - 1],
        sizes: [1; 2 * FEW - 1],
    };
    let mut numbers = [0; N];
    let mut keys = [[NONE; N]; N];
    for i in 0..n {
        numbers[i] = i as u8;
        keys[i] = clusters.keys(i, c2);
    }
    for made in 0..n - 1 {
        let mut least = [NONE; N];
        for keys in &keys {
            for k in 0..N {
                least[k] = least[k].min(keys[k]);
            }
        }
        let mut key = NONE;
        for least in least {
            key = key.min(least);
        }
        let (i, j) = ((key >> 4 & 15) as usize, (key & 15) as usize);
        let pair = [numbers[i], numbers[j]];
        let [a, b] = pair.map(|number| joined.sizes[usize::from(number)]);
        joined.children[made] = pair;
        joined.sizes[n + made] = a + b;
        numbers[i] = (n + made) as u8;
        clusters.join(i, j);
        let mut gone = [0; N];
        put(&mut gone, i, NONE);
        put(&mut gone, j, NONE);
        for keys in &mut keys {
            for k in 0..N {
                keys[k] |= gone[k];
            }
        }
        keys[i] = clusters.keys(i, c2);
        keys[j] = [NONE; N];
    }
    joined
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sampling::{Purpose, Rng, uniform_sphere};

    use super::super::binned::Bin;
    use super::*;

    fn any_items(rng: &mut Rng, n: usize) -> Vec<Item> {
        let mut item = |id| Item {
            position: Vec3::new(rng.f32(), rng.f32(), rng.f32()),
            intensity: 0.1 + rng.f32(),
            axis: uniform_sphere([rng.f32(), rng.f32()]),
            id,
        };
        (0..n as u32).map(&mut item).collect()
    }

    /// Number and bin of the clusters that are left when the first so many joins are made.
    fn clusters(items: &[Item], joined: &Joined, made: usize) -> Vec<(u8, Bin)> {
        let of = |(item, number)| (number, Bin::of(item));
        let mut clusters: Vec<(u8, Bin)> = items.iter().zip(0..).map(of).collect();
        for (pair, number) in joined.children.iter().zip(items.len() as u8..).take(made) {
            let mut all = Bin::EMPTY;
            clusters.retain(|(number, bin)| {
                let is_joined = pair.contains(number);
                if is_joined {
                    all.merge(bin);
                }
                !is_joined
            });
            clusters.push((number, all));
        }
        clusters
    }

    #[test]
    fn the_two_clusters_of_least_cost_are_joined() {
        let mut rng = Rng::new(6, 0, 0, Purpose::Build);
        for round in 0..200 {
            let n = 2 + round % (FEW - 1);
            let c2 = [0.0, 0.1][round / FEW % 2];
            let items = any_items(&mut rng, n);
            let joined = join(&items, c2);
            for made in 0..n - 1 {
                let clusters = clusters(&items, &joined, made);
                assert_eq!(clusters.len(), n - made, "two become one");
                let (mut least, mut taken) = (f64::INFINITY, f64::NAN);
                for (i, (a, bin)) in clusters.iter().enumerate() {
                    for (b, other) in &clusters[..i] {
                        let mut both = *bin;
                        both.merge(other);
                        let cost = both.cost(c2);
                        least = least.min(cost);
                        if joined.children[made].contains(a) && joined.children[made].contains(b) {
                            taken = cost;
                        }
                    }
                }
                // Keys have room for 13 bits of a cost's mantissa.
                assert!(taken <= least * 1.001, "{taken} instead of {least}");
            }
            assert_eq!(usize::from(joined.sizes[2 * n - 2]), n, "the whole");
        }
    }

    #[test]
    fn wide_and_narrow_instructions_join_the_same() {
        let mut rng = Rng::new(7, 0, 0, Purpose::Build);
        for round in 0..200 {
            let items = any_items(&mut rng, 2 + round % (FEW - 1));
            let (fast, plain) = (join(&items, 0.1), join_all(&items, 0.1));
            assert_eq!(fast.children, plain.children, "round {round}");
        }
    }

    #[test]
    fn coincident_lights_are_joined_in_few_levels() {
        let mut rng = Rng::new(8, 0, 0, Purpose::Build);
        let items = vec![any_items(&mut rng, 1)[0]; FEW];
        let joined = join(&items, 0.1);
        let mut depths = [0; 2 * FEW - 1];
        for (made, pair) in joined.children.iter().enumerate() {
            let [a, b] = pair.map(|number| depths[usize::from(number)]);
            depths[FEW + made] = 1 + a.max(b);
        }
        assert!(depths[2 * FEW - 2] <= 5, "{depths:?}");
    }
}
