//! `--denoise`, in a program that can and in one that cannot.

#[cfg(feature = "denoise")]
pub(crate) use film::Denoiser;

use crate::error::CliError;

/// Nothing: this program was built without the feature.
#[cfg(not(feature = "denoise"))]
pub(crate) enum Denoiser {}

#[cfg(not(feature = "denoise"))]
impl Denoiser {
    fn load() -> Result<Self, &'static str> {
        Err(
            "this program was built without it; expected one built by `cargo build --release --features denoise`",
        )
    }

    /// As that of a program that can.
    pub(crate) fn denoise(&self, _: &film::Picture) -> Result<film::Image, CliError> {
        match *self {}
    }
}

/// What denoises, found before hours go into what is to be denoised.
///
/// # Errors
/// When there is nothing.
pub(crate) fn denoiser() -> Result<Denoiser, CliError> {
    Denoiser::load().map_err(|error| CliError::Input(format!("--denoise: {error}")))
}
