//! A number between nothing and all.

use serde::Deserialize;

/// A fraction, in 0..=1: a share of a total, or a threshold. 0 by default.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(try_from = "f64")]
pub struct Fraction(f64);

impl Fraction {
    /// `value` in 0..=1, for a default.
    pub(super) const fn of(value: f64) -> Self {
        assert!(value >= 0.0 && value <= 1.0, "0..=1");
        Self(value)
    }

    /// As a number.
    pub fn get(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for Fraction {
    type Error = String;

    fn try_from(value: f64) -> Result<Self, String> {
        if (0.0..=1.0).contains(&value) {
            Ok(Self(value))
        } else {
            Err(format!("found {value}; expected 0..=1"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fraction_outside_of_its_range_is_refused() {
        for bad in [-0.1, 1.1, f64::NAN, f64::INFINITY] {
            assert!(Fraction::try_from(bad).is_err(), "{bad}");
        }
    }
}
