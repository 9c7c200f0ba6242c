//! The lights in the order of a tree, any cluster a range of them: drawing one of a cluster takes the same time whatever
//! the cluster's size.

use std::ops::Range;

use crate::light::LightId;
use crate::lights::LightSet;
use crate::representative::Representatives;
use crate::tree::{LightTree, NodeId};

/// A node whose sum is below this part of the sum before it has lost too many digits to draw by the difference: the
/// sky beside lamps whose distances are in millimetres, or a candle beside the sun.
const LEAST_SHARE: f64 = 1.0 / (1 << 24) as f64;

/// Lights in the order of a tree's leaves, drawn in proportion to intensity within any of its nodes; 16 bytes a light
/// and 8 a node, beside the tree.
///
/// The choice is that of a descent that chooses between children in proportion to intensity, without its visit of a node
/// a level.
#[derive(Debug, Clone)]
pub struct LightOrder {
    lights: Vec<LightId>,
    /// Sum of the intensities, channels added up, of the lights before each place, and of all.
    before: Vec<f64>,
    /// Places of each node's lights, as first and end.
    ranges: Vec<[u32; 2]>,
    /// For each of as many equal parts of the whole sum as there are lights, the place that its beginning falls to.
    guide: Vec<u32>,
}

impl LightOrder {
    /// Of `tree`, which was built over `lights`.
    pub fn of(tree: &LightTree, lights: &LightSet) -> Self {
        let nodes: Vec<NodeId> = tree.nodes_below(tree.root()).collect();
        let mut order = Vec::with_capacity(lights.len());
        let mut before = Vec::with_capacity(lights.len() + 1);
        let mut ranges = vec![[0; 2]; 2 * tree.pairs.len()];
        let mut sum = 0.0;
        // Depth first: a node's lights come next in the order when the walk reaches it.
        for &id in &nodes {
            let place = order.len() as u32;
            ranges[id.0 as usize] = [place, place + 1];
            if let Some(light) = tree.node(id).light() {
                before.push(sum);
                sum += lights.intensity(light).as_dvec3().element_sum();
                order.push(light);
            }
        }
        before.push(sum);
        for &id in nodes.iter().rev() {
            if let Some(first) = tree.node(id).first_child() {
                ranges[id.0 as usize][1] = ranges[first.0 as usize + 1][1];
            }
        }
        let mut guide = Vec::with_capacity(order.len());
        let mut place = 0;
        for part in 0..order.len() {
            let start = sum * part as f64 / order.len() as f64;
            while place + 1 < order.len() && before[place + 1] <= start {
                place += 1;
            }
            guide.push(place as u32);
        }
        Self {
            lights: order,
            before,
            ranges,
            guide,
        }
    }

    /// Draws one of the lights below `id` by `u` in [0, 1), in proportion to intensity, and returns its place.
    ///
    /// `tree` is the one that this is the order of, `totals` has the intensities of its nodes.
    pub fn draw(&self, tree: &LightTree, totals: &Representatives, id: NodeId, u: f64) -> u32 {
        let Range { start, end } = self.places(id);
        let (least, most) = (self.before[start as usize], self.before[end as usize]);
        if most - least < LEAST_SHARE * least {
            return self.descend(tree, totals, id, u);
        }
        let target = least + u * (most - least);
        let all = self.before[self.lights.len()];
        let part = (target / all * self.guide.len() as f64) as usize;
        let part = part.min(self.guide.len() - 1);
        // Of the lights that the part begins and ends with, and those between, the last that does not begin beyond the
        // target. Rounding is kept within the node.
        let from = self.guide[part].clamp(start, end - 1);
        let to = self.guide.get(part + 1).map_or(end, |&next| next + 1);
        let begins = &self.before[from as usize + 1..to.clamp(from + 1, end) as usize];
        from + begins.partition_point(|&sum| sum <= target) as u32
    }

    /// [`draw`](Self::draw) by the nodes' own intensities.
    #[cold]
    fn descend(
        &self,
        tree: &LightTree,
        totals: &Representatives,
        mut id: NodeId,
        mut u: f64,
    ) -> u32 {
        while let Some(first) = tree.node(id).first_child() {
            let second = NodeId(first.0 + 1);
            let [a, b] = [first, second].map(|k| totals.intensity(k).as_dvec3().element_sum());
            // No light is without power.
            let share = a / (a + b);
            (id, u) = if u < share {
                (first, u / share)
            } else {
                (second, (u - share) / (1.0 - share))
            };
        }
        self.places(id).start
    }

    /// The light at a place.
    #[inline]
    pub fn light(&self, place: u32) -> LightId {
        self.lights[place as usize]
    }

    /// The places of the lights below `id`.
    #[inline]
    pub fn places(&self, id: NodeId) -> Range<u32> {
        let [start, end] = self.ranges[id.0 as usize];
        start..end
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        self.lights.len() * (size_of::<LightId>() + size_of::<u32>())
            + self.before.len() * size_of::<f64>()
            + self.ranges.len() * size_of::<[u32; 2]>()
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::build::TreeBuilder;
    use crate::test_lights::any_lights;

    #[test]
    fn a_node_is_the_range_of_its_lights() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let builder = *u.choose(&TreeBuilder::ALL)?;
            let Some(tree) = LightTree::build(&lights, builder) else {
                return Ok(());
            };
            let order = LightOrder::of(&tree, &lights);
            for id in tree.nodes_below(tree.root()) {
                let there = order.places(id).map(|place| order.light(place));
                assert!(there.eq(tree.lights_below(id)), "lights of node {}", id.0);
            }
            Ok(())
        });
    }

    #[test]
    fn faint_lights_behind_a_bright_one_are_drawn_by_their_own_intensities() {
        // As differences of sums over all lights those of the faint ones are 0, and the last is always drawn.
        let mut lights = LightSet::default();
        for i in 0..8u8 {
            let bright = if i == 0 { 1e20 } else { f32::from(i) };
            lights.push_point(Vec3::X * f32::from(i), Vec3::splat(bright));
        }
        let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
        let (order, totals) = (
            LightOrder::of(&tree, &lights),
            Representatives::choose(&tree, &lights, 0),
        );
        let mut found = 0;
        for id in tree.nodes_below(tree.root()) {
            let below: Vec<f64> = tree.lights_below(id).map(|l| f64::from(l.0)).collect();
            if below.contains(&0.0) {
                continue;
            }
            let all: f64 = below.iter().sum();
            let mut count = [0u32; 8];
            for i in 0..10_000 {
                let place = order.draw(&tree, &totals, id, (f64::from(i) + 0.5) / 1e4);
                count[order.light(place).index()] += 1;
            }
            for light in below {
                let share = f64::from(count[light as usize]) / 1e4;
                assert!(
                    (share - light / all).abs() < 1e-3,
                    "{light} of {all}: {share}"
                );
            }
            found += 1;
        }
        assert!(found > 7, "only {found} nodes without the bright light");
    }

    #[test]
    fn a_number_draws_the_light_that_the_sums_of_intensity_say() {
        verify::property(1000, |u| {
            let lights = any_lights(u)?;
            let Some(tree) = LightTree::build(&lights, TreeBuilder::Binned) else {
                return Ok(());
            };
            let order = LightOrder::of(&tree, &lights);
            let totals = Representatives::choose(&tree, &lights, 0);
            let draws = [
                0.0,
                1e-9,
                0.3,
                0.5,
                f64::from(u.arbitrary::<u16>()?) / 65536.0,
            ];
            for id in tree.nodes_below(tree.root()) {
                let places = order.places(id);
                let weight = |place: u32| {
                    let light = order.light(place);
                    lights.intensity(light).as_dvec3().element_sum()
                };
                let all: f64 = places.clone().map(weight).sum();
                for u in draws.into_iter().chain([1.0 - f64::EPSILON / 2.0]) {
                    let place = order.draw(&tree, &totals, id, u);
                    assert!(places.contains(&place), "place {place} of {places:?}");
                    let below: f64 = (places.start..place).map(weight).sum();
                    // Totals of nodes are f32.
                    let slack = 1e-6 * all;
                    assert!(
                        below <= u * all + slack && u * all <= below + weight(place) + slack,
                        "{u} of {all} draws place {place}, which begins at {below}"
                    );
                }
            }
            Ok(())
        });
    }
}
