//! How errors spread along something: the paper's figure of the absolute error against the true distance, and the same against anything else.
//!
//! The solid line is the median, the darker band goes from 25 to 75 %, the lighter one from 5 to 95 %. Where there are more than two estimators the
//! lighter band is left out of all but stereo and mono, whose errors it would hide.
//!
//! A bin of few pixels says little: it is drawn faint and dotted, and sets no axis, so that ten pixels do not squeeze all others.

use std::collections::BTreeMap;

use crate::colours::colour as colour_of;
use crate::drawing::{Anchor, Colour, Drawing, Fill, Stroke, colour};
use crate::places::{Layout, Place, dashes, panels, shade};
use crate::plot::{Axis, Entry, Item, Panel, Scale, Sheet, Size, Swatch};

/// How opaque the bands from 5 to 95 % and from 25 to 75 % are, and what is faint.
const WIDE_OPACITY: f64 = 0.14;
const NARROW_OPACITY: f64 = 0.30;
const FAINT: f64 = 0.45;
/// The bars of all pixels, and of those that are compared.
const TRUE_COLOUR: Colour = [0xcd, 0xd3, 0xdc];
const COMPARED_COLOUR: Colour = [0x8d, 0x99, 0xae];
/// An estimator that answered more than this share beyond what is compared has a dashed line, too.
const MORE: f64 = 0.01;
const MORE_DASHES: &[f64] = &[4.0, 2.5];
/// The line of a bin of few pixels.
const THIN_DASHES: &[f64] = &[0.8, 1.6];
const LINE_PT: f64 = 1.2;
/// How much higher than the highest median the axis goes at least, and how much higher than usual a band may reach before it is cut.
const MEDIAN_ROOM: f64 = 1.15;
const WORTH_SHOWING: f64 = 1.3;

/// How errors spread in a bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    pub from: f64,
    pub to: f64,
    pub count: u64,
    /// 5, 25, 50, 75 and 95 %.
    pub percentiles: [f64; 5],
}

/// An estimator's errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    pub of: Place,
    /// Over the pixels that are compared.
    pub bins: Vec<Bin>,
    /// Over all that it answered; empty where that is not asked for.
    pub answered: Vec<Bin>,
}

/// The figure.
#[derive(Clone, Debug)]
pub struct SpreadFigure {
    pub spreads: Vec<Spread>,
    /// Pixels with a truth by bin: from, to, how many. Empty: they are not shown.
    pub truth: Vec<(f64, f64, u64)>,
    /// And those that are compared.
    pub compared: Vec<(f64, f64, u64)>,
    pub layout: Layout,
    pub title: String,
    pub x_label: String,
    pub y_label: String,
    pub x_scale: Scale,
    /// A bin of fewer pixels is thin.
    pub thin: u64,
    /// The top of the error's axis, where that is stated.
    pub most: Option<f64>,
    pub size: Size,
}

impl SpreadFigure {
    /// As a drawing.
    ///
    /// # Errors
    /// What is wrong with its size, in words.
    pub fn drawing(&self) -> Result<Drawing, String> {
        let names = self.names();
        let groups = self.groups();
        let columns = if self.size.is_wide() { groups.len().clamp(1, 2) } else { 1 };
        let (near, far) = self.reach();
        let high = self.most.unwrap_or_else(|| self.high());
        let rows = groups.len().div_ceil(columns);
        let bars_fill_a_gap = rows * columns > groups.len();
        let mut panels: Vec<Panel> = Vec::new();
        for (place, (title, spreads)) in groups.iter().enumerate() {
            let mut x = self.x_axis(near, far);
            if (place + columns < groups.len()) || !self.truth.is_empty() && !bars_fill_a_gap {
                x.label = String::new();
            }
            let y_label = if place % columns == 0 { self.y_label.as_str() } else { "" };
            let mut panel = Panel::new(x, Axis::new(0.0, high, y_label));
            panel.title.clone_from(title);
            panel.items = self.items(spreads, &names, high);
            panel.aspect = if columns == 1 && self.size.is_wide() { 0.5 } else { 0.62 };
            panels.push(panel);
        }
        if !self.truth.is_empty() {
            panels.push(self.bars(near, far, bars_fill_a_gap, columns));
        }
        let sheet = Sheet {
            width_pt: self.size.width_pt(),
            height_pt: self.size.height_pt(),
            columns,
            title: self.title.clone(),
            panels,
            legend: self.legend(&names),
            ..Sheet::default()
        };
        sheet.drawing()
    }

    /// How many panels there are.
    pub fn panels(&self) -> usize {
        self.groups().len()
    }

    /// Names as they first come: they choose the colours.
    fn names(&self) -> Vec<&str> {
        let mut names = Vec::new();
        for spread in &self.spreads {
            if !spread.bins.is_empty() && !names.contains(&spread.of.name.as_str()) {
                names.push(&spread.of.name);
            }
        }
        names
    }

    /// By panel its title and what is on it.
    fn groups(&self) -> Vec<(Option<String>, Vec<&Spread>)> {
        let drawn: Vec<&Spread> = self.spreads.iter().filter(|spread| !spread.bins.is_empty()).collect();
        let places: Vec<&Place> = drawn.iter().map(|spread| &spread.of).collect();
        let groups = panels(&places, self.layout).into_iter();
        groups.map(|(title, of)| (title, of.into_iter().map(|at| drawn[at]).collect())).collect()
    }

    /// From where to where bins go; thin ones at either end count, too: they have a place, and little ink.
    fn reach(&self) -> (f64, f64) {
        let bins = || self.spreads.iter().flat_map(|spread| spread.bins.iter().chain(&spread.answered));
        let low = bins().map(|bin| bin.from).chain(self.truth.iter().map(|of| of.0)).fold(f64::INFINITY, f64::min);
        let high = bins().map(|bin| bin.to).chain(self.truth.iter().map(|of| of.1)).fold(f64::NEG_INFINITY, f64::max);
        match (low.is_finite(), self.x_scale) {
            (false, _) => (0.0, 80.0),
            (true, Scale::Linear) if low > 0.0 && low < 0.5 * high => (0.0, high),
            _ => (low, high),
        }
    }

    fn x_axis(&self, near: f64, far: f64) -> Axis {
        Axis { scale: self.x_scale, ..Axis::new(near, far, self.x_label.clone()) }
    }

    /// The top of the error's axis. Bins that are thin do not count, unless all are. The medians have room, and nine tenths of what reaches highest in a
    /// bin; what few bins reach beyond is cut, and said, where it would squeeze the rest.
    fn high(&self) -> f64 {
        let reached = |thin: u64| -> (Vec<f64>, f64) {
            let (mut ends, mut median) = (Vec::new(), 0.0_f64);
            for (_, spreads) in self.groups() {
                for spread in &spreads {
                    let highest = if has_wide(spread, &spreads) { 4 } else { 3 };
                    for bin in spread.bins.iter().filter(|bin| bin.count >= thin) {
                        ends.push(bin.percentiles[highest]);
                        median = median.max(bin.percentiles[2]);
                    }
                    let more = spread.answered.iter().filter(|bin| bin.count >= thin && answered_more(spread));
                    median = more.map(|bin| bin.percentiles[2]).fold(median, f64::max);
                }
            }
            ends.sort_by(f64::total_cmp);
            (ends, median)
        };
        let (mut ends, mut median) = reached(self.thin);
        if ends.is_empty() {
            (ends, median) = reached(0);
        }
        let most = ends.last().copied().unwrap_or(0.0).max(median);
        let usual = ends.get((ends.len() * 9 / 10).min(ends.len().saturating_sub(1))).copied().unwrap_or(0.0);
        let high = usual.max(MEDIAN_ROOM * median);
        let high = if most <= WORTH_SHOWING * high { most } else { high };
        high.max(1e-9) * 1.03
    }

    /// The wide bands of all, then the narrow ones, then the lines: no band hides a line.
    fn items(&self, spreads: &[&Spread], names: &[&str], high: f64) -> Vec<Item> {
        let tint = |spread: &Spread| colour(colour_of(names, &spread.of.name));
        let shaded = |spread: &Spread| self.shaded(spread, tint(spread));
        let mut items = Vec::new();
        for spread in spreads.iter().filter(|spread| has_wide(spread, spreads)) {
            self.bands(&mut items, spread, tint(spread), (0, 4), WIDE_OPACITY);
        }
        for spread in spreads {
            self.bands(&mut items, spread, tint(spread), (1, 3), NARROW_OPACITY);
        }
        for spread in spreads {
            let dashes = self.dashes(spread);
            if answered_more(spread) {
                let stroke = Stroke::new(tint(spread), 0.8).dashed(MORE_DASHES);
                self.line(&mut items, &spread.answered, &stroke);
            }
            self.line(&mut items, &spread.bins, &Stroke::new(shaded(spread), LINE_PT).dashed(dashes));
        }
        // Where a band is cut, how far it goes; several below each other, for they may stand at one place.
        let mut cut = 0.0;
        for spread in spreads.iter().filter(|spread| has_wide(spread, spreads)) {
            let thick = spread.bins.iter().filter(|bin| !self.is_thin(bin));
            let farthest = thick.max_by(|one, two| one.percentiles[4].total_cmp(&two.percentiles[4]));
            if let Some(bin) = farthest.filter(|bin| bin.percentiles[4] > high) {
                let words = format!("↑ {:.*}", usize::from(high < 5.0), bin.percentiles[4]);
                let at = (self.middle(bin), high);
                items.push(Item::Words {
                    at,
                    up: -8.0 * (1.0 + cut),
                    words,
                    anchor: Anchor::Start,
                    colour: tint(spread),
                });
                cut += 1.0;
            }
        }
        items
    }

    /// Of several variants on one panel, each has its dashes.
    fn dashes(&self, spread: &Spread) -> &'static [f64] {
        match self.layout {
            Layout::Multiples => &[],
            Layout::Overlaid => dashes(self.spreads.iter().map(|spread| &spread.of), &spread.of),
        }
    }

    /// And its shade.
    fn shaded(&self, spread: &Spread, tint: Colour) -> Colour {
        match self.layout {
            Layout::Multiples => tint,
            Layout::Overlaid => shade(self.spreads.iter().map(|spread| &spread.of), &spread.of, tint),
        }
    }

    /// Whether any bin is thin.
    pub fn has_thin(&self) -> bool {
        self.spreads.iter().any(|spread| spread.bins.iter().any(|bin| self.is_thin(bin)))
    }

    fn is_thin(&self, bin: &Bin) -> bool {
        bin.count < self.thin
    }

    fn bands(&self, items: &mut Vec<Item>, spread: &Spread, tint: Colour, (low, high): (usize, usize), opacity: f64) {
        for piece in self.pieces(&spread.bins) {
            let opacity = if piece.is_thin { opacity * FAINT } else { opacity };
            let point = |bin: &Bin| (self.middle(bin), bin.percentiles[low], bin.percentiles[high]);
            items.push(Item::Band { points: piece.bins.iter().map(point).collect(), fill: Fill::new(tint, opacity) });
        }
    }

    fn line(&self, items: &mut Vec<Item>, bins: &[Bin], stroke: &Stroke) {
        for piece in self.pieces(bins) {
            let points: Vec<(f64, f64)> = piece.bins.iter().map(|bin| (self.middle(bin), bin.percentiles[2])).collect();
            let stroke = match piece.is_thin {
                true => Stroke::new(stroke.colour, stroke.width * 0.7).faint(FAINT).dashed(THIN_DASHES),
                false => stroke.clone(),
            };
            match points[..] {
                [_] => {
                    let fill = Fill::new(stroke.colour, stroke.opacity);
                    items.push(Item::Dots { points, radius: stroke.width, fill });
                }
                _ => items.push(Item::Line { points, stroke }),
            }
        }
    }

    fn middle(&self, bin: &Bin) -> f64 {
        match self.x_scale {
            Scale::Linear => 0.5 * (bin.from + bin.to),
            Scale::Log => (bin.from * bin.to).sqrt(),
        }
    }

    /// Bins in stretches without a gap, and these where thin ones begin and end: a piece is thin where one of its two ends is.
    fn pieces<'a>(&self, bins: &'a [Bin]) -> Vec<Piece<'a>> {
        let mut pieces: Vec<Piece<'a>> = Vec::new();
        for stretch in bins.chunk_by(|one, next| next.from - one.to <= 1e-9 * next.from.abs().max(1.0)) {
            if let [only] = stretch {
                pieces.push(Piece { bins: stretch, is_thin: self.is_thin(only) });
                continue;
            }
            let mut start = 0;
            let step_is_thin = |at: usize| self.is_thin(&stretch[at]) || self.is_thin(&stretch[at + 1]);
            for at in 0..stretch.len() - 1 {
                if at + 2 == stretch.len() || step_is_thin(at) != step_is_thin(at + 1) {
                    pieces.push(Piece { bins: &stretch[start..at + 2], is_thin: step_is_thin(at) });
                    start = at + 1;
                }
            }
        }
        pieces
    }

    /// How many pixels are in each bin.
    fn bars(&self, near: f64, far: f64, fills_a_gap: bool, columns: usize) -> Panel {
        let most = self.truth.iter().chain(&self.compared).map(|(.., count)| *count).max().unwrap_or(0);
        let (unit, label) = if most >= 2000 { (1000.0, "pixels, thousands") } else { (1.0, "pixels") };
        let bars = |of: &[(f64, f64, u64)]| of.iter().map(|(from, to, n)| (*from, *to, *n as f64 / unit)).collect();
        let x = self.x_axis(near, far);
        let mut panel = Panel::new(x, Axis::new(0.0, (most as f64 / unit).max(1e-3) * 1.05, label));
        panel.items.push(Item::Bars { bars: bars(&self.truth), fill: Fill::new(TRUE_COLOUR, 1.0) });
        panel.items.push(Item::Bars { bars: bars(&self.compared), fill: Fill::new(COMPARED_COLOUR, 1.0) });
        match fills_a_gap {
            true => panel.title = Some("pixels".to_owned()),
            false => {
                panel.spans = true;
                panel.aspect = if columns == 1 && self.size.is_wide() { 0.2 } else { 0.3 };
            }
        }
        panel
    }

    fn legend(&self, names: &[&str]) -> Vec<Entry> {
        let mut entries: Vec<Entry> = Vec::new();
        let line = |name: &str| Stroke::new(colour(colour_of(names, name)), LINE_PT);
        if self.layout == Layout::Overlaid {
            for spread in self.spreads.iter().filter(|spread| !spread.bins.is_empty()) {
                let own = line(&spread.of.name);
                let stroke = Stroke { colour: self.shaded(spread, own.colour), ..own }.dashed(self.dashes(spread));
                entries.push(Entry::new(spread.of.label(), Swatch::Line(stroke)));
            }
        } else {
            entries.extend(names.iter().map(|name| Entry::new(format!("{name}, median"), Swatch::Line(line(name)))));
        }
        let grey = [0x5c; 3];
        if self.spreads.iter().any(answered_more) {
            let stroke = Stroke::new(grey, 0.8).dashed(MORE_DASHES);
            entries.push(Entry::new("median of all it answered", Swatch::Line(stroke)));
        }
        if self.has_thin() {
            let stroke = Stroke::new(grey, 0.85).faint(0.7).dashed(THIN_DASHES);
            entries.push(Entry::new(format!("fewer than {} pixels", self.thin), Swatch::Line(stroke)));
        }
        entries.push(Entry::new("25–75 %", Swatch::Block(Fill::new([0xa9; 3], 1.0))));
        if self.groups().iter().any(|(_, spreads)| spreads.iter().any(|spread| has_wide(spread, spreads))) {
            entries.push(Entry::new("5–95 %", Swatch::Block(Fill::new([0xdc; 3], 1.0))));
        }
        if !self.truth.is_empty() && !self.compared.is_empty() {
            entries.push(Entry::new("pixels compared", Swatch::Block(Fill::new(COMPARED_COLOUR, 1.0))));
            entries.push(Entry::new("true pixels", Swatch::Block(Fill::new(TRUE_COLOUR, 1.0))));
        }
        entries
    }
}

/// Consecutive bins that are drawn in one way.
struct Piece<'a> {
    bins: &'a [Bin],
    is_thin: bool,
}

/// Whether an estimator's lighter band is drawn among others.
fn has_wide(spread: &Spread, among: &[&Spread]) -> bool {
    among.len() <= 2 || ["stereo", "mono"].contains(&spread.of.name.as_str())
}

/// Whether an estimator answered more than what is compared.
fn answered_more(spread: &Spread) -> bool {
    let all = |bins: &[Bin]| bins.iter().map(|bin| bin.count).sum::<u64>() as f64;
    all(&spread.answered) > (1.0 + MORE) * all(&spread.bins)
}

/// By bin, how many pixels: bins of one place are added up.
pub fn added(counts: impl IntoIterator<Item = (f64, f64, u64)>) -> Vec<(f64, f64, u64)> {
    let mut by_place: BTreeMap<(u64, u64), (f64, f64, u64)> = BTreeMap::new();
    for (from, to, count) in counts {
        // Edges are the same numbers wherever they come from; below zero, bits are in another order, which bars do not mind.
        by_place.entry((from.to_bits(), to.to_bits())).or_insert((from, to, 0)).2 += count;
    }
    by_place.into_values().collect()
}

#[cfg(test)]
mod tests;
