//! What a method may look at before a tile is begun.

use sampling::{Purpose, Rng};

use crate::point::GatherPoint;

/// Pixels along the edge of a tile.
pub(crate) const TILE: u32 = 16;
/// Pixels along the edge of a block, whose points are near each other.
const BLOCK: u32 = 4;
/// Blocks of a tile.
pub(crate) const BLOCKS: usize = (TILE.div_ceil(BLOCK) * TILE.div_ceil(BLOCK)) as usize;

/// The block of the pixel in this column and row of a tile, below [`BLOCKS`].
pub(crate) fn block(column: u32, row: u32) -> u32 {
    row / BLOCK * TILE.div_ceil(BLOCK) + column / BLOCK
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
    /// What is seen at the centres of every fourth pixel in every fourth row, the same in every pass; empty unless the
    /// method [`asks`](crate::Method::PILOTS).
    pub pilots: &'a [GatherPoint],
    /// A random stream of the tile, the same in every pass.
    pub probe_stream: &'a Rng,
    /// The random stream of a slot for a purpose; it does not depend on how samples are split into passes.
    pub stream: &'a dyn Fn(u32, Purpose) -> Rng,
}
