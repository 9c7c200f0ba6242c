//! What can go wrong with pictures and their files.

/// A picture that cannot be read, written, merged or compared.
///
/// Messages name the file (or the picture), the value and what was expected.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The file system refused.
    #[error("{path}: {source}")]
    Io {
        /// File concerned.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// The file is no EXR that we can read, or the picture none that EXR can hold.
    #[error("{path}: {reason}")]
    Exr {
        /// File concerned.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A channel that the reader needs is not there.
    #[error("{path}: no channel {wanted}; the file has {present}")]
    Channel {
        /// File concerned.
        path: String,
        /// Name of the missing channel or channels.
        wanted: String,
        /// Names of the channels of the file.
        present: String,
    },
    /// An attribute that EXR cannot hold.
    #[error("{path}: attribute {name:?} {reason}")]
    Attribute {
        /// File concerned.
        path: String,
        /// Name of the attribute.
        name: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Two pictures that must match in size do not.
    #[error("{name} is {width}x{height}; expected {expected_width}x{expected_height} as {other}")]
    Size {
        /// The picture that differs.
        name: String,
        /// Its width in pixels.
        width: u32,
        /// Its height in pixels.
        height: u32,
        /// The picture that it must match.
        other: String,
        /// Width of that, in pixels.
        expected_width: u32,
        /// Height of that, in pixels.
        expected_height: u32,
    },
    /// A picture without pixels.
    #[error("{name} is {width}x{height}; expected at least one pixel")]
    Empty {
        /// The picture concerned.
        name: String,
        /// Its width in pixels.
        width: u32,
        /// Its height in pixels.
        height: u32,
    },
    /// A comparison met an infinity or a NaN.
    #[error(
        "the {which} has {count} non-finite pixels, the first at x={x}, y={y}: {value}; expected finite values"
    )]
    NonFinite {
        /// "image" or "reference".
        which: &'static str,
        /// How many pixels are not finite.
        count: usize,
        /// Column of the first of them.
        x: u32,
        /// Row of the first of them, from the top.
        y: u32,
        /// Its value.
        value: glam::Vec3,
    },
    /// There are no shards to merge.
    #[error("nothing to merge; expected at least one picture")]
    MergeNothing,
    /// Two shards both hold samples for some pixels.
    #[error(
        "{first} and {second} both have samples for {count} pixels, the first at x={x}, y={y}; expected disjoint shards of one render"
    )]
    MergeOverlap {
        /// One of the shards.
        first: String,
        /// The other one.
        second: String,
        /// How many pixels both have.
        count: usize,
        /// Column of the first such pixel.
        x: u32,
        /// Row of the first such pixel, from the top.
        y: u32,
    },
    /// No shard holds samples for some pixels.
    #[error(
        "{count} of {total} pixels have samples in none of {names}, the first at x={x}, y={y}; a shard is missing"
    )]
    MergeMissing {
        /// How many pixels are missing.
        count: usize,
        /// How many pixels there are.
        total: usize,
        /// The shards given.
        names: String,
        /// Column of the first missing pixel.
        x: u32,
        /// Row of the first missing pixel, from the top.
        y: u32,
    },
}
