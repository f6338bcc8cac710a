//! A sheet of panels, with a title above, and colour bars and a legend below.

use super::ramp::Bar;
use super::{Frame, LABEL_PT, Panel, TICK_PT, fitting};
use crate::drawing::{Anchor, Drawing, Fill, MM_PER_INCH, Mark, POINTS_PER_INCH, Stroke, ascent, width};

/// The margin all around, and between panels.
const MARGIN: f64 = 5.0;
const BETWEEN: f64 = 9.0;
const HEADING_PT: f64 = 9.0;
/// The height of a line of the legend, the width of its swatch, and the room after an entry.
const LEGEND_LINE: f64 = 10.5;
const SWATCH: f64 = 14.0;
const AFTER: f64 = 9.0;
/// The height of a colour bar, and with its numbers.
const BAR: f64 = 6.0;
const BAR_ROOM: f64 = BAR + TICK_PT + LABEL_PT + 12.0;
/// The smallest width and height of a panel.
const LOWEST: f64 = 24.0;
/// From this width on panels are side by side, millimetres.
const WIDE_MM: f64 = 120.0;

/// A figure's size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size {
    /// Its width, millimetres.
    pub width_mm: f64,
    /// Its height, millimetres; `None`: what suits it.
    pub height_mm: Option<f64>,
}

impl Size {
    /// Its width, points.
    pub fn width_pt(&self) -> f64 {
        self.width_mm / MM_PER_INCH * POINTS_PER_INCH
    }
}

impl Default for Size {
    /// Two columns of a journal.
    fn default() -> Self {
        Self { width_mm: 180.0, height_mm: None }
    }
}

/// A figure.
#[derive(Clone, Debug, Default)]
pub struct Sheet {
    /// Its size; panels share the height, where it is stated.
    pub size: Size,
    /// Panels side by side, at most; on a narrow sheet there is one.
    pub columns: usize,
    /// Words above it; empty: none.
    pub title: String,
    /// Its plots, row by row. Panels below and beside each other share equal labels.
    pub panels: Vec<Panel>,
    /// What its lines and areas are.
    pub legend: Vec<Entry>,
    /// What its colours are.
    pub bars: Vec<Bar>,
}

/// An entry of a legend.
#[derive(Clone, Debug)]
pub struct Entry {
    words: String,
    swatch: Swatch,
}

/// What is beside the words of a legend.
#[derive(Clone, Copy, Debug)]
pub enum Swatch {
    /// A line.
    Line(Stroke),
    /// An area.
    Block(Fill),
    /// A dot.
    Dot(Fill),
}

impl Sheet {
    /// As a drawing.
    ///
    /// # Errors
    /// If its size is too small for what is on it, in words.
    pub fn drawing(self) -> Result<Drawing, String> {
        let is_wide = self.size.width_mm >= WIDE_MM;
        let points = |mm: f64| mm / MM_PER_INCH * POINTS_PER_INCH;
        let page = points(self.size.width_mm);
        let all_bare = self.panels.iter().all(|panel| !panel.x.has_ticks() && !panel.y.has_ticks());
        let columns = if is_wide || all_bare { self.columns.clamp(1, self.panels.len().max(1)) } else { 1 };
        let between = if all_bare { 2.0 } else { BETWEEN };
        let rows = rows(self.panels, columns);
        let room = page - 2.0 * MARGIN;
        let heading = lines(&self.title, room, HEADING_PT);
        let legend = legend_lines(&self.legend, room);
        let per_row = bars_per_row(&self.bars, room);
        let top = MARGIN + heading.len() as f64 * (HEADING_PT + 2.5);
        let bottom = MARGIN + legend.len() as f64 * LEGEND_LINE + self.bars.len().div_ceil(per_row) as f64 * BAR_ROOM;

        // Axes of one column begin below each other; how much is left of them depends on how high they are, and that on
        // how wide.
        let column = |column: usize| rows.iter().filter_map(move |row| row.get(column));
        let lefts: Vec<f64> =
            (0..columns).map(|at| column(at).map(|panel| panel.left(80.0)).fold(0.0, f64::max)).collect();
        let wide = (room - lefts.iter().sum::<f64>() - between * columns as f64) / columns as f64;
        let most = |row: &[Panel], part: fn(&Panel) -> f64| row.iter().map(part).fold(0.0, f64::max);
        let around: Vec<(f64, f64)> =
            rows.iter().map(|row| (most(row, Panel::above), most(row, Panel::below) + 3.0)).collect();
        let fixed = top + bottom + around.iter().map(|(above, below)| above + below).sum::<f64>();
        let usual = if columns == 1 && is_wide { 0.5 } else { 0.62 };
        let aspect = |row: &[Panel]| row.iter().map(|panel| panel.aspect.unwrap_or(usual)).fold(0.0, f64::max);
        let mut heights: Vec<f64> = rows.iter().map(|row| wide * aspect(row)).collect();
        if let Some(height) = self.size.height_mm {
            let share = (points(height) - fixed) / heights.iter().sum::<f64>();
            heights.iter_mut().for_each(|height| *height *= share);
            if heights.iter().any(|height| *height < LOWEST) {
                let least = (fixed + LOWEST * heights.len() as f64) / POINTS_PER_INCH * MM_PER_INCH;
                return Err(format!("it needs a height of {} mm at least", least.ceil()));
            }
        }
        if wide < if all_bare { 10.0 } else { LOWEST } {
            return Err("it is too narrow for what is on it".to_owned());
        }
        let height_pt = self.size.height_mm.map_or(fixed + heights.iter().sum::<f64>(), points);
        let mut drawing = Drawing { width_pt: page, height_pt, marks: Vec::new() };
        for (line, words) in heading.iter().enumerate() {
            let y = MARGIN + ascent(HEADING_PT) + line as f64 * (HEADING_PT + 2.5);
            drawing.text((page / 2.0, y), words, HEADING_PT, Anchor::Middle);
        }
        let mut y = top;
        for ((row, height), (above, below)) in rows.iter().zip(&heights).zip(&around) {
            let mut x = MARGIN;
            for (panel, left) in row.iter().zip(&lefts) {
                let wide = if panel.spans { room - left - between } else { wide };
                panel.draw(&mut drawing, Frame { left: x + left, top: y + above, width: wide, height: *height });
                x += left + wide + between;
            }
            y += above + height + below;
        }
        for bars in self.bars.chunks(per_row) {
            let each = room / bars.len() as f64;
            let middles = (0..bars.len()).map(|place| MARGIN + each * (place as f64 + 0.5));
            bars.iter().zip(middles).for_each(|(bar, middle)| bar.draw(&mut drawing, (middle, y + 2.0), each));
            y += BAR_ROOM;
        }
        for line in &legend {
            let all = line.iter().map(|(.., wide)| wide).sum::<f64>() - AFTER;
            let mut x = MARGIN + (room - all).max(0.0) / 2.0;
            for (swatch, words, wide) in line {
                swatch.iter().for_each(|swatch| drawing.marks.push(swatch.mark(x, y + LEGEND_LINE / 2.0)));
                let base = y + LEGEND_LINE / 2.0 + ascent(LABEL_PT) / 2.0;
                drawing.text((x + SWATCH + 3.0, base), words, LABEL_PT, Anchor::Start);
                x += wide;
            }
            y += LEGEND_LINE;
        }
        Ok(drawing)
    }
}

/// Panels row by row, without the labels that the next one below or the first on the left has.
fn rows(panels: Vec<Panel>, columns: usize) -> Vec<Vec<Panel>> {
    let mut rows: Vec<Vec<Panel>> = Vec::new();
    for panel in panels {
        match rows.last_mut() {
            Some(row) if !panel.spans && row.len() < columns && !row[0].spans => row.push(panel),
            _ => rows.push(vec![panel]),
        }
    }
    for row in 0..rows.len() {
        for column in 0..rows[row].len() {
            let below = rows.get(row + 1).and_then(|next| next.get(if next[0].spans { 0 } else { column }));
            if below.is_some_and(|below| below.x.label == rows[row][column].x.label) {
                rows[row][column].x.label.clear();
            }
            if column > 0 && rows[row][0].y.label == rows[row][column].y.label {
                rows[row][column].y.label.clear();
            }
        }
    }
    rows
}

/// The lines of a legend: swatch, words and width of each part.
fn legend_lines(entries: &[Entry], room: f64) -> Vec<Vec<(Option<Swatch>, String, f64)>> {
    let (mut all, mut used) = (Vec::<Vec<_>>::new(), f64::INFINITY);
    for entry in entries {
        for (place, words) in lines(&entry.words, room - SWATCH - 3.0, LABEL_PT).into_iter().enumerate() {
            let wide = SWATCH + 3.0 + width(&words, LABEL_PT) + AFTER;
            if used + wide - AFTER > room {
                all.push(Vec::new());
                used = 0.0;
            }
            used += wide;
            all.last_mut().expect("there is one").push(((place == 0).then_some(entry.swatch), words, wide));
        }
    }
    all
}

/// How many colour bars fit side by side with their labels.
fn bars_per_row(bars: &[Bar], room: f64) -> usize {
    let fits = |count: &usize| bars.iter().all(|bar| width(&bar.axis.label, LABEL_PT) + 6.0 <= room / *count as f64);
    (1..=bars.len()).rev().find(fits).unwrap_or(1)
}

impl Bar {
    fn draw(&self, drawing: &mut Drawing, (middle, top): (f64, f64), room: f64) {
        const PARTS: usize = 64;
        let wide = (room * 0.82).min(230.0);
        let (left, bottom, step) = (middle - wide / 2.0, top + BAR, wide / PARTS as f64);
        for part in 0..PARTS {
            // They overlap a little, so that no seam is seen.
            let overlap = if part + 1 < PARTS { 0.3 } else { 0.0 };
            let fill = Fill::new(self.at((part as f64 + 0.5) / PARTS as f64), 1.0);
            drawing.rectangle((left + step * part as f64, top), (step + overlap, BAR), fill);
        }
        let (right, edge) = (left + wide, Stroke::new([90; 3], 0.4));
        drawing.line(vec![(left, top), (right, top), (right, bottom), (left, bottom), (left, top)], edge);
        for (value, words) in self.axis.ticks(wide, true) {
            let x = left + self.axis.place(value) * wide;
            drawing.line(vec![(x, bottom), (x, bottom + 2.0)], edge);
            drawing.text((x, bottom + 4.0 + ascent(TICK_PT)), words, TICK_PT, Anchor::Middle);
        }
        let (words, size) = fitting(&self.axis.label, room, LABEL_PT);
        drawing.text((middle, bottom + TICK_PT + LABEL_PT + 4.0), words, size, Anchor::Middle);
    }
}

impl Entry {
    /// Words beside a swatch.
    pub fn new(words: impl Into<String>, swatch: Swatch) -> Self {
        Self { words: words.into(), swatch }
    }
}

impl Swatch {
    fn mark(&self, x: f64, y: f64) -> Mark {
        match *self {
            Self::Line(stroke) => Mark::Line { points: vec![(x, y), (x + SWATCH, y)], stroke },
            Self::Block(fill) => {
                let (right, top, bottom) = (x + SWATCH, y - 3.0, y + 3.0);
                Mark::Area { points: vec![(x, top), (right, top), (right, bottom), (x, bottom)], fill }
            }
            Self::Dot(fill) => Mark::Dot { at: (x + SWATCH / 2.0, y), radius: 2.2, fill },
        }
    }
}

/// Words in lines that have room, broken at spaces and after what joins the parts of a name.
fn lines(words: &str, room: f64, size: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for part in words.split_inclusive([' ', '/', '+', ',', ':', '_']) {
        match lines.last_mut() {
            Some(line) if width(&format!("{line}{}", part.trim_end()), size) <= room => line.push_str(part),
            _ => lines.push(part.to_owned()),
        }
    }
    lines.iter().map(|line| fitting(line.trim_end(), room, size).0).collect()
}
