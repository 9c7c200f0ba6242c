//! How many lights a point draws, or clusters a cut has.

use serde::Deserialize;

/// Number of light samples at a point, or of clusters in a cut, 1..=65536.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "u64")]
pub struct Count(u32);

impl Count {
    /// `count`, which must be in range.
    pub(crate) const fn of(count: u32) -> Self {
        assert!(count >= 1 && count <= 65536, "1..=65536");
        Self(count)
    }

    /// As a number.
    pub fn get(self) -> u32 {
        self.0
    }
}

impl Default for Count {
    /// 10, the size of a cut in the published comparisons.
    fn default() -> Self {
        Self(10)
    }
}

impl TryFrom<u64> for Count {
    type Error = String;

    fn try_from(value: u64) -> Result<Self, String> {
        match u32::try_from(value) {
            Ok(count @ 1..=65536) => Ok(Self(count)),
            _ => Err(format!("found {value}; expected 1..=65536")),
        }
    }
}
