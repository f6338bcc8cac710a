//! The paper's figure: absolute error against true distance, a panel a variant, and the histogram of true distances.
//!
//! The solid line is the median, the darker band goes from 25 to 75 %, the lighter one from 5 to 95 %; mono is red, stereo blue.
//! A third estimator's lighter band is left out where it would hide those two; `error_vs_distance.csv` has its numbers.
//!
//! Like is compared with like: lines and bands are over the pixels that all estimators answered. A dashed line is the median over
//! all that an estimator answered, where that is more.

use std::collections::BTreeMap;
use std::sync::Arc;

use kuva::backend::svg::SvgBackend;
use kuva::plot::legend::{LegendEntry, LegendShape};
use kuva::plot::{BandPlot, Histogram, LinePlot, LineStyle};
use kuva::render::figure::Figure as Sheet;
use kuva::render::layout::{Layout, TickFormat};
use kuva::render::plots::Plot;
use kuva::render::theme::Theme;

use crate::colours::colour;
use crate::distance::{DistanceBin, Spread};
use crate::estimators::Estimator;

/// Width and height of a panel, of one that stands alone, and the height of a histogram with its own row; pixels.
pub(crate) const PANEL_PX: (f64, f64) = (440.0, 290.0);
pub(crate) const LONE_PANEL_PX: (f64, f64) = (640.0, 400.0);
const HISTOGRAM_HEIGHT_PX: f64 = 190.0;
/// How opaque the bands from 5 to 95 % and from 25 to 75 % are.
const WIDE_OPACITY: f64 = 0.14;
const NARROW_OPACITY: f64 = 0.30;
/// The bars of all true pixels, and of those that are compared.
const TRUE_COLOUR: &str = "#cdd3dc";
const COMPARED_COLOUR: &str = "#8d99ae";
/// An estimator that answered more than this share beyond the shared pixels has a dashed line.
const MORE: f64 = 0.01;
const DASHES: &str = "6 4";

/// What the figure shows.
pub(crate) struct Figure<'a> {
    pub(crate) estimators: &'a [Estimator],
    pub(crate) bins: &'a [DistanceBin],
    /// Scored true pixels by metre.
    pub(crate) truth: &'a BTreeMap<u32, u64>,
}

/// The figure as SVG; equal numbers give equal bytes.
pub(crate) fn render(figure: &Figure<'_>) -> String {
    let names = figure.names();
    let panels = figure.panels();
    let metres = figure.truth.keys().chain(figure.bins.iter().map(|bin| &bin.bin_m));
    let far_m = metres.max().map_or(80.0, |metre| f64::from(metre + 1));
    let drawn = figure.bins.iter().flat_map(|bin| {
        let lines = figure.solid(bin).map(|spread| spread.percentiles_m[4]);
        lines.into_iter().chain([bin.answered.percentiles_m[2]])
    });
    let high_m = drawn.fold(1.0, f64::max);

    // The histogram fills the place an odd number of panels leaves, or a row of its own.
    let columns = panels.len().clamp(1, 2);
    let own_row = panels.len().is_multiple_of(columns);

    let mut plots = Vec::new();
    let mut layouts = Vec::new();
    for (place, panel) in panels.iter().enumerate() {
        let mut layout = layout(far_m).with_y_axis_min(0.0).with_y_axis_max(high_m);
        if place % 2 == 0 {
            layout = layout.with_y_label("absolute error |y − t|, m");
        }
        if let Some(title) = &panel.title {
            layout = layout.with_title(title.as_str());
        }
        if !own_row && place + 1 == panels.len() {
            layout = layout.with_x_label("true distance t, m");
        }
        plots.push(figure.panel(panel, &names));
        layouts.push(layout);
    }
    let rows = panels.len().div_ceil(columns) + usize::from(own_row);
    let mut cells: Vec<Vec<usize>> = (0..panels.len()).map(|panel| vec![panel]).collect();
    cells.push((panels.len()..rows * columns).collect());
    let (histograms, most) = figure.histograms();
    plots.push(histograms);
    let layout = layout(far_m).with_y_axis_min(0.0).with_y_axis_max(most).with_x_label("true distance t, m");
    let layout = if own_row { layout } else { layout.with_title("true distances") };
    layouts.push(layout.with_y_label("true pixels, thousands"));

    let (width_px, height_px) = if panels.len() == 1 { LONE_PANEL_PX } else { PANEL_PX };
    let mut sheet = Sheet::new(rows, columns)
        .with_structure(cells)
        .with_plots(plots)
        .with_layouts(layouts)
        .with_cell_size(width_px, height_px)
        .with_spacing(8.0)
        .with_title(figure.title())
        .with_title_size(if panels.len() == 1 { 14 } else { 16 })
        .with_shared_legend_entries(figure.legend(&names))
        .with_shared_legend_bottom();
    if own_row {
        sheet = sheet.with_row_height(rows - 1, HISTOGRAM_HEIGHT_PX);
    }
    svg(sheet)
}

/// A figure as SVG: it scales to where it is put, and equal figures are equal bytes.
pub(crate) fn svg(sheet: Sheet) -> String {
    let text = renumbered(&SvgBackend::new().render_scene(&sheet.render()));
    let number = |name: &str| text.split_once(&format!(" {name}=\""))?.1.split_once('"').map(|(number, _)| number);
    match (text.split_once(' '), number("width"), number("height")) {
        (Some((start, rest)), Some(width), Some(height)) => {
            format!("{start} viewBox=\"0 0 {width} {height}\" {rest}")
        }
        _ => text,
    }
}

/// Numbers clip paths from 0 in the order they come: kuva goes on counting from one figure of a process to the next.
fn renumbered(svg: &str) -> String {
    const MARK: &str = "kuva-clip-";
    let mut pieces = svg.split(MARK);
    let mut text = pieces.next().unwrap_or_default().to_owned();
    let mut known: Vec<&str> = Vec::new();
    for piece in pieces {
        let (number, rest) = piece.split_at(piece.find(|c: char| !c.is_ascii_digit()).unwrap_or(piece.len()));
        let place = known.iter().position(|other| *other == number).unwrap_or_else(|| {
            known.push(number);
            known.len() - 1
        });
        text.push_str(&format!("{MARK}{place}{rest}"));
    }
    text
}

/// A variant's estimators and those all variants share.
struct Panel {
    title: Option<String>,
    estimators: Vec<usize>,
}

impl Figure<'_> {
    fn name(&self, index: usize) -> &str {
        &self.estimators[index].name
    }

    /// The estimators with samples.
    fn drawn(&self) -> impl Iterator<Item = usize> {
        (0..self.estimators.len()).filter(|index| self.bins.iter().any(|bin| bin.estimator == *index))
    }

    /// Names as they first come: they choose the colours.
    fn names(&self) -> Vec<&str> {
        let mut names = Vec::new();
        for index in self.drawn() {
            if !names.contains(&self.name(index)) {
                names.push(self.name(index));
            }
        }
        names
    }

    fn panels(&self) -> Vec<Panel> {
        let mut panels: Vec<Panel> = Vec::new();
        let shared: Vec<usize> = self.drawn().filter(|&index| self.estimators[index].lead.variant.is_none()).collect();
        for index in self.drawn() {
            let Some(variant) = &self.estimators[index].lead.variant else { continue };
            if let Some(panel) = panels.iter_mut().find(|panel| panel.title.as_ref() == Some(variant)) {
                panel.estimators.push(index);
            } else {
                let estimators = shared.iter().copied().chain([index]).collect();
                panels.push(Panel { title: Some(variant.clone()), estimators });
            }
        }
        if panels.is_empty() {
            panels.push(Panel { title: None, estimators: shared });
        }
        panels
    }

    /// The wide bands of all, then the narrow ones, then the lines: no band hides a line.
    fn panel(&self, panel: &Panel, names: &[&str]) -> Vec<Plot> {
        let few = panel.estimators.len() <= 2;
        let with_wide = panel.estimators.iter().filter(|index| few || ["stereo", "mono"].contains(&self.name(**index)));
        let coloured = |index: usize| (index, colour(names, self.name(index)));
        let wide = with_wide
            .map(|&index| coloured(index))
            .flat_map(|(index, colour)| self.bands(index, colour, (0, 4), WIDE_OPACITY));
        let all = || panel.estimators.iter().map(|&index| coloured(index));
        let narrow = all().flat_map(|(index, colour)| self.bands(index, colour, (1, 3), NARROW_OPACITY));
        wide.chain(narrow).chain(all().flat_map(|(index, colour)| self.lines(index, colour))).collect()
    }

    /// Whether there are pixels that all estimators answered.
    fn any_shared(&self) -> bool {
        self.bins.iter().any(|bin| bin.shared.is_some())
    }

    /// What lines and bands show of a bin.
    fn solid<'a>(&self, bin: &'a DistanceBin) -> Option<&'a Spread> {
        if self.any_shared() { bin.shared.as_ref() } else { Some(&bin.answered) }
    }

    /// Whether an estimator answered more than what all did.
    fn answered_more(&self, index: usize) -> bool {
        let bins = || self.bins.iter().filter(|bin| bin.estimator == index);
        let answered: u64 = bins().map(|bin| bin.answered.count).sum();
        let shared: u64 = bins().filter_map(|bin| Some(bin.shared?.count)).sum();
        self.any_shared() && answered as f64 > (1.0 + MORE) * shared as f64
    }

    /// Which pixels are compared, in words.
    fn title(&self) -> String {
        let what = "Absolute error against true distance";
        if !self.any_shared() {
            return format!("{what}: each on the pixels it answered, not the same ones");
        }
        let (truth, compared): (u64, u64) = (self.truth.values().sum(), self.compared().values().sum());
        if compared == truth {
            return format!("{what}, on all true pixels");
        }
        // Never rounded up to all, nor down to none.
        let share = (100.0 * compared as f64 / truth.max(1) as f64).round().clamp(1.0, 99.0);
        format!("{what}, on the {share} % of true pixels that all estimators answered")
    }

    /// By metre: how many pixels are compared; estimators of one stage run share theirs.
    fn compared(&self) -> BTreeMap<u32, u64> {
        let mut by_run: BTreeMap<(usize, u32), u64> = BTreeMap::new();
        for bin in self.bins {
            let count = self.solid(bin).map_or(0, |spread| spread.count);
            let most = by_run.entry((self.estimators[bin.estimator].run, bin.bin_m)).or_default();
            *most = count.max(*most);
        }
        let mut compared = BTreeMap::new();
        for ((_, metre), count) in by_run {
            *compared.entry(metre).or_default() += count;
        }
        compared
    }

    /// Some of an estimator's bins in stretches without a gap: a metre without samples interrupts bands and lines.
    fn stretches<'a>(
        &'a self,
        index: usize,
        spread: impl Fn(&'a DistanceBin) -> Option<&'a Spread>,
    ) -> Vec<Vec<(u32, &'a Spread)>> {
        let bins = self.bins.iter().filter(|bin| bin.estimator == index);
        let bins: Vec<(u32, &Spread)> = bins.filter_map(|bin| Some((bin.bin_m, spread(bin)?))).collect();
        bins.chunk_by(|a, b| a.0 + 1 == b.0).map(<[_]>::to_vec).collect()
    }

    fn bands(&self, index: usize, colour: &str, (below, above): (usize, usize), opacity: f64) -> Vec<Plot> {
        let band = |stretch: Vec<(u32, &Spread)>| {
            let percentile = |i: usize| stretch.iter().map(move |(_, spread)| spread.percentiles_m[i]);
            let band = BandPlot::new(middles(&stretch), percentile(below), percentile(above));
            Plot::Band(band.with_color(colour).with_opacity(opacity))
        };
        self.stretches(index, |bin| self.solid(bin)).into_iter().map(band).collect()
    }

    fn lines(&self, index: usize, colour: &str) -> Vec<Plot> {
        let line = |stretch: Vec<(u32, &Spread)>| {
            let medians = stretch.iter().map(|(_, spread)| spread.percentiles_m[2]);
            LinePlot::new().with_data(middles(&stretch).into_iter().zip(medians)).with_color(colour)
        };
        let more = self.answered_more(index).then(|| self.stretches(index, |bin| Some(&bin.answered)));
        let dashed = more.into_iter().flatten().map(|stretch| {
            let style = LineStyle::Custom(DASHES.to_owned());
            Plot::Line(line(stretch).with_stroke_width(1.2).with_line_style(style))
        });
        let solid = self.stretches(index, |bin| self.solid(bin)).into_iter();
        dashed.chain(solid.map(|stretch| Plot::Line(line(stretch).with_stroke_width(1.8)))).collect()
    }

    /// The histograms of all true pixels and of those compared, in thousands, and the highest bar.
    fn histograms(&self) -> (Vec<Plot>, f64) {
        let nearest = self.truth.keys().next().copied().unwrap_or(0);
        let farthest = self.truth.keys().next_back().copied().unwrap_or(0);
        let bars = |counts: &BTreeMap<u32, u64>, colour: &str| {
            let edges = (nearest..=farthest + 1).map(f64::from).collect();
            let thousands = |metre: u32| counts.get(&metre).copied().unwrap_or(0) as f64 / 1000.0;
            let heights: Vec<f64> = (nearest..=farthest).map(thousands).collect();
            Plot::Histogram(Histogram::new().with_precomputed(edges, heights).with_color(colour))
        };
        let most = self.truth.values().copied().max().unwrap_or(0) as f64 / 1000.0;
        let mut plots = vec![bars(self.truth, TRUE_COLOUR)];
        if self.any_shared() {
            plots.push(bars(&self.compared(), COMPARED_COLOUR));
        }
        (plots, most.max(1e-3))
    }

    fn legend(&self, names: &[&str]) -> Vec<LegendEntry> {
        let entry = |label: &str, colour: &str, shape| LegendEntry {
            label: label.to_owned(),
            color: colour.to_owned(),
            shape,
            dasharray: None,
        };
        let lines = names.iter().map(|name| entry(&format!("{name}, median"), colour(names, name), LegendShape::Line));
        let mut entries: Vec<LegendEntry> = lines.collect();
        if self.drawn().any(|index| self.answered_more(index)) {
            let more = entry("median of all it answered", "#5c5c5c", LegendShape::Line);
            entries.push(LegendEntry { dasharray: Some(DASHES.to_owned()), ..more });
        }
        entries.push(entry("25–75 %", "#a9a9a9", LegendShape::Rect));
        entries.push(entry("5–95 %", "#dcdcdc", LegendShape::Rect));
        if self.any_shared() {
            entries.push(entry("pixels compared", COMPARED_COLOUR, LegendShape::Rect));
        }
        entries.push(entry("true pixels", TRUE_COLOUR, LegendShape::Rect));
        entries
    }
}

fn middles(stretch: &[(u32, &Spread)]) -> Vec<f64> {
    stretch.iter().map(|(metre, _)| f64::from(*metre) + 0.5).collect()
}

/// What all panels have in common.
fn layout(far_m: f64) -> Layout {
    styled(Layout::new((0.0, far_m), (0.0, 1.0))).with_x_axis_min(0.0).with_x_axis_max(far_m).with_x_tick_step(10.0)
}

/// The look of every panel of every figure.
pub(crate) fn styled(layout: Layout) -> Layout {
    layout
        .with_theme(Theme { grid_color: "#e8e8e8".into(), legend_border: "none".into(), ..Theme::light() })
        .with_title_size(14)
        .with_label_size(12)
        .with_tick_size(10)
        .with_body_size(11)
        .with_tick_format(TickFormat::Custom(Arc::new(short)))
}

/// A tick with the digits it needs: `20`, `0.0048`, `5e-7`.
pub(crate) fn short(tick: f64) -> String {
    // Ticks are sums and products: their last bits are not meant.
    let rounded: f64 = format!("{tick:.9e}").parse().unwrap_or(tick);
    if rounded == 0.0 || (1e-4..1e6).contains(&rounded.abs()) {
        (rounded + 0.0).to_string()
    } else {
        format!("{rounded:e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colours::{BLUE, RED};

    fn estimator(variant: Option<&str>, name: &str) -> Estimator {
        Estimator::of_depths(name, variant, name, &[])
    }

    fn bin(estimator: usize, bin_m: u32) -> DistanceBin {
        let middle = f64::from(bin_m);
        let percentiles_m = [0.1 * middle, 0.2 * middle, 0.3 * middle, 0.4 * middle, 0.5 * middle];
        let answered = Spread { count: 10, percentiles_m };
        DistanceBin { estimator, bin_m, answered, shared: Some(answered) }
    }

    #[test]
    fn every_variant_has_a_panel_with_what_all_variants_share() {
        let estimators = [
            estimator(None, "stereo"),
            estimator(Some("full"), "mono"),
            estimator(Some("full"), "fused"),
            estimator(Some("bare"), "mono"),
        ];
        let bins = [bin(0, 5), bin(1, 5), bin(2, 5), bin(3, 5)];
        let figure = Figure { estimators: &estimators, bins: &bins, truth: &BTreeMap::new() };
        let panels: Vec<_> =
            figure.panels().into_iter().map(|panel| (panel.title.unwrap(), panel.estimators)).collect();
        assert_eq!(panels, [("full".to_owned(), vec![0, 1, 2]), ("bare".to_owned(), vec![0, 3])]);
        // Two wide bands (stereo, mono), three narrow ones, three lines; of two estimators both have all.
        let names = figure.names();
        assert_eq!(figure.panel(&figure.panels()[0], &names).len(), 2 + 3 + 3);
        assert_eq!(figure.panel(&figure.panels()[1], &names).len(), 2 + 2 + 2);
    }

    #[test]
    fn a_metre_without_samples_interrupts_the_curves() {
        let estimators = [estimator(None, "stereo")];
        let bins = [bin(0, 3), bin(0, 4), bin(0, 6)];
        let figure = Figure { estimators: &estimators, bins: &bins, truth: &BTreeMap::new() };
        let stretches = figure.stretches(0, |bin| Some(&bin.answered));
        assert_eq!(stretches.iter().map(|stretch| middles(stretch)).collect::<Vec<_>>(), [vec![3.5, 4.5], vec![6.5]]);
    }

    #[test]
    fn equal_numbers_give_equal_bytes() {
        let estimators = [estimator(None, "stereo"), estimator(Some("a"), "mono"), estimator(Some("b"), "mono")];
        let bins: Vec<DistanceBin> = (0..3).flat_map(|e| (2..70).map(move |metre| bin(e, metre))).collect();
        let truth = (2..70).map(|metre| (metre, u64::from(5000 / metre))).collect();
        let figure = || render(&Figure { estimators: &estimators, bins: &bins, truth: &truth });
        let svg = figure();
        assert!(svg == figure(), "two renderings of one figure differ");
        assert!(svg.starts_with("<svg") && svg.contains(RED) && svg.contains(BLUE));
    }

    #[test]
    fn fault_37_ticks_have_the_digits_they_need() {
        let ticks =
            [20.0, 1.0, 0.1 + 0.2, 0.000_6 * 8.0, 4.800_000_000_000_000_4e-3, 5e-7, 2e6, 0.0, -0.0, -1.5, 12_345.0];
        let short = ticks.map(short);
        assert_eq!(short, ["20", "1", "0.3", "0.0048", "0.0048", "5e-7", "2e6", "0", "0", "-1.5", "12345"]);
    }

    #[test]
    fn fault_39_lines_are_over_the_pixels_that_all_answered_and_the_title_says_so() {
        let estimators = [estimator(None, "stereo"), estimator(Some("full"), "fused")];
        let mut bins = [bin(0, 5), bin(1, 5)];
        bins[1].answered = Spread { count: 16, percentiles_m: [9.0; 5] };
        let truth = BTreeMap::from([(5, 16)]);
        let figure = Figure { estimators: &estimators, bins: &bins, truth: &truth };
        assert_eq!(
            figure.title(),
            "Absolute error against true distance, on the 63 % of true pixels that all estimators answered"
        );
        let title = |truth: u64| {
            let truth = BTreeMap::from([(5, truth)]);
            Figure { estimators: &estimators, bins: &bins, truth: &truth }.title()
        };
        assert!(
            [(12, "83 %"), (13, "77 %"), (10_000, "1 %")].iter().all(|(truth, share)| title(*truth).contains(share))
        );
        let drawn = |index: usize| figure.stretches(index, |bin| figure.solid(bin))[0][0].1.count;
        assert_eq!((drawn(0), drawn(1)), (10, 10), "stereo and fused on the same pixels");
        assert_eq!((figure.answered_more(0), figure.answered_more(1)), (false, true));
        assert_eq!(
            (figure.lines(0, BLUE).len(), figure.lines(1, RED).len()),
            (1, 2),
            "what fused answered alone is dashed"
        );
        assert!(render(&figure).contains(&format!("stroke-dasharray=\"{DASHES}\"")));
        // Where nothing is shared, that is said too.
        bins.iter_mut().for_each(|bin| bin.shared = None);
        let figure = Figure { estimators: &estimators, bins: &bins, truth: &truth };
        assert!(figure.title().ends_with("each on the pixels it answered, not the same ones"));
    }

    #[test]
    fn fault_40_figures_scale() {
        let figure =
            Figure { estimators: &[estimator(None, "stereo")], bins: &[bin(0, 5)], truth: &BTreeMap::from([(5, 10)]) };
        let svg = render(&figure);
        let number = |name: &str| {
            let rest = svg.split_once(&format!(" {name}=\"")).unwrap().1;
            rest.split_once('"').unwrap().0.to_owned()
        };
        assert_eq!(number("viewBox"), format!("0 0 {} {}", number("width"), number("height")));
    }

    #[test]
    fn clip_paths_are_numbered_in_the_order_they_come() {
        let svg = r#"<clipPath id="kuva-clip-17"/><clipPath id="kuva-clip-9"/><g clip-path="url(#kuva-clip-17)"/>"#;
        let expected = r#"<clipPath id="kuva-clip-0"/><clipPath id="kuva-clip-1"/><g clip-path="url(#kuva-clip-0)"/>"#;
        assert_eq!(renumbered(svg), expected);
    }

    #[test]
    fn nothing_to_draw_is_an_empty_figure() {
        let svg = render(&Figure { estimators: &[estimator(None, "stereo")], bins: &[], truth: &BTreeMap::new() });
        assert!(svg.ends_with("</svg>") || svg.trim_end().ends_with("</svg>"));
    }
}
