//! How much what the lights of a cluster bring differs: what splitting is decided by.
//!
//! Source: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting", §5.4.

use crate::bounds::Receiver;
use crate::tree::{LightTree, NodeId};

/// The variance of the lights' intensities below each node of a tree, beside the tree: 4 bytes a node, for methods
/// that ask for it.
#[derive(Debug, Clone)]
pub struct EnergyVariance {
    /// Squared coefficient of variation V_e / E_e² by node; infinite where distant and other lights meet, whose
    /// intensities have different units.
    relative: Vec<f32>,
    /// Irradiance that counts as 1: what all lights would bring at the distance of the diagonal of their box.
    unit: f64,
}

/// Mean and spread of a set, to which sets can be added.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: f64,
    mean: f64,
    /// Sum of the squared differences to the mean.
    spread: f64,
    /// Whether the lights fall off; `None` for a mixture.
    falls_off: Option<bool>,
}

impl Moments {
    /// Of both sets together (Chan, Golub, LeVeque 1979): no difference of large sums.
    fn union(self, other: Self) -> Self {
        let count = self.count + other.count;
        let apart = other.mean - self.mean;
        let share = other.count / count;
        Self {
            count,
            mean: self.mean + apart * share,
            spread: self.spread + other.spread + apart * apart * self.count * share,
            falls_off: self.falls_off.filter(|_| self.falls_off == other.falls_off),
        }
    }

    fn relative_variance(&self) -> f32 {
        match self.falls_off {
            None => f32::INFINITY,
            Some(_) => (self.spread / self.count / (self.mean * self.mean)) as f32,
        }
    }
}

impl EnergyVariance {
    /// Of all nodes of `tree`.
    pub fn of(tree: &LightTree) -> Self {
        let order: Vec<NodeId> = tree.nodes_below(tree.root()).collect();
        let slots = order.iter().map(|id| id.0 as usize + 1).max().unwrap_or(0);
        let mut moments = vec![Moments::default(); slots];
        let mut relative = vec![0.0; slots];
        for id in order.into_iter().rev() {
            let own = match tree.node(id).first_child() {
                Some(first) => moments[first.0 as usize].union(moments[first.0 as usize + 1]),
                None => {
                    let parallel = f64::from(tree.directional_intensity(id));
                    Moments {
                        count: 1.0,
                        mean: f64::from(tree.node(id).intensity) + parallel,
                        spread: 0.0,
                        falls_off: Some(parallel == 0.0),
                    }
                }
            };
            moments[id.0 as usize] = own;
            relative[id.0 as usize] = own.relative_variance();
        }
        Self {
            relative,
            unit: unit(tree),
        }
    }

    /// σ: standard deviation of what a light drawn below `id` with the same probability as any other brings, times
    /// their number, in units of the irradiance that all lights would bring at the distance of their box' diagonal.
    /// At least 0; infinite where a light may be at the receiver. Cosines and visibility are left out.
    ///
    /// Energy e and falloff g = 1/d² count as independent, with d uniform in [a, b], between which the bounding sphere
    /// lies: σ² = (V_e V_g + V_e E_g² + E_e² V_g) N², E_g = 1/(ab), V_g = (b³ − a³) / (3 (b − a) a³ b³) − 1/(a² b²).
    ///
    /// Departures: the formula is evaluated as σ = N E_e E_g √(c_e + c_g + c_e c_g) with the squared coefficients of
    /// variation c_e and c_g = (b − a)² / (3 a b), where nothing cancels. As published σ is a radiance in the
    /// scene's units, so that the number of samples depends on the unit of length; here the scene gives the
    /// unit. Distances count from √1.5 radii of virtual lights on.
    pub fn deviation(&self, tree: &LightTree, receiver: &Receiver, id: NodeId) -> f64 {
        // All lights at one place differ in intensity alone, which every importance takes in.
        if self.unit <= 0.0 {
            return 0.0;
        }
        let energy = f64::from(self.relative[id.0 as usize]);
        if energy == f64::INFINITY {
            return energy; // of a mixture, also where the distances of its positional lights do not vary
        }
        let node = tree.node(id);
        let mut deviation = 0.0;
        if node.has_positions() {
            let sphere = tree.sphere(receiver, node);
            let (d, r) = (
                f64::from(sphere.dist2).sqrt(),
                f64::from(sphere.radius2).sqrt(),
            );
            let least = f64::from(tree.least_dist2(id)).sqrt();
            let (a, b) = ((d - r).max(least), (d + r).max(least));
            if a <= 0.0 {
                return f64::INFINITY;
            }
            let falloff = (b - a) * (b - a) / (3.0 * a * b);
            let relative = (energy + falloff + energy * falloff).sqrt();
            deviation += f64::from(node.intensity) / (a * b) * relative;
        }
        let parallel = f64::from(tree.directional_intensity(id));
        if parallel > 0.0 {
            deviation += parallel * energy.sqrt();
        }
        deviation / self.unit
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        self.relative.len() * size_of::<f32>()
    }
}

/// Irradiance that all lights would bring at the distance of their box' diagonal; 0 where all are at one place.
fn unit(tree: &LightTree) -> f64 {
    let root = tree.node(tree.root());
    let parallel = f64::from(tree.directional_intensity(tree.root()));
    if !root.has_positions() {
        return parallel;
    }
    let diagonal2 = (root.hi.as_dvec3() - root.lo.as_dvec3()).length_squared();
    if diagonal2 > 0.0 {
        f64::from(root.intensity) / diagonal2 + parallel
    } else {
        parallel
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::build::TreeBuilder;
    use crate::light::{LightId, luminance};
    use crate::lights::LightSet;
    use crate::test_lights::any_lights;

    #[test]
    fn every_node_has_the_variance_of_its_lights() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            for builder in TreeBuilder::ALL {
                let Some(tree) = LightTree::build(&lights, builder) else {
                    return Ok(());
                };
                let variance = EnergyVariance::of(&tree);
                for id in tree.nodes_below(tree.root()) {
                    let below: Vec<LightId> = tree.lights_below(id).collect();
                    let distant = |l: &LightId| lights.kind(*l).is_distant();
                    let relative = variance.relative[id.0 as usize];
                    if below.iter().any(distant) != below.iter().all(distant) {
                        assert_eq!(relative, f32::INFINITY, "a mixture");
                        continue;
                    }
                    let energies: Vec<f64> = below
                        .iter()
                        .map(|l| f64::from(luminance(lights.intensity(*l))))
                        .collect();
                    let n = energies.len() as f64;
                    let mean = energies.iter().sum::<f64>() / n;
                    let truth = energies
                        .iter()
                        .map(|e| (e / mean - 1.0).powi(2))
                        .sum::<f64>()
                        / n;
                    assert!(
                        (f64::from(relative) - truth).abs() < 1e-5 * truth + 1e-12,
                        "{builder:?}, {n} lights: {relative} instead of {truth}"
                    );
                }
            }
            Ok(())
        });
    }

    /// Point lights of intensity 1 and 3 at two corners of a box.
    fn two() -> (LightTree, EnergyVariance) {
        let mut set = LightSet::default();
        set.push_point(Vec3::new(0.0, 3.0, 0.0), Vec3::ONE);
        set.push_point(Vec3::new(2.0, 4.0, 2.0), Vec3::splat(3.0));
        let tree = LightTree::build(&set, TreeBuilder::Binned).expect("has lights");
        let variance = EnergyVariance::of(&tree);
        (tree, variance)
    }

    #[test]
    fn the_deviation_is_that_of_the_published_formula() {
        let (tree, variance) = two();
        let x = Receiver::new(Vec3::ZERO, Vec3::Y);
        // Centre (1, 3.5, 1), R = 3/2; total 4 over a squared diagonal of 9.
        let d = (1.0f64 + 3.5 * 3.5 + 1.0).sqrt();
        let (a, b) = (d - 1.5, d + 1.5);
        let (n, mean_e, var_e) = (2.0, 2.0, 1.0);
        let mean_g = 1.0 / (a * b);
        let var_g = (b.powi(3) - a.powi(3)) / (3.0 * (b - a) * (a * b).powi(3)) - mean_g * mean_g;
        let published =
            (n * n * (var_e * var_g + var_e * mean_g * mean_g + mean_e * mean_e * var_g)).sqrt();
        let expected = published * 9.0 / 4.0;
        let found = variance.deviation(&tree, &x, tree.root());
        assert!(
            (found / expected - 1.0).abs() < 1e-5,
            "{found} instead of {expected}"
        );
    }

    #[test]
    fn inside_the_sphere_it_is_infinite_and_for_a_single_light_nothing() {
        let (tree, variance) = two();
        let inside = Receiver::new(Vec3::new(1.0, 3.0, 1.0), Vec3::Y);
        assert_eq!(
            variance.deviation(&tree, &inside, tree.root()),
            f64::INFINITY,
            "inside"
        );
        let first = tree.node(tree.root()).first_child().expect("two lights");
        assert_eq!(variance.deviation(&tree, &inside, first), 0.0, "one light");
    }

    #[test]
    fn a_mixture_differs_without_bound_also_where_its_positional_light_is_one() {
        let mut set = LightSet::default();
        set.push_point(Vec3::Y, Vec3::ONE);
        set.push_directional(Vec3::NEG_Y, Vec3::ONE);
        set.push_directional(Vec3::X, Vec3::ONE);
        let tree = LightTree::build(&set, TreeBuilder::Binned).expect("has lights");
        let variance = EnergyVariance::of(&tree);
        let x = Receiver::new(Vec3::ZERO, Vec3::Y);
        let found = variance.deviation(&tree, &x, tree.root());
        assert_eq!(found, f64::INFINITY, "lamp and parallel light");
    }
}
