//! A drawing: what is to be seen where, in points on a page of a stated size, and the files it is written as.
//!
//! One list of [marks](Mark) makes [SVG](svg), [PNG](png) and [PDF](pdf). Text is set in one font that the program carries ([`font`]), so that a machine
//! without fonts gives the same file. Equal drawings give equal bytes.

mod font;
mod pdf;
mod png;
mod svg;

pub use font::{ascent, width};

/// Points an inch, and millimetres an inch.
pub const POINTS_PER_INCH: f64 = 72.0;
pub const MM_PER_INCH: f64 = 25.4;

/// Red, green, blue.
pub type Colour = [u8; 3];

pub const BLACK: Colour = [0; 3];
pub const WHITE: Colour = [255; 3];

/// A colour written `#rrggbb`.
pub fn colour(text: &str) -> Colour {
    let part = |at: usize| text.get(at..at + 2).and_then(|hex| u8::from_str_radix(hex, 16).ok()).unwrap_or(0);
    [part(1), part(3), part(5)]
}

/// A point: to the right and down from the upper left corner, points.
pub type At = (f64, f64);

/// What is seen, what comes later above what came before.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    pub width_pt: f64,
    pub height_pt: f64,
    pub marks: Vec<Mark>,
}

/// One thing to be seen.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A line through points.
    Line { points: Vec<At>, stroke: Stroke },
    /// What lies between points.
    Area { points: Vec<At>, fill: Fill },
    /// A dot around a point.
    Dot { at: At, radius: f64, fill: Fill },
    /// Words on a line.
    Text(Text),
    /// A picture, its upper left corner and its size on the page.
    Picture { at: At, size: (f64, f64), picture: Picture },
    /// From here to its end only what lies in this rectangle is seen; one at a time.
    Clip { at: At, size: (f64, f64) },
    /// The end of a rectangle.
    Unclip,
}

/// How a line is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Stroke {
    pub colour: Colour,
    pub width: f64,
    pub opacity: f64,
    /// How long it is there and not there, in turn; empty: all there.
    pub dashes: &'static [f64],
}

/// How an area is filled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fill {
    pub colour: Colour,
    pub opacity: f64,
}

/// Words.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    pub at: At,
    pub words: String,
    pub size: f64,
    pub colour: Colour,
    pub anchor: Anchor,
    /// Whether they go upwards.
    pub upwards: bool,
}

/// Which part of a line of words stands at its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// Pixels, three bytes each, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<u8>,
}

impl Stroke {
    pub const fn new(colour: Colour, width: f64) -> Self {
        Self { colour, width, opacity: 1.0, dashes: &[] }
    }

    pub const fn dashed(self, dashes: &'static [f64]) -> Self {
        Self { dashes, ..self }
    }

    pub const fn faint(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }
}

impl Fill {
    pub const fn new(colour: Colour, opacity: f64) -> Self {
        Self { colour, opacity }
    }
}

impl Drawing {
    pub fn new(width_pt: f64, height_pt: f64) -> Self {
        Self { width_pt, height_pt, marks: Vec::new() }
    }

    pub fn line(&mut self, points: Vec<At>, stroke: Stroke) {
        self.marks.push(Mark::Line { points, stroke });
    }

    pub fn area(&mut self, points: Vec<At>, fill: Fill) {
        self.marks.push(Mark::Area { points, fill });
    }

    /// A filled rectangle.
    pub fn rectangle(&mut self, (x, y): At, (width, height): (f64, f64), fill: Fill) {
        self.area(vec![(x, y), (x + width, y), (x + width, y + height), (x, y + height)], fill);
    }

    /// The edge of a rectangle.
    pub fn frame(&mut self, (x, y): At, (width, height): (f64, f64), stroke: Stroke) {
        self.line(vec![(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)], stroke);
    }

    /// Words whose base line stands there.
    pub fn text(&mut self, at: At, words: impl Into<String>, size: f64, anchor: Anchor) {
        self.marks.push(Mark::Text(Text { at, words: words.into(), size, colour: BLACK, anchor, upwards: false }));
    }

    /// Its width and height, millimetres.
    #[must_use]
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

    /// As PNG of so many pixels an inch.
    ///
    /// # Errors
    /// If it has too many pixels, in words.
    pub fn png(&self, dpi: f64) -> Result<Vec<u8>, String> {
        png::written(self, dpi)
    }
}

/// A point of a picture as a number is written: three decimals, none that are not needed.
fn number(value: f64) -> String {
    let rounded = (value * 1000.0).round() / 1000.0;
    // Never `-0`.
    format!("{}", rounded + 0.0)
}

/// The four curves of a circle, each by two directing points and its end; it begins at its rightmost point.
fn circle((x, y): At, radius: f64) -> (At, [[At; 3]; 4]) {
    // How far directing points lie off for a curve that is nearly round.
    let far = radius * 0.552_284_749_8;
    let quarter = |(ax, ay): At, (bx, by): At, end: At| [(x + ax, y + ay), (x + bx, y + by), (x + end.0, y + end.1)];
    let curves = [
        quarter((radius, far), (far, radius), (0.0, radius)),
        quarter((-far, radius), (-radius, far), (-radius, 0.0)),
        quarter((-radius, -far), (-far, -radius), (0.0, -radius)),
        quarter((far, -radius), (radius, -far), (radius, 0.0)),
    ];
    ((x + radius, y), curves)
}

#[cfg(test)]
mod tests;
