//! How time divides among phases: a bar for each method.

use plotters::coord::Shift;
use plotters::prelude::{DrawingArea, DrawingBackend};

use super::ink::{Ink, Place};
use super::{DrawError, Drawing, SIZE};

/// Bars whose parts add up to the whole.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shares {
    pub(super) title: String,
    /// Names of the parts, the same for all bars.
    pub(super) parts: Vec<&'static str>,
    /// Label, and shares that add up to 1.
    pub(super) bars: Vec<(String, Vec<f64>)>,
}

const LEFT: f64 = 250.0;
const RIGHT: f64 = SIZE.0 as f64 - 30.0;
const TOP: f64 = 76.0;
const BOTTOM: f64 = SIZE.1 as f64 - 58.0;

/// Grey of the n-th part of five, dark beside light so that neighbours differ.
const GREYS: [u8; 5] = [245, 130, 205, 80, 165];
/// Parts below this share have no room for their number.
const LEAST_LABELLED: f64 = 0.06;

impl Drawing for Shares {
    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
        scale: i32,
    ) -> Result<(), DrawError<DB>> {
        let ink = Ink { root, scale };
        let x = |share: f64| LEFT + share * (RIGHT - LEFT);
        let middle = ((LEFT + RIGHT) / 2.0) as i32;
        ink.text(&self.title, (middle, 20), 15, Place::Middle)?;
        for percent in (0..=100).step_by(20) {
            let at = x(f64::from(percent) / 100.0);
            ink.rule((at, TOP), (at, BOTTOM), 205)?;
            let label = percent.to_string();
            ink.text(&label, (at as i32, BOTTOM as i32 + 7), 13, Place::Below)?;
        }
        let caption = "share of thread time [%]";
        ink.text(caption, (middle, BOTTOM as i32 + 32), 14, Place::Below)?;
        let step = ((BOTTOM - TOP) / self.bars.len().max(1) as f64).min(64.0);
        for (n, (label, shares)) in self.bars.iter().enumerate() {
            let (top, bottom) = (
                TOP + (n as f64 + 0.14) * step,
                TOP + (n as f64 + 0.86) * step,
            );
            let level = ((top + bottom) / 2.0) as i32;
            ink.text(label, (LEFT as i32 - 9, level), 13, Place::Left)?;
            let mut from = 0.0;
            for (part, &share) in shares.iter().enumerate() {
                let to = from + share;
                let grey = GREYS[part % GREYS.len()];
                ink.bar((x(from), top), (x(to), bottom), grey)?;
                if share >= LEAST_LABELLED {
                    let text = format!("{:.0} %", (100.0 * share).floor());
                    let at = (x((from + to) / 2.0) as i32, level);
                    match grey < 140 {
                        true => ink.light_text(&text, at, 12)?,
                        false => ink.text(&text, at, 12, Place::Middle)?,
                    }
                }
                from = to;
            }
        }
        let width = (RIGHT - LEFT) / self.parts.len().max(1) as f64;
        for (part, name) in self.parts.iter().enumerate() {
            let left = LEFT + part as f64 * width;
            ink.bar((left, 46.0), (left + 14.0, 60.0), GREYS[part % GREYS.len()])?;
            ink.text(name, (left as i32 + 20, 53), 13, Place::Right)?;
        }
        Ok(())
    }
}
