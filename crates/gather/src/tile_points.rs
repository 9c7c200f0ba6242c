//! What a method may look at before a tile is begun.

use sampling::{Purpose, Rng};

use crate::point::GatherPoint;

/// Pixels along the edge of a tile.
pub(crate) const TILE: u32 = 16;
/// Pixels along the edge of a block, whose points are near each other.
const BLOCK: u32 = 4;
/// Blocks of a tile.
pub(crate) const BLOCKS: usize = (TILE.div_ceil(BLOCK) * TILE.div_ceil(BLOCK)) as usize;

/// What is seen at the centre of a pixel.
#[derive(Debug, Clone, Copy)]
pub struct Centre {
    /// The point, as of no sample.
    pub point: GatherPoint,
    /// How far its block of pixels reaches from it, on the plane through it.
    pub reach: f32,
    /// Whether it is one of few: of every fourth pixel in every fourth row.
    pub is_pilot: bool,
}

/// Columns, or rows, of the block of the pixel in this one.
pub(crate) fn block_edges(at: u32) -> [u32; 2] {
    let first = at / BLOCK * BLOCK;
    [first, first + BLOCK]
}

/// The block of the pixel in this column and row of a tile, below [`BLOCKS`].
pub(crate) fn block(column: u32, row: u32) -> u32 {
    row / BLOCK * TILE.div_ceil(BLOCK) + column / BLOCK
}

/// The first milestone after `done` samples: they are 0, 1, 2, 4, 8, and the multiples of 16.
pub(crate) fn next_milestone(done: u32) -> u32 {
    match done {
        0..16 => (done + 1).next_power_of_two(),
        _ => (done / 16 + 1) * 16,
    }
}

/// Whether it is one.
pub(crate) fn is_milestone(done: u32) -> bool {
    done == 0 || next_milestone(done - 1) == done
}

/// Samples from the milestone before `sample`, or at it, to the next.
pub(crate) fn between_milestones(sample: u32) -> u32 {
    match sample {
        0 => 1,
        1..16 => 1 << sample.ilog2(),
        _ => 16,
    }
}

/// The gather points of one pass over a tile, before the first of them is handed to a method.
#[derive(Clone, Copy)]
pub struct TilePoints<'a> {
    /// All of them in the order in which they are handed over: pixel by pixel, row by row; sample by sample; along the
    /// eye path. A pixel sample that sees nothing has none.
    pub points: &'a [GatherPoint],
    /// Pixels in a row of the tile.
    pub width: u32,
    /// Samples of each pixel: a point's slot is pixel × samples + sample.
    pub samples: u32,
    /// Whether a pass begins here however samples are split into passes: at the start, after 1, 2, 4 and 8 samples, and after
    /// every 16.
    pub is_milestone: bool,
    /// What is seen at the centre of each pixel, the same in every pass; empty unless the method
    /// [`asks`](crate::Method::CENTRES).
    pub centres: &'a [Option<Centre>],
    /// A random stream of the tile, the same in every pass.
    pub probe_stream: &'a Rng,
    /// The random stream of a vertex of a slot's eye path for a purpose; it does not depend on how samples are split into passes.
    pub stream: &'a dyn Fn(u32, u32, Purpose) -> Rng,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_lie_between_their_milestones() {
        let mut milestones = Vec::new();
        for sample in 0..100 {
            if is_milestone(sample) {
                milestones.push(sample);
            }
            let before = *milestones.last().expect("0 is one");
            let between = next_milestone(sample) - before;
            assert_eq!(between_milestones(sample), between, "sample {sample}");
        }
        assert_eq!(milestones[..8], [0, 1, 2, 4, 8, 16, 32, 48]);
    }
}
