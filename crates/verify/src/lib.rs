//! Checks for tests: statistics, and damaged inputs.
//!
//! A check of random numbers fails now and then although nothing is wrong. Its **false-alarm rate** α is the
//! probability of that, and it is the caller's to choose: a test that fails when `p < alpha` raises a false alarm
//! in a share α of its runs *with different seeds*. With a pinned seed a test either always passes or always fails,
//! so α is then the chance that an honest change of the random stream (another order of draws, say) makes
//! it fail. Where one test makes many comparisons, [`sidak`] gives the α for each that keeps the whole at α.
//! Choose α small (1e-6 and below): real errors drive p to 1e-20 with enough samples, and a false alarm
//! costs an afternoon.
//!
//! - [`chi_square`]: do frequencies fit probabilities?
//! - [`z_test`], [`p_value`], [`critical_z`]: does a mean fit the truth?
//! - [`normal_fit`]: are z-scores, taken together, those of a sound estimator?
//! - [`Running`]: mean and variance on the fly.
//! - [`annotated`]: does a commented file say what the types behind it hold?
//! - [`property`]: does something hold for any input, by inputs that are the same in every run?
//! - [`Fuzz`]: does what reads files stand what files may hold?

mod annotated;
mod chi_square;
mod fuzz;
mod normal;
mod property;
mod running;

pub use annotated::{Annotated, annotated};
pub use chi_square::{ChiSquare, chi_square};
pub use fuzz::{Fuzz, Outcome};
pub use normal::{critical_z, normal_fit, p_value, sidak, z_test};
pub use property::property;
pub use running::Running;

pub use arbtest::arbitrary;

/// A small generator for this crate's own tests (SplitMix64, Steele et al. 2014), so that it depends on none.
#[cfg(test)]
struct SplitMix(u64);

#[cfg(test)]
impl SplitMix {
    /// Uniform in [0, 1).
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal (Box–Muller).
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}
