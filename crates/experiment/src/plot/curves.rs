//! Curves over two logarithmic axes.

use plotters::coord::Shift;
use plotters::prelude::{DrawingArea, DrawingBackend};

use super::axis::LogAxis;
use super::ink::{Ink, Look, Place};
use super::{DrawError, Drawing, SIZE};
use crate::statistics::Spread;

/// Curves with axes, of which at least one point can be drawn.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Curves {
    pub(super) title: String,
    /// What is along the axis, with its unit.
    pub(super) x: &'static str,
    pub(super) y: &'static str,
    pub(super) curves: Vec<Curve>,
    /// A level below which no y is known, and what it is.
    pub(super) floor: Option<(f64, &'static str)>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Curve {
    pub(super) label: String,
    /// A second line of the legend; may be empty.
    pub(super) note: String,
    /// In order of x.
    pub(super) points: Vec<(f64, Spread)>,
}

/// Edges of the plot within the picture; the legend is to the right.
const LEFT: f64 = 74.0;
const RIGHT: f64 = SIZE.0 as f64 - 250.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = SIZE.1 as f64 - 58.0;

impl Curves {
    fn axes(&self) -> Option<(LogAxis, LogAxis)> {
        let points = || self.curves.iter().flat_map(|c| &c.points);
        let x = LogAxis::around(points().map(|p| p.0))?;
        let floor = self.floor.map(|f| f.0);
        let y = points().flat_map(|p| [p.1.low, p.1.high]).chain(floor);
        Some((x, LogAxis::around(y)?))
    }

    /// Whether there is a point to draw.
    pub(super) fn has_points(&self) -> bool {
        self.axes().is_some()
    }
}

impl Drawing for Curves {
    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
        scale: i32,
    ) -> Result<(), DrawError<DB>> {
        let Some((x_axis, y_axis)) = self.axes() else {
            return Ok(());
        };
        let ink = Ink { root, scale };
        let x = |at: f64| LEFT + at * (RIGHT - LEFT);
        let y = |at: f64| BOTTOM - at * (BOTTOM - TOP);
        for tick in x_axis.ticks() {
            let at = x(tick.at);
            let grey = if tick.label.is_some() { 205 } else { 236 };
            ink.rule((at, TOP), (at, BOTTOM), grey)?;
            if let Some(label) = tick.label {
                ink.text(&label, (at as i32, BOTTOM as i32 + 7), 13, Place::Below)?;
            }
        }
        for tick in y_axis.ticks() {
            let at = y(tick.at);
            let grey = if tick.label.is_some() { 205 } else { 236 };
            ink.rule((LEFT, at), (RIGHT, at), grey)?;
            if let Some(label) = tick.label {
                ink.text(&label, (LEFT as i32 - 7, at as i32), 13, Place::Left)?;
            }
        }
        for [from, to] in [
            [(LEFT, TOP), (LEFT, BOTTOM)],
            [(LEFT, BOTTOM), (RIGHT, BOTTOM)],
            [(RIGHT, BOTTOM), (RIGHT, TOP)],
            [(RIGHT, TOP), (LEFT, TOP)],
        ] {
            ink.rule(from, to, 60)?;
        }
        let middle = ((LEFT + RIGHT) / 2.0) as i32;
        ink.text(&self.title, (middle, 20), 15, Place::Middle)?;
        ink.text(self.x, (middle, BOTTOM as i32 + 32), 14, Place::Below)?;
        let level = ((TOP + BOTTOM) / 2.0) as i32;
        ink.text(self.y, (18, level), 14, Place::Upwards)?;
        if let Some((floor, what)) = self.floor {
            let at = y(y_axis.at(floor));
            ink.dots((LEFT, at), (RIGHT, at))?;
            ink.text(what, (LEFT as i32 + 6, at as i32 - 9), 12, Place::Right)?;
        }
        for (n, curve) in self.curves.iter().enumerate() {
            let look = Look::of(n);
            let usable = |v: f64| v.is_finite() && v > 0.0;
            let own = curve.points.iter();
            let own = own.filter(|(at, spread)| usable(*at) && usable(spread.low));
            let mut line = Vec::new();
            for (at, spread) in own {
                let at = x(x_axis.at(*at));
                let level = |value| y(y_axis.at(value));
                if spread.low < spread.high {
                    ink.whisker(at, level(spread.low), level(spread.high), look)?;
                }
                line.push((at, level(spread.median)));
            }
            ink.curve(&line, look)?;
        }
        self.legend(&ink)
    }
}

impl Curves {
    fn legend<DB: DrawingBackend>(&self, ink: &Ink<'_, DB>) -> Result<(), DrawError<DB>> {
        let step = ((BOTTOM - TOP) / self.curves.len().max(1) as f64).min(38.0);
        for (n, curve) in self.curves.iter().enumerate() {
            let level = TOP + 10.0 + n as f64 * step;
            let sample = [RIGHT + 14.0, RIGHT + 32.0, RIGHT + 50.0].map(|x| (x, level));
            let look = Look::of(n);
            ink.curve(&[sample[0], sample[2]], look)?;
            let at = (RIGHT as i32 + 60, level as i32);
            ink.text(&curve.label, at, 13, Place::Right)?;
            if !curve.note.is_empty() && step >= 30.0 {
                ink.text(&curve.note, (at.0, at.1 + 15), 12, Place::Right)?;
            }
        }
        Ok(())
    }
}
