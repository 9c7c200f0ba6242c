//! What a render leaves behind: pixel statistics, EXR and PNG files, and error figures.
//!
//! - [`PixelStats`] takes a pixel's samples one by one and knows their mean and its variance.
//! - [`Picture`] is a finished render with its layers; it is written as one EXR and one PNG, and
//!   shards of a render are joined with [`Picture::merge`].
//! - [`Image`] is only colours: what [`read_image`] takes from anybody's EXR for a comparison.
//! - [`compare`] gives error figures, FLIP among them; [`Bias`] says which part of an error is not noise, and
//!   [`Flicker`] how an error changes from frame to frame.
//! - [`write_atomically`] is the one door through which files leave: whole or not at all.

mod atomic;
mod bias;
mod error;
mod exr;
mod film;
mod flicker;
mod flip;
mod metrics;
mod picture;
mod png;

pub use crate::exr::{Image, read_image};
pub use atomic::{remove_abandoned, remove_all_abandoned, write_atomically};
pub use bias::{Bias, Interval, relative_variance};
pub use error::FilmError;
pub use film::PixelStats;
pub use flicker::{FLICKER_BLOCK, Flicker};
pub use flip::{PIXELS_PER_DEGREE, flip_map, ldr_flip_map};
pub use metrics::{Metrics, compare, compare_without_flip};
pub use picture::Picture;
pub use png::{Exposure, auto_exposure, tone_map, write_rgb8};
