//! Memory: what a job will need, found out before anything large is allocated, and what there is.

use std::str::FromStr;

use crate::machine::{available_memory, human, resident};

/// What a triangle takes while the ray hierarchy is built, bytes: measured on three scenes, all that loading leaves
/// included.
const TRIANGLE: u64 = 270;

/// What a process may take.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct MemoryLimit {
    /// Of `--max-memory`; else what the machine has.
    pub(crate) most: Option<Bytes>,
}

/// A number of bytes, such as `2GB`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Bytes(pub(crate) u64);

impl FromStr for Bytes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let unit = match &text[digits.len()..] {
            "" | "B" => 1.0,
            "kB" | "KB" => 1e3,
            "MB" => 1e6,
            "GB" => 1e9,
            "TB" => 1e12,
            _ => f64::NAN,
        };
        match digits.parse::<f64>().map(|number| number * unit) {
            Ok(bytes) if (1.0..=1e18).contains(&bytes) => Ok(Self(bytes as u64)),
            _ => Err(format!(
                "found {text}; expected a number of bytes, such as 500MB or 2.5GB"
            )),
        }
    }
}

impl MemoryLimit {
    /// Refuses what would take `needed` bytes beyond those in use; else a message that begins with them.
    ///
    /// Nothing is refused where the system does not say what there is.
    pub(crate) fn refuse(self, needed: u64) -> Result<(), String> {
        let (free, whose) = match self.most {
            Some(Bytes(most)) => {
                let used = resident().unwrap_or(0);
                let whose = format!(
                    "left of the {} of --max-memory, {} being in use",
                    human(most),
                    human(used)
                );
                (most.saturating_sub(used), whose)
            }
            None => match available_memory() {
                Some(free) => (free, "that are free".to_owned()),
                None => return Ok(()),
            },
        };
        match needed <= free {
            true => Ok(()),
            false => Err(format!(
                "about {}; expected at most the {} {whose}",
                human(needed),
                human(free)
            )),
        }
    }

    /// Refuses to build the ray hierarchy of so many triangles.
    pub(crate) fn refuse_triangles(self, triangles: usize) -> Result<(), String> {
        self.refuse(triangles as u64 * TRIANGLE)
            .map_err(|message| format!("rays among {triangles} triangles need {message}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_read_with_and_without_a_unit() {
        for (text, bytes) in [
            ("1", 1),
            ("250B", 250),
            ("3kB", 3000),
            ("2.5GB", 2_500_000_000),
        ] {
            assert_eq!(text.parse::<Bytes>(), Ok(Bytes(bytes)), "{text}");
        }
        for text in [
            "", "0", "-1", "GB", "1 GB", "1QB", "nan", "inf", "1e300", "2gb2",
        ] {
            let message = text.parse::<Bytes>().expect_err(text);
            assert!(message.contains("expected a number of bytes"), "{message}");
        }
    }

    #[test]
    fn what_is_over_the_limit_is_refused_with_both_numbers() {
        let limit = MemoryLimit {
            most: Some(Bytes(1_000_000_000_000)),
        };
        assert_eq!(limit.refuse(1000), Ok(()), "fits");
        let message = limit.refuse(2_000_000_000_000).expect_err("too much");
        for part in ["about 2.0 TB", "--max-memory", "1.0 TB"] {
            assert!(message.contains(part), "{part} in {message}");
        }
        let message = limit.refuse_triangles(1 << 40).expect_err("too many");
        assert!(message.contains("1099511627776 triangles"), "{message}");
    }
}
