//! What a cell may spend.

use std::fmt;

use serde::Deserialize;

use super::spec::Level;
use crate::error::CliError;
use crate::job::Samples;

/// When a render ends. Equal samples or equal time is the same budget for all methods.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(crate) enum Budget {
    /// Samples a pixel.
    Spp(Samples),
    /// Lights evaluated, a pixel: as many for a method that looks at ten lights a sample as for one that looks
    /// at a thousand.
    LightSamples(Level),
    /// Wall-clock seconds of rendering.
    Seconds(Level),
    /// Processor seconds of rendering, all threads: steadier where other programs run.
    CpuSeconds(Level),
}

/// What a render has spent so far.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Spent {
    pub(crate) spp: u32,
    pub(crate) light_samples_per_pixel: f64,
    pub(crate) seconds: f64,
    /// `None` where the system does not say.
    pub(crate) cpu_seconds: Option<f64>,
}

impl Budget {
    /// The most samples a pixel that a render may come to have.
    pub(crate) fn most_spp(self) -> u32 {
        match self {
            Self::Spp(spp) => spp.0,
            _ => *Samples::RANGE.end(),
        }
    }

    /// Samples a pixel that may be made next; 0 when the budget is spent.
    ///
    /// Where cost is limited, passes at most double what is done, and the last one is as large as the cost so far
    /// lets expect to end nearest the limit, perhaps a little beyond it. There is always a first sample.
    ///
    /// # Errors
    /// When the render does not spend, or nobody knows, what is limited.
    pub(crate) fn next(self, spent: &Spent) -> Result<u32, CliError> {
        let (used, limit) = match self {
            Self::Spp(spp) => return Ok(spp.0.saturating_sub(spent.spp)),
            Self::LightSamples(limit) => (Some(spent.light_samples_per_pixel), limit.0),
            Self::Seconds(limit) => (Some(spent.seconds), limit.0),
            Self::CpuSeconds(limit) => (spent.cpu_seconds, limit.0),
        };
        if spent.spp == 0 {
            return Ok(1);
        }
        match used {
            Some(used) if used > 0.0 => {
                let affordable = (limit - used) / (used / f64::from(spent.spp));
                Ok(affordable.round().clamp(0.0, f64::from(spent.spp)) as u32)
            }
            _ => Err(CliError::Input(format!(
                "the budget of {self} is never spent; expected another budget"
            ))),
        }
    }

    /// A small budget of the same kind.
    pub(crate) fn quick(self) -> Self {
        let at_most = |level: Level, most: f64| Level(level.0.min(most));
        match self {
            Self::Spp(spp) => Self::Spp(Samples(spp.0.min(4))),
            Self::LightSamples(n) => Self::LightSamples(at_most(n, 40.0)),
            Self::Seconds(t) => Self::Seconds(at_most(t, 1.0)),
            Self::CpuSeconds(t) => Self::CpuSeconds(at_most(t, 2.0)),
        }
    }
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Spp(spp) => write!(f, "{} spp", spp.0),
            Self::LightSamples(n) => write!(f, "{} light samples", n.0),
            Self::Seconds(t) => write!(f, "{} s", t.0),
            Self::CpuSeconds(t) => write!(f, "{} CPU s", t.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(spp: u32, seconds: f64) -> Spent {
        Spent {
            spp,
            seconds,
            ..Spent::default()
        }
    }

    #[test]
    fn samples_are_used_up_exactly() {
        let budget = Budget::Spp(Samples(64));
        assert_eq!(budget.next(&after(0, 0.0)).expect("spp"), 64, "all at once");
        assert_eq!(budget.next(&after(60, 9.0)).expect("spp"), 4, "the rest");
        assert_eq!(budget.next(&after(64, 9.0)).expect("spp"), 0, "spent");
    }

    #[test]
    fn time_ends_at_the_sample_nearest_the_limit() {
        let budget = Budget::Seconds(Level(10.0));
        let next = |spent| budget.next(&spent).expect("time");
        assert_eq!(next(after(0, 0.0)), 1, "there is always a first sample");
        assert_eq!(next(after(4, 1.0)), 4, "passes double");
        assert_eq!(next(after(32, 8.0)), 8, "two seconds at four a second");
        assert_eq!(next(after(39, 9.8)), 1, "0.8 of a sample is nearer 1");
        assert_eq!(next(after(39, 9.9)), 0, "0.4 is nearer 0");
        assert_eq!(next(after(1, 100.0)), 0, "one was too much");
    }

    #[test]
    fn what_is_never_spent_is_no_budget() {
        let error = Budget::LightSamples(Level(5.0)).next(&after(1, 1.0));
        assert!(error.is_err(), "no light is ever evaluated");
        assert!(Budget::CpuSeconds(Level(5.0)).next(&after(1, 1.0)).is_err());
    }
}
