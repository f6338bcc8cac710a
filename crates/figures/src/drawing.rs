//! A drawing: marks on a page of a stated size in points, and the files that it is written as.
//!
//! One list of [marks](Mark) becomes [SVG](svg), [PNG](png) and [PDF](pdf). Text is set in one font that the program
//! carries ([`font`]), so that a machine without fonts writes the same file. Equal drawings give equal bytes.

mod font;
mod pdf;
mod png;
mod svg;

pub(crate) use font::{ascent, width};

/// Points per inch, and millimetres per inch.
pub(crate) const POINTS_PER_INCH: f64 = 72.0;
pub(crate) const MM_PER_INCH: f64 = 25.4;

/// Red, green, blue.
pub type Colour = [u8; 3];

/// The colour of text.
pub const BLACK: Colour = [0; 3];
/// The colour of the page.
pub(crate) const WHITE: Colour = [255; 3];

/// A point: to the right and down from the upper left corner, points.
pub(crate) type At = (f64, f64);

/// What is on a page; later marks cover earlier ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    pub(crate) width_pt: f64,
    pub(crate) height_pt: f64,
    pub(crate) marks: Vec<Mark>,
}

/// One thing on the page.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Mark {
    /// A line through points.
    Line { points: Vec<At>, stroke: Stroke },
    /// The area between points.
    Area { points: Vec<At>, fill: Fill },
    /// A dot around a point.
    Dot { at: At, radius: f64, fill: Fill },
    /// Words on a line.
    Text(Text),
    /// A picture, its upper left corner and its size on the page.
    Picture { at: At, size: (f64, f64), picture: Picture },
    /// From here to its end only this rectangle is drawn; one at a time.
    Clip { at: At, size: (f64, f64) },
    /// The end of a rectangle.
    Unclip,
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    pub(crate) colour: Colour,
    pub(crate) width: f64,
    pub(crate) opacity: f64,
    pub(crate) dashes: &'static [f64],
}

/// How an area is filled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fill {
    pub(crate) colour: Colour,
    pub(crate) opacity: f64,
}

/// Words.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Text {
    pub(crate) at: At,
    pub(crate) words: String,
    pub(crate) size: f64,
    pub(crate) colour: Colour,
    pub(crate) anchor: Anchor,
    pub(crate) upwards: bool,
}

/// Which part of a line of words is at its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Its start.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

impl Anchor {
    /// The share of the words before their point.
    pub(crate) fn before(self) -> f64 {
        0.5 * f64::from(self as u8)
    }
}

/// Pixels, three bytes each, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) rgb: Vec<u8>,
}

impl Stroke {
    /// A solid line of a width in points.
    pub const fn new(colour: Colour, width: f64) -> Self {
        Self { colour, width, opacity: 1.0, dashes: &[] }
    }

    /// The same in dashes: lengths of line and gap in turn, points.
    pub const fn dashed(self, dashes: &'static [f64]) -> Self {
        Self { dashes, ..self }
    }

    /// The same with an opacity from 0 to 1.
    pub const fn faint(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }
}

impl Fill {
    /// A colour with an opacity from 0 to 1.
    pub const fn new(colour: Colour, opacity: f64) -> Self {
        Self { colour, opacity }
    }
}

impl Drawing {
    pub(crate) fn line(&mut self, points: Vec<At>, stroke: Stroke) {
        self.marks.push(Mark::Line { points, stroke });
    }

    pub(crate) fn rectangle(&mut self, (x, y): At, (width, height): (f64, f64), fill: Fill) {
        let points = vec![(x, y), (x + width, y), (x + width, y + height), (x, y + height)];
        self.marks.push(Mark::Area { points, fill });
    }

    /// Black words whose base line is there.
    pub(crate) fn text(&mut self, at: At, words: impl Into<String>, size: f64, anchor: Anchor) {
        self.marks.push(Mark::Text(Text { at, words: words.into(), size, colour: BLACK, anchor, upwards: false }));
    }

    /// Its width and height, millimetres.
    pub fn size_mm(&self) -> (f64, f64) {
        let mm = |points: f64| (points / POINTS_PER_INCH * MM_PER_INCH * 1000.0).round() / 1000.0;
        (mm(self.width_pt), mm(self.height_pt))
    }

    /// As SVG, in millimetres.
    pub fn svg(&self) -> String {
        svg::written(self)
    }

    /// As PDF of one page; its text can be searched and copied.
    pub fn pdf(&self, title: &str) -> Vec<u8> {
        pdf::written(self, title)
    }

    /// As PNG with a number of pixels per inch.
    ///
    /// # Errors
    /// If it has too many pixels, in words.
    pub fn png(&self, dpi: f64) -> Result<Vec<u8>, String> {
        png::written(self, dpi)
    }
}

#[cfg(test)]
mod tests;
