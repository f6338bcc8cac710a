//! How errors spread along something: the paper's figure of the absolute error against the ground-truth distance, and
//! the same against anything else.
//!
//! The solid line is the median, the darker band goes from 25 to 75 %, the lighter one from 5 to 95 %. Where there are
//! more than two estimates, only stereo and mono have the lighter band: others would be hidden.
//!
//! A bin of few pixels says little: it is drawn faint and dotted, and sets no axis, so that ten pixels do not squeeze
//! all others.

use crate::comparison::{Comparison, Layout, Place, distinct};
use crate::drawing::{Anchor, Colour, Fill, Stroke};
use crate::plot::{Axis, Entry, Item, Panel, Scale, Sheet, Swatch};

/// The opacities of the bands from 5 to 95 % and from 25 to 75 %, and the share that a bin of few pixels has of these.
const WIDE_OPACITY: f64 = 0.14;
const NARROW_OPACITY: f64 = 0.30;
const FAINT: f64 = 0.45;
/// The bars of all pixels, and of those that are compared.
const TRUTH: Fill = Fill::new([0xcd, 0xd3, 0xdc], 1.0);
const COMPARED: Fill = Fill::new([0x8d, 0x99, 0xae], 1.0);
/// An estimate that is valid on more than this share beyond what is compared has a dashed line, too.
const MORE: f64 = 0.01;
const MORE_DASHES: &[f64] = &[4.0, 2.5];
const THIN_DASHES: &[f64] = &[0.8, 1.6];
/// The least share that the axis goes beyond the highest median, and the share beyond the usual that a band may reach
/// before it is cut.
const MEDIAN_ROOM: f64 = 1.15;
const WORTH_SHOWING: f64 = 1.3;

/// How errors spread in a bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    /// Its lower edge.
    pub from: f64,
    /// Its upper edge.
    pub to: f64,
    /// How many pixels.
    pub count: u64,
    /// 5, 25, 50, 75 and 95 %.
    pub percentiles: [f64; 5],
}

/// The errors of an estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// What they are of.
    pub place: Place,
    /// Over the pixels that are compared.
    pub bins: Vec<Bin>,
    /// Over all its valid pixels; may be empty.
    pub valid: Vec<Bin>,
}

/// Spreads on panels, above bars that count pixels by bin: from, to, count. Bars with equal edges are added up; there
/// may be none.
#[derive(Clone, Debug)]
pub struct SpreadFigure {
    /// The estimates.
    pub spreads: Vec<Spread>,
    /// Pixels with ground truth.
    pub truth: Vec<(f64, f64, u64)>,
    /// And those that are compared.
    pub compared: Vec<(f64, f64, u64)>,
    /// Where variants are.
    pub layout: Layout,
    /// What errors are against, and in what unit they are.
    pub labels: [String; 2],
    /// How bins are placed.
    pub scale: Scale,
    /// A bin of fewer pixels is thin.
    pub thin: u64,
    /// The top of the error's axis, where that is stated.
    pub most: Option<f64>,
}

/// A bin of a curve with a band around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// From where to where.
    pub edges: (f64, f64),
    /// The curve.
    pub y: f64,
    /// From where to where the band goes.
    pub band: (f64, f64),
    /// Whether it says little.
    pub is_thin: bool,
}

/// The band of steps, in pieces without gaps; thin pieces are fainter.
pub fn bands(steps: &[Step], scale: Scale, fill: Fill) -> Vec<Item> {
    let band = |(piece, is_thin): (&[Step], bool)| {
        let fill = Fill::new(fill.colour, if is_thin { fill.opacity * FAINT } else { fill.opacity });
        let points: Vec<_> = piece.iter().map(|step| (step.middle(scale), step.band.0, step.band.1)).collect();
        Item::band(points.into_iter(), fill)
    };
    pieces(steps).into_iter().map(band).collect()
}

/// The line of steps, in pieces without gaps; thin pieces are dotted, and a bin alone is a dot.
pub fn lines(steps: &[Step], scale: Scale, stroke: Stroke) -> Vec<Item> {
    let line = |(piece, is_thin): (&[Step], bool)| {
        let thin = Stroke { dashes: THIN_DASHES, ..Stroke::new(stroke.colour, stroke.width * 0.7).faint(FAINT) };
        let points = piece.iter().map(|step| (step.middle(scale), step.y)).collect();
        Item::curve(points, if is_thin { thin } else { stroke })
    };
    pieces(steps).into_iter().map(line).collect()
}

/// The entry of thin steps in a legend.
pub fn thin_entry(words: String, colour: Colour) -> Entry {
    Entry::new(words, Swatch::Line(Stroke::new(colour, 0.85).faint(0.7).dashed(THIN_DASHES)))
}

impl Step {
    fn middle(&self, scale: Scale) -> f64 {
        match scale {
            Scale::Linear => 0.5 * (self.edges.0 + self.edges.1),
            Scale::Log => (self.edges.0 * self.edges.1).sqrt(),
        }
    }
}

/// Steps in stretches without a gap, and these where thin ones begin and end: a piece is thin where one of its two ends
/// is.
fn pieces(steps: &[Step]) -> Vec<(&[Step], bool)> {
    let mut pieces = Vec::new();
    let joins = |one: &Step, next: &Step| next.edges.0 - one.edges.1 <= 1e-9 * next.edges.0.abs().max(1.0);
    for stretch in steps.chunk_by(joins) {
        let is_thin = |at: usize| stretch[at].is_thin || stretch.get(at + 1).is_some_and(|step| step.is_thin);
        let (mut start, last) = (0, stretch.len().saturating_sub(2));
        for at in 0..=last {
            if at == last || is_thin(at) != is_thin(at + 1) {
                pieces.push((&stretch[start..stretch.len().min(at + 2)], is_thin(at)));
                start = at + 1;
            }
        }
    }
    pieces
}

impl SpreadFigure {
    /// As a sheet.
    pub fn sheet(&self) -> Sheet {
        let drawn: Vec<&Spread> = self.spreads.iter().filter(|spread| !spread.bins.is_empty()).collect();
        let all = Comparison(drawn.iter().map(|spread| &spread.place).collect(), self.layout);
        let groups = all.panels();
        let on = |group: &[usize]| group.iter().map(|&at| drawn[at]).collect::<Vec<_>>();
        let (x, high) = (self.x_axis(), self.most.unwrap_or_else(|| self.high(groups.iter().map(|(_, at)| on(at)))));
        let panel = |(title, at): &(String, Vec<usize>)| {
            let mut panel = Panel::new(title.clone(), x.clone(), Axis::new(0.0, high, self.labels[1].clone()));
            panel.items = self.items(&on(at), at, &all, high);
            panel
        };
        let mut panels: Vec<Panel> = groups.iter().map(panel).collect();
        if !self.truth.is_empty() {
            panels.push(self.bars(x, panels.len()));
        }
        let mut legend = all.legend(", median");
        let grey = [0x5c; 3];
        if drawn.iter().any(|spread| spread.is_valid_on_more()) {
            let stroke = Stroke::new(grey, 0.8).dashed(MORE_DASHES);
            legend.push(Entry::new("median over its valid pixels", Swatch::Line(stroke)));
        }
        if self.has_thin() {
            legend.push(thin_entry(format!("fewer than {} pixels", self.thin), grey));
        }
        let mut block = |words: &str, fill: Fill| legend.push(Entry::new(words, Swatch::Block(fill)));
        block("25–75 %", Fill::new([0xa9; 3], 1.0));
        if groups.iter().any(|(_, at)| on(at).iter().any(|spread| spread.has_wide(at.len()))) {
            block("5–95 %", Fill::new([0xdc; 3], 1.0));
        }
        if !self.truth.is_empty() && !self.compared.is_empty() {
            block("pixels compared", COMPARED);
            block("pixels with ground truth", TRUTH);
        }
        Sheet { columns: groups.len().min(2), panels, legend, ..Sheet::default() }
    }

    /// Whether any bin is thin.
    pub fn has_thin(&self) -> bool {
        self.spreads.iter().flat_map(|spread| &spread.bins).any(|bin| bin.count < self.thin)
    }

    /// Thin bins at either end count, too: they have a place, and little ink.
    fn x_axis(&self) -> Axis {
        let bins = self.spreads.iter().flat_map(|spread| spread.bins.iter().chain(&spread.valid));
        let edges = bins.map(|bin| (bin.from, bin.to)).chain(self.truth.iter().map(|(from, to, _)| (*from, *to)));
        let (low, high) =
            edges.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (from, to)| (from.min(low), to.max(high)));
        let (low, high) = match self.scale {
            _ if !low.is_finite() => (0.0, 80.0),
            Scale::Linear if low > 0.0 && low < 0.5 * high => (0.0, high),
            _ => (low, high),
        };
        Axis { scale: self.scale, ..Axis::new(low, high, self.labels[0].clone()) }
    }

    /// The top of the error's axis. Bins that are thin do not count, unless all are. The medians have room, and nine
    /// tenths of what reaches highest in a bin; what few bins reach beyond is cut, and its size written, where it would
    /// squeeze the rest.
    fn high<'a>(&self, groups: impl Iterator<Item = Vec<&'a Spread>>) -> f64 {
        let groups: Vec<Vec<&Spread>> = groups.collect();
        let reached = |thin: u64| -> (Vec<f64>, f64) {
            let (mut ends, mut median) = (Vec::new(), 0.0_f64);
            for (spread, count) in groups.iter().flat_map(|on| on.iter().map(|spread| (spread, on.len()))) {
                let highest = if spread.has_wide(count) { 4 } else { 3 };
                ends.extend(spread.bins.iter().filter(|bin| bin.count >= thin).map(|bin| bin.percentiles[highest]));
                let more = spread.valid.iter().filter(|_| spread.is_valid_on_more());
                let medians = spread.bins.iter().chain(more).filter(|bin| bin.count >= thin);
                median = medians.map(|bin| bin.percentiles[2]).fold(median, f64::max);
            }
            ends.sort_by(f64::total_cmp);
            (ends, median)
        };
        let (ends, median) =
            Some(reached(self.thin)).filter(|(ends, _)| !ends.is_empty()).unwrap_or_else(|| reached(0));
        let most = ends.last().copied().unwrap_or(0.0).max(median);
        let usual = ends.get((ends.len() * 9 / 10).min(ends.len().saturating_sub(1))).copied().unwrap_or(0.0);
        let high = usual.max(MEDIAN_ROOM * median);
        (if most <= WORTH_SHOWING * high { most } else { high }).max(1e-9) * 1.03
    }

    fn steps(&self, bins: &[Bin], (low, high): (usize, usize)) -> Vec<Step> {
        let step = |bin: &Bin| Step {
            edges: (bin.from, bin.to),
            y: bin.percentiles[2],
            band: (bin.percentiles[low], bin.percentiles[high]),
            is_thin: bin.count < self.thin,
        };
        bins.iter().map(step).collect()
    }

    /// The wide bands of all, then the narrow ones, then the lines: no band hides a line.
    fn items(&self, on: &[&Spread], places: &[usize], all: &Comparison<'_>, high: f64) -> Vec<Item> {
        let spreads = || on.iter().zip(places.iter().map(|&at| (at, all.tint(at))));
        let wide = || spreads().filter(|(spread, _)| spread.has_wide(on.len()));
        let mut items = Vec::new();
        for (spread, (_, tint)) in wide() {
            items.extend(bands(&self.steps(&spread.bins, (0, 4)), self.scale, Fill::new(tint, WIDE_OPACITY)));
        }
        for (spread, (_, tint)) in spreads() {
            items.extend(bands(&self.steps(&spread.bins, (1, 3)), self.scale, Fill::new(tint, NARROW_OPACITY)));
        }
        for (spread, (at, tint)) in spreads() {
            if spread.is_valid_on_more() {
                let stroke = Stroke::new(tint, 0.8).dashed(MORE_DASHES);
                items.extend(lines(&self.steps(&spread.valid, (2, 2)), self.scale, stroke));
            }
            items.extend(lines(&self.steps(&spread.bins, (2, 2)), self.scale, all.stroke(at)));
        }
        // Where a band is cut, how far it goes; several below each other, because they may be at one place.
        let mut up = 0.0;
        for (spread, (_, tint)) in wide() {
            let thick = self.steps(&spread.bins, (0, 4)).into_iter().filter(|step| !step.is_thin && step.band.1 > high);
            if let Some(step) = thick.max_by(|one, two| one.band.1.total_cmp(&two.band.1)) {
                up -= 8.0;
                let words = format!("↑ {:.*}", usize::from(high < 5.0), step.band.1);
                items.push(Item::Words((step.middle(self.scale), high), up, words, Anchor::Start, tint));
            }
        }
        items
    }

    /// How many pixels are in each bin: in the gap of the last row if there is one, otherwise in a row of their own.
    fn bars(&self, x: Axis, panels: usize) -> Panel {
        let (truth, compared) = (added(&self.truth), added(&self.compared));
        let most = truth.iter().chain(&compared).map(|(.., count)| *count).max().unwrap_or(0);
        let (unit, label) = if most >= 2000 { (1000.0, "pixels, thousands") } else { (1.0, "pixels") };
        let mut panel = Panel::new("", x, Axis::new(0.0, (most as f64 / unit).max(1e-3) * 1.05, label));
        for (bars, fill) in [(&truth, TRUTH), (&compared, COMPARED)] {
            let bar =
                |(from, to, count): &(f64, f64, u64)| Item::block((*from, *to), (0.0, *count as f64 / unit), fill);
            panel.items.extend(bars.iter().map(bar));
        }
        panel.aspect = Some(if panels == 1 { 0.2 } else { 0.3 });
        panel.spans = panels == 1 || panels.is_multiple_of(2);
        if !panel.spans {
            "pixels".clone_into(&mut panel.title);
        }
        panel
    }
}

impl Spread {
    /// Whether its lighter band is drawn on a panel with a number of spreads.
    fn has_wide(&self, count: usize) -> bool {
        count <= 2 || ["stereo", "mono"].contains(&self.place.name.as_str())
    }

    fn is_valid_on_more(&self) -> bool {
        let all = |bins: &[Bin]| bins.iter().map(|bin| bin.count).sum::<u64>() as f64;
        all(&self.valid) > (1.0 + MORE) * all(&self.bins)
    }
}

/// Counts with equal edges added up.
fn added(counts: &[(f64, f64, u64)]) -> Vec<(f64, f64, u64)> {
    let edges = distinct(counts.iter().map(|(from, to, _)| (*from, *to)));
    let same = |edges: (f64, f64)| counts.iter().filter(move |(from, to, _)| (*from, *to) == edges);
    edges.into_iter().map(|edges| (edges.0, edges.1, same(edges).map(|(.., count)| count).sum())).collect()
}

#[cfg(test)]
mod tests;
