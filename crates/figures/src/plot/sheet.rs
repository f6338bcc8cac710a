//! A sheet of panels, and what stands above and below them.

use super::axis::Axis;
use super::ramp::{Ramp, colour};
use super::{Frame, HEADING_PT, LABEL_PT, Panel, TICK_PT, fitting};
use crate::drawing::{Anchor, Colour, Drawing, Fill, MM_PER_INCH, POINTS_PER_INCH, Stroke, ascent, width};

/// The margin all around, and between panels.
const MARGIN: f64 = 5.0;
const BETWEEN: f64 = 9.0;
/// The height of a line of the legend, the width of its swatch, and the room behind an entry.
const LEGEND_LINE: f64 = 10.5;
const SWATCH: f64 = 14.0;
const BEHIND: f64 = 9.0;
/// A colour bar's height, and the room it takes with its numbers.
const BAR: f64 = 6.0;
const BAR_ROOM: f64 = BAR + TICK_PT + LABEL_PT + 12.0;
/// No panel is lower than this.
const LOWEST: f64 = 24.0;

/// From this width on panels stand side by side, millimetres.
const WIDE_MM: f64 = 120.0;

/// A figure's size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size {
    /// Its width, millimetres.
    pub width_mm: f64,
    /// Its height, millimetres; `None`: what suits it.
    pub height_mm: Option<f64>,
}

impl Default for Size {
    /// Two columns of a journal.
    fn default() -> Self {
        Self { width_mm: 180.0, height_mm: None }
    }
}

impl Size {
    /// Whether panels stand side by side.
    #[must_use]
    pub fn is_wide(&self) -> bool {
        self.width_mm >= WIDE_MM
    }

    /// Its width, points.
    #[must_use]
    pub fn width_pt(&self) -> f64 {
        self.width_mm / MM_PER_INCH * POINTS_PER_INCH
    }

    /// Its height, points.
    #[must_use]
    pub fn height_pt(&self) -> Option<f64> {
        self.height_mm.map(|mm| mm / MM_PER_INCH * POINTS_PER_INCH)
    }
}

/// A figure.
#[derive(Clone, Debug, Default)]
pub struct Sheet {
    pub width_pt: f64,
    /// Where it is stated: panels share what room there is.
    pub height_pt: Option<f64>,
    /// Panels side by side.
    pub columns: usize,
    pub title: String,
    pub panels: Vec<Panel>,
    pub legend: Vec<Entry>,
    pub bars: Vec<Bar>,
    /// What is to be said of it, below.
    pub notes: Vec<String>,
}

/// A line of a legend.
#[derive(Clone, Debug)]
pub struct Entry {
    pub words: String,
    pub swatch: Swatch,
}

/// What stands beside the words of a legend.
#[derive(Clone, Debug)]
pub enum Swatch {
    Line(Stroke),
    Block(Fill),
    Dot(Colour),
    /// It goes on with the one before.
    None,
}

/// A colour bar.
#[derive(Clone, Debug)]
pub struct Bar {
    pub ramp: Ramp,
    pub axis: Axis,
}

impl Bar {
    /// The colour of a number.
    pub fn colour(&self, value: f64) -> Colour {
        colour(self.ramp, self.axis.place(value))
    }
}

impl Sheet {
    /// As a drawing.
    ///
    /// # Errors
    /// What is wrong, in words, if its height is too little for what is on it.
    pub fn drawing(&self) -> Result<Drawing, String> {
        let columns = self.columns.clamp(1, self.panels.len().max(1));
        let rows = self.rows(columns);
        let room = self.width_pt - 2.0 * MARGIN;
        let heading = wrapped(&self.title, room, HEADING_PT);
        let notes: Vec<String> = self.notes.iter().flat_map(|note| wrapped(note, room, TICK_PT)).collect();
        let entries: Vec<Entry> = self.legend.iter().flat_map(|entry| entry.broken(room)).collect();
        let legend = legend_lines(&entries, room);
        let top = MARGIN + heading.len() as f64 * (HEADING_PT + 2.5);
        let bars = bars_room(&self.bars, room);
        let bottom = MARGIN + legend.len() as f64 * LEGEND_LINE + bars + notes.len() as f64 * (TICK_PT + 2.0);

        // Axes of one column begin below each other; how much is left of them depends on how high they are, and that on how wide.
        let lefts = |height: f64| -> Vec<f64> {
            let of = |column: usize| rows.iter().filter_map(move |row| row.get(column)).map(|panel| panel.left(height));
            (0..columns).map(|column| of(column).fold(0.0, f64::max)).collect()
        };
        let guess = lefts(80.0);
        let wide = (room - guess.iter().sum::<f64>() - BETWEEN * columns as f64) / columns as f64;
        let around = |row: &[&Panel]| {
            let most = |of: fn(&Panel) -> f64| row.iter().map(|panel| of(panel)).fold(0.0, f64::max);
            (most(Panel::above), most(Panel::below))
        };
        let fixed: f64 = rows.iter().map(|row| around(row)).map(|(above, below)| above + below + 3.0).sum();
        let mut heights: Vec<f64> =
            rows.iter().map(|row| wide * row.iter().map(|panel| panel.aspect).fold(0.0, f64::max)).collect();
        if let Some(height) = self.height_pt {
            let left = height - top - bottom - fixed;
            let all: f64 = heights.iter().sum();
            heights.iter_mut().for_each(|of| *of *= left / all);
            if left <= 0.0 || heights.iter().any(|of| *of < LOWEST) {
                let least = top + bottom + fixed + LOWEST * heights.len() as f64;
                let mm = (least / POINTS_PER_INCH * MM_PER_INCH).ceil();
                return Err(format!("it needs a height of {mm} mm at least"));
            }
        }
        if wide < LOWEST {
            return Err("it is too narrow for what is on it".to_owned());
        }
        let height = self.height_pt.unwrap_or_else(|| top + bottom + fixed + heights.iter().sum::<f64>());
        let mut drawing = Drawing::new(self.width_pt, height);
        for (line, words) in heading.iter().enumerate() {
            let y = MARGIN + ascent(HEADING_PT) + line as f64 * (HEADING_PT + 2.5);
            drawing.text((self.width_pt / 2.0, y), words, HEADING_PT, Anchor::Middle);
        }
        let mut y = top;
        for (row, high) in rows.iter().zip(&heights) {
            let (above, below) = around(row);
            let mut x = MARGIN;
            for (column, panel) in row.iter().enumerate() {
                x += guess[column];
                let wide = if panel.spans { room - guess[0] - BETWEEN } else { wide };
                panel.draw(&mut drawing, Frame { left: x, top: y + above, width: wide, height: *high });
                x += wide + BETWEEN;
            }
            y += above + high + below + 3.0;
        }
        draw_bars(&mut drawing, &self.bars, y, room);
        y += bars;
        for line in &legend {
            let all: f64 = line.iter().map(|entry| wide_of(entry)).sum::<f64>() - BEHIND;
            let mut x = MARGIN + (room - all).max(0.0) / 2.0;
            for entry in line {
                entry.draw(&mut drawing, (x, y + LEGEND_LINE / 2.0), room);
                x += wide_of(entry);
            }
            y += LEGEND_LINE;
        }
        for note in &notes {
            y += TICK_PT + 2.0;
            drawing.text((MARGIN, y - 1.0), note, TICK_PT, Anchor::Start);
        }
        Ok(drawing)
    }

    /// The panels, row by row.
    fn rows(&self, columns: usize) -> Vec<Vec<&Panel>> {
        let mut rows: Vec<Vec<&Panel>> = Vec::new();
        for panel in &self.panels {
            match rows.last_mut() {
                Some(row) if !panel.spans && row.len() < columns && !row[0].spans => row.push(panel),
                _ => rows.push(vec![panel]),
            }
        }
        rows
    }
}

fn legend_lines(entries: &[Entry], room: f64) -> Vec<Vec<&Entry>> {
    let mut lines: Vec<Vec<&Entry>> = Vec::new();
    let mut used = f64::INFINITY;
    for entry in entries {
        let wide = wide_of(entry);
        if used + wide - BEHIND > room {
            lines.push(Vec::new());
            used = 0.0;
        }
        used += wide;
        lines.last_mut().expect("there is one").push(entry);
    }
    lines
}

/// So many colour bars stand side by side that their labels have room.
fn bars_a_row(bars: &[Bar], room: f64) -> usize {
    let fits = |count: &usize| bars.iter().all(|bar| width(&bar.axis.label, LABEL_PT) + 6.0 <= room / *count as f64);
    (1..=bars.len()).rev().find(fits).unwrap_or(1)
}

/// How high colour bars are, with their numbers and labels.
pub fn bars_room(bars: &[Bar], room: f64) -> f64 {
    if bars.is_empty() { 0.0 } else { bars.len().div_ceil(bars_a_row(bars, room)) as f64 * BAR_ROOM }
}

/// Draws colour bars, side by side where there is room; they take [`bars_room`].
pub fn draw_bars(drawing: &mut Drawing, bars: &[Bar], y: f64, room: f64) {
    if bars.is_empty() {
        return;
    }
    for (row, bars) in bars.chunks(bars_a_row(bars, room)).enumerate() {
        draw_row_of_bars(drawing, bars, y + row as f64 * BAR_ROOM, room);
    }
}

fn draw_row_of_bars(drawing: &mut Drawing, bars: &[Bar], y: f64, room: f64) {
    const PARTS: usize = 64;
    let each = room / bars.len() as f64;
    for (place, bar) in bars.iter().enumerate() {
        let wide = (each * 0.82).min(230.0);
        let left = MARGIN + each * (place as f64 + 0.5) - wide / 2.0;
        for part in 0..PARTS {
            let share = (part as f64 + 0.5) / PARTS as f64;
            let (from, step) = (left + wide * part as f64 / PARTS as f64, wide / PARTS as f64);
            // They overlap a little, so that no seam is seen.
            let step = if part + 1 < PARTS { step + 0.3 } else { step };
            drawing.rectangle((from, y + 2.0), (step, BAR), Fill::new(colour(bar.ramp, share), 1.0));
        }
        drawing.frame((left, y + 2.0), (wide, BAR), Stroke::new([90; 3], 0.4));
        for (value, words) in bar.axis.ticks(wide, true) {
            let x = left + bar.axis.place(value) * wide;
            drawing.line(vec![(x, y + 2.0 + BAR), (x, y + 4.0 + BAR)], Stroke::new([90; 3], 0.5));
            drawing.text((x, y + BAR + 6.0 + ascent(TICK_PT)), words, TICK_PT, Anchor::Middle);
        }
        let words = fitting(&bar.axis.label, each, LABEL_PT);
        drawing.text((left + wide / 2.0, y + BAR + TICK_PT + LABEL_PT + 6.0), words, LABEL_PT, Anchor::Middle);
    }
}

fn wide_of(entry: &Entry) -> f64 {
    SWATCH + 3.0 + width(&entry.words, LABEL_PT) + BEHIND
}

impl Entry {
    pub fn new(words: impl Into<String>, swatch: Swatch) -> Self {
        Self { words: words.into(), swatch }
    }

    /// In lines that have room, the swatch beside the first.
    fn broken(&self, room: f64) -> Vec<Self> {
        let lines = broken(&self.words, room - SWATCH - 3.0, LABEL_PT);
        let entry =
            |(place, words)| Self { words, swatch: if place == 0 { self.swatch.clone() } else { Swatch::None } };
        lines.into_iter().enumerate().map(entry).collect()
    }

    fn draw(&self, drawing: &mut Drawing, (x, y): (f64, f64), room: f64) {
        match &self.swatch {
            Swatch::Line(stroke) => drawing.line(vec![(x, y), (x + SWATCH, y)], stroke.clone()),
            Swatch::None => {}
            Swatch::Block(fill) => drawing.rectangle((x, y - 3.0), (SWATCH, 6.0), *fill),
            Swatch::Dot(colour) => {
                let fill = Fill::new(*colour, 1.0);
                drawing.marks.push(crate::drawing::Mark::Dot { at: (x + SWATCH / 2.0, y), radius: 2.2, fill });
            }
        }
        let words = fitting(&self.words, room - SWATCH - 3.0, LABEL_PT);
        drawing.text((x + SWATCH + 3.0, y + ascent(LABEL_PT) / 2.0), words, LABEL_PT, Anchor::Start);
    }
}

/// Words in lines that have room, broken at spaces and behind what joins the parts of a name.
fn broken(words: &str, room: f64, size: f64) -> Vec<String> {
    let mut lines: Vec<String> = vec![String::new()];
    for part in words.split_inclusive([' ', '/', '+', ',', ':', '_']) {
        let last = lines.last_mut().expect("there is one");
        if last.is_empty() || width(&format!("{last}{}", part.trim_end()), size) <= room {
            last.push_str(part);
        } else {
            lines.push(part.to_owned());
        }
    }
    lines.iter().map(|line| fitting(line.trim_end(), room, size)).collect()
}

/// Words in lines that fit.
pub(super) fn wrapped(words: &str, room: f64, size: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in words.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(&format!("{line} {word}"), size) <= room => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines.iter().map(|line| fitting(line, room, size)).collect()
}
