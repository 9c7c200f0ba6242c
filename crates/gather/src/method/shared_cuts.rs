//! One cut for a block of pixels.
//!
//! Source: Lin and Yuksel 2020, "Real-Time Stochastic Lightcuts": the cut of a block is that of one of its pixels,
//! another one each time. As a cut only divides the lights, it stays sound at any point.

use light_tree::{Cut, LightTree, NodeId, NodeWeights};
use sampling::Purpose;
use serde::Deserialize;

use crate::point::GatherPoint;
use crate::tile_points::TilePoints;

/// Pixels along the edge of the blocks that share a cut, 1..=8; with 1 every point has its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "u64")]
pub struct BlockEdge(u32);

impl BlockEdge {
    /// As a number.
    pub fn get(self) -> u32 {
        self.0
    }
}

impl Default for BlockEdge {
    /// 1: nothing is shared.
    fn default() -> Self {
        Self(1)
    }
}

impl TryFrom<u64> for BlockEdge {
    type Error = String;

    fn try_from(value: u64) -> Result<Self, String> {
        match u32::try_from(value) {
            Ok(edge @ 1..=8) => Ok(Self(edge)),
            _ => Err(format!("found {value}; expected 1..=8")),
        }
    }
}

/// The cuts of a tile's blocks, one for each sample: pixels share among themselves, never a pixel's samples, so that
/// passes may split those in any way. Memory is kept from tile to tile.
#[derive(Debug, Default)]
pub(super) struct SharedCuts {
    /// Clusters, cut by cut.
    nodes: Vec<NodeId>,
    /// Where each block's cut begins in `nodes`, and the end of the last.
    starts: Vec<usize>,
    /// The block of each point, in the order in which they come; `None` beyond the first vertex of an eye path.
    blocks: Vec<Option<usize>>,
    /// First vertices in each block so far, while pivots are chosen.
    members: Vec<u32>,
    next: usize,
}

impl SharedCuts {
    /// Finds the cuts for blocks of `edge` × `edge` pixels, of up to `size` clusters each.
    pub(super) fn refine(
        &mut self,
        tile: &TilePoints<'_>,
        edge: u32,
        size: usize,
        tree: &LightTree,
        weights: NodeWeights,
        cut: &mut Cut,
    ) {
        let per_row = tile.width.div_ceil(edge);
        let block_of = |x: &GatherPoint| {
            let (pixel, sample) = (x.slot / tile.samples, x.slot % tile.samples);
            let (column, row) = (pixel % tile.width / edge, pixel / tile.width / edge);
            ((row * per_row + column) * tile.samples + sample) as usize
        };
        self.next = 0;
        self.blocks.clear();
        self.members.clear();
        let mut before = None;
        for x in tile.points {
            let is_first = before != Some(x.slot);
            before = Some(x.slot);
            let block = is_first.then(|| block_of(x));
            self.blocks.push(block);
            if let Some(block) = block {
                if block >= self.members.len() {
                    self.members.resize(block + 1, 0);
                }
                self.members[block] += 1;
            }
        }
        let pivots = self.pivots(tile);
        self.nodes.clear();
        self.starts.clear();
        for pivot in pivots {
            self.starts.push(self.nodes.len());
            if let Some(pivot) = pivot {
                cut.refine_for_many(tree, weights, &tile.points[pivot].receiver, size);
                self.nodes.extend(cut.nodes());
            }
        }
        self.starts.push(self.nodes.len());
    }

    /// One point of each block, any with the same probability; `None` for blocks without points.
    fn pivots(&self, tile: &TilePoints<'_>) -> Vec<Option<usize>> {
        let mut pivots = vec![None; self.members.len()];
        // How many members are still to go by, the pivot included, of blocks that have begun.
        let mut left = vec![None; self.members.len()];
        for (x, (i, block)) in tile.points.iter().zip(self.blocks.iter().enumerate()) {
            let Some(block) = *block else { continue };
            let left = left[block].get_or_insert_with(|| {
                let u = (tile.stream)(x.slot, 0, Purpose::Pivot).f64();
                i64::from(self.members[block]) - (u * f64::from(self.members[block])) as i64
            });
            *left -= 1;
            if *left == 0 {
                pivots[block] = Some(i);
            }
        }
        pivots
    }

    /// The clusters for the next point; `None` where it has to find its own.
    pub(super) fn next(&mut self) -> Option<&[NodeId]> {
        let block = *self.blocks.get(self.next)?;
        self.next += 1;
        let block = block?;
        Some(&self.nodes[self.starts[block]..self.starts[block + 1]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Inputs;
    use crate::contribution::VirtualShape;
    use crate::learned::Learned;
    use crate::method::conformance::{gather_points, light_sets, radiances, room, running};
    use crate::method::fixtures::{all_lights, at};
    use crate::method::{Method, StochasticLightcuts, StochasticLightcutsSpec};
    use crate::shadow_queue::{QueueScratch, ShadowQueue};
    use light_tree::TreeBuilder;
    use sampling::Rng;
    use scene::trace::Tracer;
    use verify::{critical_z, sidak, z_test};

    const SAMPLES: u32 = 4000;

    /// What seven pixels, each looking at another of the room's points, get from the method with a common cut.
    #[test]
    fn a_block_with_one_cut_averages_to_all_lights_at_each_of_its_pixels() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        let mut scores = Vec::new();
        for (name, lights) in light_sets(&scene, &tracer) {
            let inputs = Inputs::new(lights, TreeBuilder::Binned);
            let spec = StochasticLightcutsSpec {
                share: BlockEdge(8),
                ..Default::default()
            };
            let method = StochasticLightcuts::prepare(&spec, &inputs);
            let seven = gather_points(&scene);
            let points: Vec<GatherPoint> = (0..seven.len() as u32 * SAMPLES)
                .map(|slot| GatherPoint {
                    slot,
                    ..seven[(slot / SAMPLES) as usize]
                })
                .collect();
            let stream = |slot: u32, _, purpose| Rng::new(41, u64::from(slot), 0, purpose);
            let tile = TilePoints {
                centres: &[],
                points: &points,
                width: 16,
                samples: SAMPLES,
                is_milestone: true,
                probe_stream: &stream(0, 0, Purpose::Probe),
                stream: &stream,
            };
            let mut memory = QueueScratch::default();
            let shape = VirtualShape::Sphere;
            let mut queue = ShadowQueue::new(
                &scene,
                &inputs.lights,
                &tracer,
                shape,
                points.len(),
                &mut memory,
            );
            let mut scratch = Default::default();
            method.begin_tile(&tile, &mut queue, &mut Learned::default(), &mut scratch);
            for x in &points {
                queue.begin_point(stream(x.slot, 0, Purpose::LightSurface));
                let mut rng = stream(x.slot, 0, Purpose::Lights);
                method.point(x, &mut queue, &mut rng, &mut scratch);
                queue.end_point();
            }
            let (_, sums) = queue.finish();
            for (x, sums) in seven
                .iter()
                .zip(radiances(sums).chunks_exact(SAMPLES as usize))
            {
                let exact: Vec<_> = (0..200)
                    .map(|sample| at(&all_lights(&inputs), &inputs, &tracer, shape, x, sample).0)
                    .collect();
                let (found, truth) = (running(sums, 1), running(&exact, 1));
                let rounding = 1e-7 * truth.mean();
                let variance =
                    found.variance_of_mean() + truth.variance_of_mean() + rounding * rounding;
                let z = z_test(found.mean(), variance, truth.mean());
                scores.push((z, name, x.position, found.mean(), truth.mean()));
            }
        }
        // A false alarm once in 10⁴ seeds, with room for heavy tails.
        let limit = 1.2 * critical_z(sidak(1e-4, scores.len()));
        for (z, name, at, found, truth) in scores {
            assert!(
                z.abs() < limit,
                "{name} at {at}: {found} instead of {truth}, z = {z}"
            );
        }
    }

    #[test]
    fn every_point_of_a_block_is_its_pivot_alike_and_later_vertices_have_their_own_cut() {
        let scene = room(false);
        let tracer = Tracer::build(&scene);
        let (_, lights) = light_sets(&scene, &tracer).swap_remove(3);
        let tree = LightTree::build(&lights, TreeBuilder::Binned).expect("has lights");
        let x = gather_points(&scene)[0];
        // Two pixels of a block in a tile four wide, the first hit twice on its way, and a pixel of another block.
        let points = [0, 0, 1, 3].map(|slot| GatherPoint { slot, ..x });
        let mut picked = [0; 4];
        let mut shared = SharedCuts::default();
        for seed in 0..1000 {
            let stream = |slot: u32, _, purpose| Rng::new(seed, u64::from(slot), 0, purpose);
            let tile = TilePoints {
                centres: &[],
                points: &points,
                width: 4,
                samples: 1,
                is_milestone: true,
                probe_stream: &stream(0, 0, Purpose::Probe),
                stream: &stream,
            };
            shared.refine(
                &tile,
                3,
                10,
                &tree,
                NodeWeights::MinMax,
                &mut Cut::default(),
            );
            assert_eq!(shared.blocks, [Some(0), None, Some(0), Some(1)], "blocks");
            for pivot in shared.pivots(&tile).into_iter().flatten() {
                picked[pivot] += 1;
            }
            let lengths = [0; 4].map(|_| shared.next().map(<[NodeId]>::len));
            assert_eq!(lengths, [Some(10), None, Some(10), Some(10)], "clusters");
        }
        assert_eq!((picked[1], picked[3]), (0, 1000), "{picked:?}");
        // Half of 1000 within 5 sigma of 16: a false alarm is 6e-7.
        assert!(
            (picked[0] - 500i32).abs() < 80 && picked[0] + picked[2] == 1000,
            "{picked:?}"
        );
    }
}
