//! What a render leaves behind: pixel statistics, EXR and PNG files, and error figures.
//!
//! - [`PixelStats`] takes a pixel's samples one by one and knows their mean and its variance.
//! - [`Picture`] is a finished render with its layers; it is written as one EXR and one PNG, and
//!   shards of a render are joined with [`Picture::merge`].
//! - [`Image`] is only colours: what [`read_image`] takes from anybody's EXR for a comparison.
//! - [`compare`] gives error figures, FLIP among them; [`Bias`] says which part of an error is not noise, and
//!   [`Flicker`] how an error changes from frame to frame.
//! - [`write_atomically`] is the one door through which files leave: whole or not at all.
//!
//! ```
//! use glam::Vec3;
//! use manylight_film::{Image, PixelStats, compare};
//!
//! let mut pixel = PixelStats::default();
//! for sample in [0.5, 1.0, 1.5] {
//!     assert!(pixel.add(Vec3::splat(sample)), "a finite sample counts");
//! }
//! assert_eq!(pixel.mean(), Vec3::ONE);
//! assert!((pixel.variance_of_mean().x - 0.25 / 3.0).abs() < 1e-6);
//!
//! let reference = Image { width: 16, height: 16, pixels: vec![Vec3::ONE; 256] };
//! let image = Image { pixels: vec![pixel.mean() * 1.1; 256], ..reference.clone() };
//! let error = compare(&image, &reference)?;
//! assert!((error.mean_ratio - 1.1).abs() < 1e-6 && (error.relmse - 0.01 / 1.01).abs() < 1e-6);
//! # Ok::<(), manylight_film::FilmError>(())
//! ```

mod atomic;
mod bias;
#[cfg(feature = "denoise")]
mod denoise;
mod error;
mod exr;
mod film;
mod flicker;
mod flip;
mod metadata;
mod metrics;
mod picture;
mod png;

pub use crate::exr::{Image, read_image};
pub use atomic::{remove_abandoned, remove_all_abandoned, write_atomically};
pub use bias::{Bias, Interval, relative_variance};
#[cfg(feature = "denoise")]
pub use denoise::{DenoiseError, Denoiser};
pub use error::FilmError;
pub use film::PixelStats;
pub use flicker::{FLICKER_BLOCK, Flicker};
pub use flip::{PIXELS_PER_DEGREE, flip_map, ldr_flip_map};
pub use metadata::{CameraMatrices, Metadata};
pub use metrics::{Metrics, compare, compare_without_flip};
pub use picture::Picture;
pub use png::{Exposure, auto_exposure, tone_map, write_rgb8};
