//! Panels with axes, and the items on them.
//!
//! Sizes are points: text and lines have these sizes on paper, whatever the figure's width.

mod axis;
mod ramp;
mod sheet;

pub use axis::{Axis, Scale};
pub use ramp::{Bar, DIVERGING, SEQUENTIAL};
pub use sheet::{Entry, Sheet, Size, Swatch};

use crate::drawing::{Anchor, At, BLACK, Colour, Drawing, Fill, Mark, Picture, Stroke, Text, WHITE, ascent, width};

/// Sizes of words, points.
const TICK_PT: f64 = 6.5;
const LABEL_PT: f64 = 7.5;
const TITLE_PT: f64 = 8.0;
const SMALLEST_PT: f64 = 5.0;

const GRID: Stroke = Stroke::new([228; 3], 0.4);
const EDGE: Stroke = Stroke::new([70; 3], 0.6);

/// A plot with its axes.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Words above it; empty: none.
    pub title: String,
    /// From left to right.
    pub x: Axis,
    /// From bottom to top.
    pub y: Axis,
    /// What is on it.
    pub items: Vec<Item>,
    /// Its height as a share of its width; `None`: the sheet decides.
    pub aspect: Option<f64>,
    pub(crate) spans: bool,
}

/// One thing on a panel, in the units of its axes. An infinite coordinate is the panel's edge.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// The area between points.
    Area(Vec<(f64, f64)>, Fill),
    /// A line through points.
    Line(Vec<(f64, f64)>, Stroke),
    /// Dots, with their radius in points.
    Dots(Vec<(f64, f64)>, f64, Fill),
    /// A filled rectangle: from and to of x and of y; words in it, if they have room.
    Cell((f64, f64), (f64, f64), Fill, String),
    /// Words a number of points above their place.
    Words((f64, f64), f64, String, Anchor, Colour),
    /// A picture that fills the panel.
    Picture(Picture),
}

impl Item {
    /// The area between two curves: x, lower and upper y.
    pub fn band(points: impl DoubleEndedIterator<Item = (f64, f64, f64)> + Clone, fill: Fill) -> Self {
        let upper = points.clone().map(|(x, _, high)| (x, high));
        Self::Area(upper.chain(points.rev().map(|(x, low, _)| (x, low))).collect(), fill)
    }

    /// A line through points; a point alone is a dot.
    pub fn curve(points: Vec<(f64, f64)>, stroke: Stroke) -> Self {
        match points[..] {
            [_] => Self::Dots(points, stroke.width, Fill::new(stroke.colour, stroke.opacity)),
            _ => Self::Line(points, stroke),
        }
    }

    /// A line from bottom to top.
    pub fn vertical(x: f64, stroke: Stroke) -> Self {
        Self::Line(vec![(x, f64::NEG_INFINITY), (x, f64::INFINITY)], stroke)
    }

    /// A line from left to right.
    pub fn horizontal(y: f64, stroke: Stroke) -> Self {
        Self::Line(vec![(f64::NEG_INFINITY, y), (f64::INFINITY, y)], stroke)
    }

    /// A filled rectangle without words.
    pub fn block(x: (f64, f64), y: (f64, f64), fill: Fill) -> Self {
        Self::Cell(x, y, fill, String::new())
    }
}

/// Where the axes of a panel are on the page.
#[derive(Clone, Copy)]
struct Frame {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
}

impl Panel {
    /// A panel without items.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self { title: title.into(), x, y, items: Vec::new(), aspect: None, spans: false }
    }

    /// The room that its y axis needs on the left.
    fn left(&self, height: f64) -> f64 {
        let numbers = self.y.ticks(height, false).iter().map(|(_, words)| width(words, TICK_PT)).fold(0.0, f64::max);
        numbers + self.y.label_room() + if self.y.has_ticks() { 4.0 } else { 0.0 }
    }

    fn above(&self) -> f64 {
        match self.title.is_empty() {
            true if self.y.has_ticks() => 4.0,
            true => 0.0,
            false => TITLE_PT + 5.0,
        }
    }

    fn below(&self) -> f64 {
        self.x.label_room() + if self.x.has_ticks() { TICK_PT + 5.0 } else { 0.0 }
    }

    fn draw(&self, drawing: &mut Drawing, frame: Frame) {
        let Frame { left, top, width: wide, height } = frame;
        let (right, bottom) = (left + wide, top + height);
        let across = |x: f64| left + self.x.place(x) * wide;
        let down = |y: f64| bottom - self.y.place(y) * height;
        let at = |(x, y): &(f64, f64)| (across(*x), down(*y));
        let (x_ticks, y_ticks) = (self.x.ticks(wide, true), self.y.ticks(height, false));
        for x in x_ticks.iter().filter(|_| self.x.has_grid).map(|(x, _)| across(*x)) {
            drawing.line(vec![(x, top), (x, bottom)], GRID);
        }
        for y in y_ticks.iter().filter(|_| self.y.has_grid).map(|(y, _)| down(*y)) {
            drawing.line(vec![(left, y), (right, y)], GRID);
        }
        let mut texts = Vec::new();
        drawing.marks.push(Mark::Clip { at: (left, top), size: (wide, height) });
        for item in &self.items {
            match item {
                Item::Area(points, fill) => {
                    drawing.marks.push(Mark::Area { points: points.iter().map(at).collect(), fill: *fill });
                }
                Item::Line(points, stroke) => drawing.line(points.iter().map(at).collect(), *stroke),
                Item::Dots(points, radius, fill) => {
                    let dots = points.iter().map(|point| Mark::Dot { at: at(point), radius: *radius, fill: *fill });
                    drawing.marks.extend(dots);
                }
                Item::Cell(x, y, fill, words) => {
                    let (from, to) = (at(&(x.0, y.1)), at(&(x.1, y.0)));
                    let size = (to.0 - from.0, to.1 - from.1);
                    drawing.rectangle(from, size, *fill);
                    if width(words, TICK_PT) + 2.0 < size.0 && TICK_PT + 1.0 < size.1 {
                        let at = (from.0 + size.0 / 2.0, from.1 + size.1 / 2.0 + ascent(TICK_PT) / 2.0);
                        texts.push(text(at, words, Anchor::Middle, readable_on(fill.colour)));
                    }
                }
                Item::Words(point, up, words, anchor, colour) => {
                    // Inside the axes, however far to a side its place is.
                    let (wide, (x, y)) = (width(words, TICK_PT), at(point));
                    let before = anchor.before() * wide;
                    let x = x.min(right - (wide - before) - 1.0).max(left + before + 1.0);
                    texts.push(text((x, (y - up).clamp(top + TICK_PT, bottom - 2.0)), words, *anchor, *colour));
                }
                Item::Picture(picture) => {
                    let picture = picture.clone();
                    drawing.marks.push(Mark::Picture { at: (left, top), size: (wide, height), picture });
                }
            }
        }
        drawing.marks.push(Mark::Unclip);
        drawing.marks.extend(texts);
        if self.x.has_ticks() || self.y.has_ticks() {
            drawing.line(vec![(left, top), (left, bottom), (right, bottom)], EDGE);
        } else {
            let edge = Stroke::new([150; 3], 0.3);
            drawing.line(vec![(left, top), (right, top), (right, bottom), (left, bottom), (left, top)], edge);
        }
        for (x, words) in x_ticks.iter().map(|(x, words)| (across(*x), words)) {
            drawing.line(vec![(x, bottom), (x, bottom + 2.0)], EDGE);
            drawing.text((x, bottom + 4.0 + ascent(TICK_PT)), words, TICK_PT, Anchor::Middle);
        }
        for (y, words) in y_ticks.iter().map(|(y, words)| (down(*y), words)) {
            drawing.line(vec![(left - 2.0, y), (left, y)], EDGE);
            drawing.text((left - 3.5, y + ascent(TICK_PT) / 2.0), words, TICK_PT, Anchor::End);
        }
        let middle = left + wide / 2.0;
        let (words, size) = fitting(&self.title, wide + 10.0, TITLE_PT);
        drawing.text((middle, top - 4.0), words, size, Anchor::Middle);
        let (words, size) = fitting(&self.x.label, wide + 24.0, LABEL_PT);
        drawing.text((middle, bottom + self.below() - 4.0), words, size, Anchor::Middle);
        let (words, size) = fitting(&self.y.label, height + if self.y.has_ticks() { 24.0 } else { 2.0 }, LABEL_PT);
        let at = (left - self.left(height) + LABEL_PT, top + height / 2.0);
        drawing.marks.push(Mark::Text(Text { at, words, size, colour: BLACK, anchor: Anchor::Middle, upwards: true }));
    }
}

fn text(at: At, words: &str, anchor: Anchor, colour: Colour) -> Mark {
    Mark::Text(Text { at, words: words.to_owned(), size: TICK_PT, colour, anchor, upwards: false })
}

/// Black or white, whichever can be read on a colour.
pub fn readable_on([red, green, blue]: Colour) -> Colour {
    let light = 0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue);
    if light < 130.0 { WHITE } else { BLACK }
}

/// Words that have room: smaller than `size` if need be, and without their middle if that is not enough.
fn fitting(words: &str, room: f64, size: f64) -> (String, f64) {
    let size = (size * room / width(words, size).max(1e-9)).clamp(SMALLEST_PT.min(size), size);
    let all: Vec<char> = words.chars().collect();
    let shortened = |kept: &usize| -> String {
        let end = &all[all.len() - kept / 2..];
        all[..kept.div_ceil(2)].iter().chain(&['…']).chain(end).collect()
    };
    if width(words, size) <= room + 1e-6 {
        return (words.to_owned(), size);
    }
    let fits = |kept: &usize| width(&shortened(kept), size) <= room;
    (shortened(&(1..all.len()).rev().find(fits).unwrap_or(1)), size)
}
