//! One light that stands for each cluster.
//!
//! Source: Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005, §3.1.

use glam::{DVec3, Vec3};
use sampling::{Purpose, Rng};

use crate::light::LightId;
use crate::lights::LightSet;
use crate::tree::{LightTree, NodeId};

/// A cluster's representative with what it stands for; 16 bytes.
#[derive(Debug, Clone, Copy)]
struct Cluster {
    intensity: Vec3,
    light: LightId,
}

/// A light for every node of a tree, drawn in proportion to intensity, so that a cluster's light is estimated
/// by that of one light. A node's light is that of one of its children: what was found for it stays true.
///
/// Beside the tree, which methods that draw lights anew for each point have no need to carry it in.
#[derive(Debug, Clone)]
pub struct Representatives {
    clusters: Vec<Cluster>,
    roots: Vec<NodeId>,
    /// One a cluster, as long as there are glossy lights: see [`peak`](Representatives::peak).
    peaks: Vec<Vec3>,
}

impl Representatives {
    /// Draws the representatives of `tree`, which was built over `lights`; the same for the same seed.
    pub fn choose(tree: &LightTree, lights: &LightSet, seed: u64) -> Self {
        let nothing = Cluster {
            intensity: Vec3::ZERO,
            light: LightId(0),
        };
        // Two slots a pair, of which the second beside the root stays unused.
        let mut clusters = vec![nothing; 2 * tree.pairs.len()];
        // One kind, or none where the lights below are of several; only needed here.
        let mut kinds = vec![None; clusters.len()];
        let glossy = if lights.gloss_count() > 0 {
            clusters.len()
        } else {
            0
        };
        let mut peaks = vec![Vec3::ZERO; glossy];
        let mut inner = Vec::with_capacity(tree.light_count());
        for id in tree.nodes_below(tree.root()) {
            let at = id.0 as usize;
            if let Some(first) = tree.node(id).first_child() {
                inner.push((id, first));
            } else if let Some(light) = tree.node(id).light() {
                kinds[at] = Some(lights.kind(light));
                clusters[at] = Cluster {
                    intensity: lights.intensity(light),
                    light,
                };
                if let Some(gloss) = lights.gloss(light) {
                    peaks[at] = lights.intensity(light) * gloss.peak;
                }
            }
        }
        // Parents were found before their children.
        for &(id, first) in inner.iter().rev() {
            let (a, b) = (first.0 as usize, first.0 as usize + 1);
            let (one, two) = (
                clusters[a].intensity.as_dvec3(),
                clusters[b].intensity.as_dvec3(),
            );
            let both = one + two;
            // A number of the node's own, so that it does not depend on how others were visited.
            let u = Rng::new(seed, u64::from(id.0), 0, Purpose::Build).f64();
            let chosen = if u * both.element_sum() < one.element_sum() {
                a
            } else {
                b
            };
            clusters[id.0 as usize] = Cluster {
                intensity: both.min(DVec3::splat(f64::from(f32::MAX))).as_vec3(),
                light: clusters[chosen].light,
            };
            if glossy > 0 {
                // Rounded up: a bound.
                peaks[id.0 as usize] =
                    ((peaks[a] + peaks[b]) * (1.0 + f32::EPSILON)).min(Vec3::MAX);
            }
            if kinds[a] == kinds[b] {
                kinds[id.0 as usize] = kinds[a];
            }
        }
        let mut roots = Vec::new();
        let mut stack = vec![tree.root()];
        while let Some(id) = stack.pop() {
            match (kinds[id.0 as usize], tree.node(id).first_child()) {
                (None, Some(first)) => stack.extend([NodeId(first.0 + 1), first]),
                _ => roots.push(id),
            }
        }
        Self {
            clusters,
            roots,
            peaks,
        }
    }

    /// The light that stands for the cluster `id`; a leaf's own light.
    #[inline]
    pub fn light(&self, id: NodeId) -> LightId {
        self.clusters[id.0 as usize].light
    }

    /// RGB intensity of all lights of the cluster, W/sr, or W/m² for directional lights.
    #[inline]
    pub fn intensity(&self, id: NodeId) -> Vec3 {
        self.clusters[id.0 as usize].intensity
    }

    /// What the glossy lights of the cluster send at most in any direction beyond what matte ones of their intensity would,
    /// W/sr.
    #[inline]
    pub fn peak(&self, id: NodeId) -> Vec3 {
        self.peaks.get(id.0 as usize).copied().unwrap_or(Vec3::ZERO)
    }

    /// The largest clusters whose lights are all of one kind; together they hold every light once.
    ///
    /// One light stands for others of its kind only, so that a cut begins here: with one cluster a kind, where
    /// the tree keeps kinds apart; see [`LightTree::build_by_kind`].
    pub fn roots(&self) -> &[NodeId] {
        &self.roots
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        self.clusters.len() * size_of::<Cluster>()
            + self.peaks.len() * size_of::<Vec3>()
            + self.roots.len() * size_of::<NodeId>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::TreeBuilder;
    use crate::light::{LightKind, VirtualLight, luminance};
    use crate::test_lights::any_lights;

    #[test]
    fn a_node_has_the_light_of_one_child_and_the_intensity_of_both() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let builder = *u.choose(&TreeBuilder::ALL)?;
            let Some(tree) = LightTree::build(&lights, builder) else {
                return Ok(());
            };
            let chosen = Representatives::choose(&tree, &lights, 7);
            for id in tree.nodes_below(tree.root()) {
                let Some(first) = tree.node(id).first_child() else {
                    assert_eq!(Some(chosen.light(id)), tree.node(id).light(), "leaf");
                    continue;
                };
                let children = [first, NodeId(first.0 + 1)];
                let own = chosen.light(id);
                let heirs = children.iter().filter(|c| chosen.light(**c) == own);
                assert_eq!(heirs.count(), 1, "children that share light {own:?}");
                let sum: f32 = children
                    .iter()
                    .map(|c| luminance(chosen.intensity(*c)))
                    .sum();
                let of_node = tree.node(id).intensity + tree.directional_intensity(id);
                let total = luminance(chosen.intensity(id));
                assert!(
                    (total - sum).abs() <= 1e-5 * sum && (total - of_node).abs() <= 1e-5 * sum,
                    "{total}, {of_node} and {sum}"
                );
            }
            Ok(())
        });
    }

    #[test]
    fn roots_hold_each_light_once_and_are_of_one_kind_each() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let by_kind = u.arbitrary()?;
            let builder = *u.choose(&TreeBuilder::ALL)?;
            let tree = if by_kind {
                LightTree::build_by_kind(&lights, builder)
            } else {
                LightTree::build(&lights, builder)
            };
            let Some(tree) = tree else { return Ok(()) };
            assert_eq!(tree.validate(&lights), Ok(()), "the tree");
            let chosen = Representatives::choose(&tree, &lights, 7);
            let mut seen = vec![0; lights.len()];
            for &root in chosen.roots() {
                for light in tree.lights_below(root) {
                    seen[light.index()] += 1;
                    let kind = lights.kind(chosen.light(root));
                    assert_eq!(lights.kind(light), kind, "a light of another kind");
                }
            }
            assert!(seen.iter().all(|n| *n == 1), "{seen:?}");
            let kinds = LightKind::ALL
                .iter()
                .filter(|k| lights.count(**k) > 0)
                .count();
            assert!(
                !by_kind || chosen.roots().len() == kinds,
                "{} roots for {kinds} kinds",
                chosen.roots().len()
            );
            Ok(())
        });
    }

    #[test]
    fn lights_stand_for_the_whole_in_proportion_to_their_intensity() {
        let mut lights = LightSet::default();
        let mut sum = 0.0;
        for i in 0..8_u8 {
            let intensity = f32::from(1 + i * i);
            sum += intensity;
            lights.push_virtual(&VirtualLight {
                position: Vec3::X * f32::from(i % 3) + Vec3::Y * f32::from(i / 3),
                normal: Vec3::Z,
                intensity: Vec3::splat(intensity),
                gloss: None,
            });
        }
        let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("eight lights");
        let draws = 20_000_u16;
        let mut counts = [0.0; 8];
        for seed in 0..draws {
            let chosen = Representatives::choose(&tree, &lights, u64::from(seed));
            counts[chosen.light(tree.root()).index()] += 1.0;
        }
        for (i, count) in counts.iter().enumerate() {
            let share = f64::from(1 + (i * i) as u8) / f64::from(sum);
            let deviation = (f64::from(draws) * share * (1.0 - share)).sqrt();
            let z = (count - f64::from(draws) * share) / deviation;
            // Eight comparisons at 5 sigma: false alarm 5e-6.
            assert!(
                z.abs() < 5.0,
                "light {i}: {count} of {draws}, share {share}"
            );
        }
    }
}
