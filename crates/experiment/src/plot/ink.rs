//! Lines, markers and letters, in units that the scale turns into pixels.

use plotters::coord::Shift;
use plotters::element::{DashedPathElement, PathElement, Polygon, Rectangle, Text};
use plotters::prelude::{DrawingArea, DrawingBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{
    BLACK, Color, FontTransform, IntoFont, IntoTextStyle, RGBColor, ShapeStyle, TextStyle,
};

use super::DrawError;

/// Where a text is relative to its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// Begins there, level with it.
    Right,
    /// Ends there, level with it.
    Left,
    /// Centred on it.
    Middle,
    /// Centred below it.
    Below,
    /// Centred on it, read from below.
    Upwards,
}

/// How a curve looks: no two alike, in colour or without.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    colour: RGBColor,
    /// Length of dash and gap; none for a solid line.
    dash: Option<(i32, i32)>,
    /// Corners of the marker around its centre, in units of its radius.
    marker: &'static [(f64, f64)],
    filled: bool,
}

/// Colours that the colour-blind can tell apart, none so light that it vanishes.
///
/// Source: Okabe and Ito 2008, Color universal design.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 0, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(160, 110, 0),
];

const MARKERS: [&[(f64, f64)]; 5] = [
    // Circle enough at this size; square, triangle, diamond, triangle on its head.
    &[
        (1.0, 0.0),
        (0.71, 0.71),
        (0.0, 1.0),
        (-0.71, 0.71),
        (-1.0, 0.0),
        (-0.71, -0.71),
        (0.0, -1.0),
        (0.71, -0.71),
    ],
    &[(0.85, 0.85), (-0.85, 0.85), (-0.85, -0.85), (0.85, -0.85)],
    &[(0.0, -1.1), (1.0, 0.8), (-1.0, 0.8)],
    &[(0.0, -1.2), (1.2, 0.0), (0.0, 1.2), (-1.2, 0.0)],
    &[(0.0, 1.1), (-1.0, -0.8), (1.0, -0.8)],
];

const DASHES: [Option<(i32, i32)>; 4] = [None, Some((9, 4)), Some((2, 3)), Some((14, 3))];

impl Look {
    /// The look of the `n`-th curve.
    pub(super) fn of(n: usize) -> Self {
        Self {
            colour: COLOURS[n % COLOURS.len()],
            dash: DASHES[n % DASHES.len()],
            marker: MARKERS[n % MARKERS.len()],
            filled: (n / MARKERS.len()).is_multiple_of(2),
        }
    }
}

/// A drawing area and how many pixels a unit has.
pub(super) struct Ink<'a, DB: DrawingBackend> {
    pub(super) root: &'a DrawingArea<DB, Shift>,
    pub(super) scale: i32,
}

type Drawn<DB> = Result<(), DrawError<DB>>;

impl<DB: DrawingBackend> Ink<'_, DB> {
    fn pixel(&self, at: (f64, f64)) -> (i32, i32) {
        let scale = f64::from(self.scale);
        ((at.0 * scale).round() as i32, (at.1 * scale).round() as i32)
    }

    fn stroke(&self, colour: RGBColor, width: u32) -> ShapeStyle {
        colour.stroke_width(width * self.scale as u32)
    }

    /// A straight line for axes and grids; `grey` from 0, black, to 255.
    pub(super) fn rule(&self, from: (f64, f64), to: (f64, f64), grey: u8) -> Drawn<DB> {
        let ends = [self.pixel(from), self.pixel(to)];
        let style = self.stroke(RGBColor(grey, grey, grey), 1);
        self.root.draw(&PathElement::new(ends, style))
    }

    /// A dotted line.
    pub(super) fn dots(&self, from: (f64, f64), to: (f64, f64)) -> Drawn<DB> {
        let ends = [self.pixel(from), self.pixel(to)];
        let style = self.stroke(RGBColor(90, 90, 90), 1);
        let element = DashedPathElement::new(ends, 2 * self.scale, 4 * self.scale, style);
        self.root.draw(&element)
    }

    /// A curve with a marker at each point.
    pub(super) fn curve(&self, points: &[(f64, f64)], look: Look) -> Drawn<DB> {
        let pixels: Vec<_> = points.iter().map(|&p| self.pixel(p)).collect();
        let style = self.stroke(look.colour, 2);
        match look.dash {
            _ if pixels.len() < 2 => {}
            None => self.root.draw(&PathElement::new(pixels, style))?,
            Some((dash, gap)) => {
                let (dash, gap) = (dash * self.scale, gap * self.scale);
                let element = DashedPathElement::new(pixels, dash, gap, style);
                self.root.draw(&element)?;
            }
        }
        for &point in points {
            self.marker(point, look)?;
        }
        Ok(())
    }

    fn marker(&self, at: (f64, f64), look: Look) -> Drawn<DB> {
        const RADIUS: f64 = 4.5;
        let corner = |&(x, y): &(f64, f64)| self.pixel((at.0 + RADIUS * x, at.1 + RADIUS * y));
        let mut corners: Vec<_> = look.marker.iter().map(corner).collect();
        let inside = match look.filled {
            true => look.colour,
            false => RGBColor(255, 255, 255),
        };
        self.root
            .draw(&Polygon::new(corners.clone(), inside.filled()))?;
        corners.push(corners[0]);
        let style = self.stroke(look.colour, 1);
        self.root.draw(&PathElement::new(corners, style))
    }

    /// A vertical range with short ends.
    pub(super) fn whisker(&self, x: f64, low: f64, high: f64, look: Look) -> Drawn<DB> {
        let style = self.stroke(look.colour, 1);
        for ends in [
            [(x, low), (x, high)],
            [(x - 3.0, low), (x + 3.0, low)],
            [(x - 3.0, high), (x + 3.0, high)],
        ] {
            let ends = ends.map(|p| self.pixel(p));
            self.root.draw(&PathElement::new(ends, style))?;
        }
        Ok(())
    }

    /// A filled box with a thin edge.
    pub(super) fn bar(&self, from: (f64, f64), to: (f64, f64), grey: u8) -> Drawn<DB> {
        let corners = [self.pixel(from), self.pixel(to)];
        let fill = RGBColor(grey, grey, grey).filled();
        self.root.draw(&Rectangle::new(corners, fill))?;
        let edge = self.stroke(RGBColor(60, 60, 60), 1);
        self.root.draw(&Rectangle::new(corners, edge))
    }

    /// Black letters of `size` units; `None` of the backend's own layout is used.
    pub(super) fn text(&self, text: &str, at: (i32, i32), size: i32, place: Place) -> Drawn<DB> {
        self.letters(text, at, size, place, false)
    }

    /// White letters, for dark boxes.
    pub(super) fn light_text(&self, text: &str, at: (i32, i32), size: i32) -> Drawn<DB> {
        self.letters(text, at, size, Place::Middle, true)
    }

    fn letters(
        &self,
        text: &str,
        at: (i32, i32),
        size: i32,
        place: Place,
        light: bool,
    ) -> Drawn<DB> {
        let (h, v) = match place {
            Place::Right => (HPos::Left, VPos::Center),
            Place::Left => (HPos::Right, VPos::Center),
            Place::Middle => (HPos::Center, VPos::Center),
            Place::Below => (HPos::Center, VPos::Top),
            Place::Upwards => (HPos::Center, VPos::Center),
        };
        let mut font = ("sans-serif", size * self.scale).into_font();
        if place == Place::Upwards {
            font = font.transform(FontTransform::Rotate270);
        }
        let white = RGBColor(255, 255, 255);
        let style: TextStyle<'_> = match light {
            true => font.color(&white),
            false => font.color(&BLACK),
        };
        let style = style.pos(Pos::new(h, v)).into_text_style(self.root);
        let at = (at.0 * self.scale, at.1 * self.scale);
        self.root.draw(&Text::new(text.to_owned(), at, style))
    }
}
