//! How large a virtual spherical light should be.

use light_tree::{LightId, LightSet};
use rayon::prelude::*;

/// Lights whose neighbourhood is looked at.
const PROBES: usize = 128;

/// Median distance from a virtual light to its `k`-th nearest virtual neighbour, scene units; 0 with fewer
/// than `k` + 1 virtual lights.
///
/// Spheres of this radius overlap about `k`-fold where lights are usual in density, which is wide enough
/// to hide the single lights and narrow enough to keep shadows in corners. Exact neighbours of 128 lights
/// spread evenly over the set; the same for any number of threads.
pub fn neighbour_distance(lights: &LightSet, k: usize) -> f32 {
    let n = lights.virtual_count();
    if n <= k || k == 0 {
        return 0.0;
    }
    let first = lights.len() - n;
    let probes = PROBES.min(n);
    let mut distances: Vec<f32> = (0..probes)
        .into_par_iter()
        .map(|probe| {
            let own = first + probe * n / probes;
            let p = lights.position(LightId(own as u32));
            // The k nearest so far, greatest last.
            let mut nearest = vec![f32::INFINITY; k];
            for other in (first..lights.len()).filter(|&o| o != own) {
                let d2 = lights.position(LightId(other as u32)).distance_squared(p);
                if d2 < nearest[k - 1] {
                    let at = nearest.partition_point(|&d| d <= d2);
                    nearest.pop();
                    nearest.insert(at, d2);
                }
            }
            nearest[k - 1].sqrt()
        })
        .collect();
    distances.sort_by(f32::total_cmp);
    distances[probes / 2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use light_tree::VirtualLight;

    #[test]
    fn the_distance_on_a_grid_is_the_grids() {
        let mut lights = LightSet::default();
        for i in 0..2500 {
            lights.push_virtual(&VirtualLight {
                position: Vec3::new((i % 50) as f32, 0.0, (i / 50) as f32) * 0.5,
                normal: Vec3::Y,
                incoming: Vec3::Y,
                flux: Vec3::ONE,
                reflectance: Vec3::ONE,
                material: 0,
            });
        }
        assert_eq!(
            neighbour_distance(&lights, 4),
            0.5,
            "four neighbours at half a unit"
        );
        assert_eq!(
            neighbour_distance(&lights, 8),
            0.5 * 2.0f32.sqrt(),
            "eight within the diagonal"
        );
        assert_eq!(
            neighbour_distance(&LightSet::default(), 4),
            0.0,
            "no lights"
        );
    }
}
