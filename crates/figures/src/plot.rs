//! What figures are put together from: panels with axes on a sheet of a stated width, a legend and colour bars below them.
//!
//! Sizes are points: words and lines are as large on paper as they are here, whatever the figure's width.

mod axis;
mod ramp;
mod sheet;

pub use axis::{Axis, Scale, ticks_at};
pub use ramp::{DIVERGING, SEQUENTIAL};
pub use sheet::{Bar, Entry, Sheet, Size, Swatch, bars_room, draw_bars};

use crate::drawing::{Anchor, Colour, Drawing, Fill, Mark, Stroke, Text, WHITE, ascent, width};

/// Sizes of words, points.
pub const TICK_PT: f64 = 6.5;
pub const LABEL_PT: f64 = 7.5;
pub const TITLE_PT: f64 = 8.0;
pub const HEADING_PT: f64 = 9.0;

const GRID: Colour = [228; 3];
const EDGE: Colour = [70; 3];

/// A plot with its axes.
#[derive(Clone, Debug)]
pub struct Panel {
    pub title: Option<String>,
    pub x: Axis,
    pub y: Axis,
    pub items: Vec<Item>,
    /// How high it is, as a share of the width of a column.
    pub aspect: f64,
    /// Whether it takes a whole row.
    pub spans: bool,
}

/// One thing on a panel, in the units of its axes.
#[derive(Clone, Debug)]
pub enum Item {
    /// What lies between two curves: x, lower, upper.
    Band { points: Vec<(f64, f64, f64)>, fill: Fill },
    /// A curve.
    Line { points: Vec<(f64, f64)>, stroke: Stroke },
    /// Bars that stand on zero: from, to, how high.
    Bars { bars: Vec<(f64, f64, f64)>, fill: Fill },
    /// Dots of so many points' radius.
    Dots { points: Vec<(f64, f64)>, radius: f64, fill: Fill },
    /// A line from bottom to top.
    Upright { x: f64, stroke: Stroke },
    /// A line from left to right.
    Level { y: f64, stroke: Stroke },
    /// A rectangle from bottom to top.
    Stripe { from: f64, to: f64, fill: Fill },
    /// A filled rectangle: from and to, of x and of y; words in it, if they have room.
    Cell { x: (f64, f64), y: (f64, f64), fill: Fill, words: String },
    /// Words; `up` points above their place.
    Words { at: (f64, f64), up: f64, words: String, anchor: Anchor, colour: Colour },
}

/// Where a panel's axes are on the page, points.
#[derive(Clone, Copy, Debug)]
struct Frame {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
}

impl Panel {
    pub fn new(x: Axis, y: Axis) -> Self {
        Self { title: None, x, y, items: Vec::new(), aspect: 0.62, spans: false }
    }

    /// How much it needs on the left of its axes: the y axis' numbers and label.
    fn left(&self, height: f64) -> f64 {
        let numbers = self.y.ticks(height, false).iter().map(|(_, words)| width(words, TICK_PT)).fold(0.0, f64::max);
        let label = if self.y.label.is_empty() { 0.0 } else { LABEL_PT + 4.0 };
        numbers + label + 4.0
    }

    /// How much it needs above.
    fn above(&self) -> f64 {
        if self.title.is_some() { TITLE_PT + 5.0 } else { 4.0 }
    }

    /// And below.
    fn below(&self) -> f64 {
        let label = if self.x.label.is_empty() { 0.0 } else { LABEL_PT + 4.0 };
        TICK_PT + 5.0 + label
    }

    fn draw(&self, drawing: &mut Drawing, frame: Frame) {
        let Frame { left, top, width: wide, height } = frame;
        let (right, bottom) = (left + wide, top + height);
        let across = |x: f64| left + self.x.place(x) * wide;
        let down = |y: f64| bottom - self.y.place(y) * height;
        let (x_ticks, y_ticks) = (self.x.ticks(wide, true), self.y.ticks(height, false));
        let grid = || Stroke::new(GRID, 0.4);
        if self.x.has_grid {
            for (x, _) in &x_ticks {
                drawing.line(vec![(across(*x), top), (across(*x), bottom)], grid());
            }
        }
        if self.y.has_grid {
            for (y, _) in &y_ticks {
                drawing.line(vec![(left, down(*y)), (right, down(*y))], grid());
            }
        }
        drawing.marks.push(Mark::Clip { at: (left, top), size: (wide, height) });
        for item in &self.items {
            let at = |(x, y): &(f64, f64)| (across(*x), down(*y));
            match item {
                Item::Band { points, fill } => {
                    let upper = points.iter().map(|(x, _, high)| (across(*x), down(*high)));
                    let lower = points.iter().rev().map(|(x, low, _)| (across(*x), down(*low)));
                    drawing.area(upper.chain(lower).collect(), *fill);
                }
                Item::Line { points, stroke } => {
                    drawing.line(points.iter().map(at).collect(), stroke.clone());
                }
                Item::Bars { bars, fill } => {
                    for (from, to, high) in bars.iter().filter(|(.., high)| *high > 0.0) {
                        let (from, to, top) = (across(*from), across(*to), down(*high));
                        drawing.rectangle((from, top), (to - from, bottom - top), *fill);
                    }
                }
                Item::Dots { points, radius, fill } => {
                    let dots = points.iter().map(|point| Mark::Dot { at: at(point), radius: *radius, fill: *fill });
                    drawing.marks.extend(dots);
                }
                Item::Upright { x, stroke } => {
                    drawing.line(vec![(across(*x), top), (across(*x), bottom)], stroke.clone());
                }
                Item::Level { y, stroke } => drawing.line(vec![(left, down(*y)), (right, down(*y))], stroke.clone()),
                Item::Stripe { from, to, fill } => {
                    drawing.rectangle((across(*from), top), (across(*to) - across(*from), height), *fill);
                }
                Item::Cell { x, y, fill, words } => {
                    let (from, to) = ((across(x.0), down(y.1)), (across(x.1), down(y.0)));
                    let size = (to.0 - from.0, to.1 - from.1);
                    drawing.rectangle(from, size, *fill);
                    if width(words, TICK_PT) + 2.0 < size.0 && TICK_PT + 1.0 < size.1 {
                        drawing.marks.push(Mark::Text(Text {
                            at: (from.0 + size.0 / 2.0, from.1 + size.1 / 2.0 + ascent(TICK_PT) / 2.0),
                            words: words.clone(),
                            size: TICK_PT,
                            colour: readable_on(fill.colour),
                            anchor: Anchor::Middle,
                            upwards: false,
                        }));
                    }
                }
                Item::Words { .. } => {}
            }
        }
        drawing.marks.push(Mark::Unclip);
        self.write(drawing, frame, &x_ticks, &y_ticks);
        for item in &self.items {
            if let Item::Words { at, up, words, anchor, colour } = item {
                // Inside the axes, however far to a side its place is.
                let half = width(words, TICK_PT) * if *anchor == Anchor::Middle { 0.5 } else { 1.0 };
                let before = if *anchor == Anchor::Start { 0.0 } else { half };
                let behind = if *anchor == Anchor::End { 0.0 } else { half };
                let x = across(at.0).min(right - behind - 1.0).max(left + before + 1.0);
                let y = (down(at.1) - up).clamp(top + TICK_PT, bottom - 2.0);
                let (words, colour, anchor) = (words.clone(), *colour, *anchor);
                let text = Text { at: (x, y), words, size: TICK_PT, colour, anchor, upwards: false };
                drawing.marks.push(Mark::Text(text));
            }
        }
    }

    /// The axes and what is written at them.
    fn write(&self, drawing: &mut Drawing, frame: Frame, x_ticks: &[(f64, String)], y_ticks: &[(f64, String)]) {
        let Frame { left, top, width: wide, height } = frame;
        let (right, bottom) = (left + wide, top + height);
        drawing.line(vec![(left, top), (left, bottom), (right, bottom)], Stroke::new(EDGE, 0.6));
        for (x, words) in x_ticks {
            let x = left + self.x.place(*x) * wide;
            drawing.line(vec![(x, bottom), (x, bottom + 2.0)], Stroke::new(EDGE, 0.6));
            drawing.text((x, bottom + 3.0 + ascent(TICK_PT) + 1.0), words, TICK_PT, Anchor::Middle);
        }
        for (y, words) in y_ticks {
            let y = bottom - self.y.place(*y) * height;
            drawing.line(vec![(left - 2.0, y), (left, y)], Stroke::new(EDGE, 0.6));
            drawing.text((left - 3.5, y + ascent(TICK_PT) / 2.0), words, TICK_PT, Anchor::End);
        }
        if let Some(title) = &self.title {
            drawing.text(
                (left + wide / 2.0, top - 4.0),
                fitting(title, wide + 10.0, TITLE_PT),
                TITLE_PT,
                Anchor::Middle,
            );
        }
        if !self.x.label.is_empty() {
            let y = bottom + TICK_PT + 5.0 + LABEL_PT;
            drawing.text((left + wide / 2.0, y), &self.x.label, LABEL_PT, Anchor::Middle);
        }
        if !self.y.label.is_empty() {
            drawing.marks.push(Mark::Text(Text {
                at: (left - self.left(height) + LABEL_PT, top + height / 2.0),
                words: fitting(&self.y.label, height + 24.0, LABEL_PT),
                size: LABEL_PT,
                colour: crate::drawing::BLACK,
                anchor: Anchor::Middle,
                upwards: true,
            }));
        }
    }
}

/// Black or white, whichever can be read on a colour.
pub fn readable_on([red, green, blue]: Colour) -> Colour {
    let light = 0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue);
    if light < 130.0 { WHITE } else { crate::drawing::BLACK }
}

/// As much of some words as has room, with a mark where something is left out.
pub fn fitting(words: &str, room: f64, size: f64) -> String {
    if width(words, size) <= room {
        return words.to_owned();
    }
    let mut some: Vec<char> = words.chars().collect();
    while some.len() > 1 && width(&some.iter().collect::<String>(), size) + width("…", size) > room {
        some.pop();
    }
    some.into_iter().chain(['…']).collect()
}
