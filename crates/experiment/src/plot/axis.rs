//! Logarithmic axes.

/// Decades that an axis shows at least: among these is always a labelled tick.
const LEAST_SPAN: f64 = 0.6;
/// Below so many decades 2 and 5 are labelled as well.
const FEW_DECADES: f64 = 1.8;

/// A logarithmic axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LogAxis {
    /// log₁₀ of either end.
    low: f64,
    high: f64,
}

/// A grid line, with a label or without.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    /// 0 at the lower end, 1 at the upper.
    pub(super) at: f64,
    pub(super) label: Option<String>,
}

impl LogAxis {
    /// An axis around the finite positive ones of `values`, with a little room; `None` when there is none.
    pub(super) fn around(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let usable = |v: &f64| v.is_finite() && *v > 0.0;
        let logs = values.into_iter().filter(usable).map(f64::log10);
        let (low, high) = logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(v), high.max(v))
        });
        if low > high {
            return None;
        }
        let room = (0.04 * (high - low))
            .max(0.5 * (LEAST_SPAN - (high - low)))
            .max(0.03);
        Some(Self {
            low: low - room,
            high: high + room,
        })
    }

    /// 0 at the lower end, 1 at the upper; `value` is above 0.
    pub(super) fn at(self, value: f64) -> f64 {
        (value.log10() - self.low) / (self.high - self.low)
    }

    /// Grid lines at 1, 2, 3 … 9 times the powers of ten.
    pub(super) fn ticks(self) -> Vec<Tick> {
        let few = self.high - self.low < FEW_DECADES;
        let sparse = (self.high - self.low).ceil() as i32 / 8 + 1;
        let mut ticks = Vec::new();
        for decade in self.low.floor() as i32..=self.high.floor() as i32 {
            for factor in 1..10 {
                let log = f64::from(decade) + f64::from(factor).log10();
                if !(self.low..=self.high).contains(&log) {
                    continue;
                }
                let labelled = match factor {
                    1 => decade % sparse == 0,
                    2 | 5 => few,
                    _ => false,
                };
                ticks.push(Tick {
                    at: (log - self.low) / (self.high - self.low),
                    label: labelled.then(|| label(factor, decade)),
                });
            }
        }
        ticks
    }
}

/// factor · 10^decade, plainly where that is short.
fn label(factor: i32, decade: i32) -> String {
    match decade {
        0..=4 => format!("{}", i64::from(factor) * 10_i64.pow(decade as u32)),
        -3..=-1 => format!(
            "{:.*}",
            -decade as usize,
            f64::from(factor) * 10_f64.powi(decade)
        ),
        _ => format!("{factor}e{decade}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(values: &[f64]) -> Vec<String> {
        let axis = LogAxis::around(values.iter().copied()).expect("values");
        axis.ticks().into_iter().filter_map(|t| t.label).collect()
    }

    #[test]
    fn decades_are_labelled_and_within_one_two_and_five_as_well() {
        assert_eq!(labels(&[0.02, 30.0]), ["0.1", "1", "10"], "three decades");
        assert_eq!(labels(&[0.9, 6.0]), ["1", "2", "5"], "one decade");
        assert_eq!(labels(&[1e-6, 2e-4]), ["1e-6", "1e-5", "1e-4"], "small");
        assert!(
            !labels(&[3.0]).is_empty(),
            "a single value has a tick near it"
        );
    }

    #[test]
    fn values_lie_inside_and_what_is_not_positive_counts_for_nothing() {
        let axis = LogAxis::around([0.0, f64::NAN, 1.0, 100.0]).expect("two");
        assert!((axis.at(10.0) - 0.5).abs() < 1e-12, "the middle");
        assert!(axis.at(1.0) > 0.0 && axis.at(100.0) < 1.0, "room");
        assert_eq!(LogAxis::around([0.0, -1.0]), None, "none");
    }
}
