//! The paper's figure: absolute error against true distance, a panel a variant, and the histogram of true distances below.
//!
//! The solid line is the median, the darker band goes from 25 to 75 %, the lighter one from 5 to 95 %; mono is red, stereo blue.

use std::collections::BTreeMap;

use kuva::backend::svg::SvgBackend;
use kuva::plot::legend::{LegendEntry, LegendShape};
use kuva::plot::{BandPlot, Histogram, LinePlot};
use kuva::render::figure::Figure as Sheet;
use kuva::render::layout::{Layout, TickFormat};
use kuva::render::plots::Plot;
use kuva::render::theme::Theme;

use crate::distance::DistanceBin;
use crate::estimators::Estimator;

/// Panel width and height, and the histogram's height, pixels.
const PANEL: (f64, f64) = (460.0, 300.0);
const HISTOGRAM_HEIGHT: f64 = 190.0;
/// Stereo's colour, mono's, and those of all others in the order they come.
const BLUE: &str = "#1f5fb4";
const RED: &str = "#d1332e";
const OTHERS: [&str; 6] = ["#2b9348", "#8e44ad", "#e08a00", "#0f8b8d", "#7f5539", "#5c677d"];

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
    let columns = panels.len().clamp(1, 2);
    let rows = panels.len().div_ceil(columns);
    let far_m =
        f64::from(figure.truth.keys().chain(figure.bins.iter().map(|bin| &bin.bin_m)).max().map_or(80, |m| m + 1));
    let high_m = figure.bins.iter().map(|bin| bin.percentiles_m[4]).fold(1.0, f64::max);

    let mut cells: Vec<Vec<usize>> = (0..panels.len()).map(|panel| vec![panel]).collect();
    if let Some(last) = cells.last_mut() {
        // A last panel alone in its row takes the whole row.
        last.extend(panels.len()..rows * columns);
    }
    let mut plots = Vec::new();
    let mut layouts = Vec::new();
    for panel in &panels {
        let drawn: Vec<Plot> = panel
            .estimators
            .iter()
            .flat_map(|&index| figure.curves(index, colour(&names, figure.name(index))))
            .collect();
        let mut layout =
            layout(far_m).with_y_axis_min(0.0).with_y_axis_max(high_m).with_y_label("absolute error |y − t|, m");
        if let Some(title) = &panel.title {
            layout = layout.with_title(title.as_str());
        }
        plots.push(drawn);
        layouts.push(layout);
    }
    cells.push((rows * columns..(rows + 1) * columns).collect());
    plots.push(vec![figure.histogram()]);
    let most = figure.truth.values().copied().max().unwrap_or(1) as f64;
    let layout = layout(far_m).with_y_axis_min(0.0).with_y_axis_max(most).with_x_label("true distance t, m");
    layouts.push(layout.with_y_label("true pixels").with_y_tick_format(TickFormat::Auto));

    let legend = names.iter().map(|name| LegendEntry {
        label: (*name).to_owned(),
        color: colour(&names, name).to_owned(),
        shape: LegendShape::Line,
        dasharray: None,
    });
    let mut sheet = Sheet::new(rows + 1, columns)
        .with_structure(cells)
        .with_plots(plots)
        .with_layouts(layouts)
        .with_cell_size(PANEL.0, PANEL.1)
        .with_row_height(rows, HISTOGRAM_HEIGHT)
        .with_shared_legend_bottom()
        .with_shared_legend_entries(legend.collect());
    sheet = sheet.with_title("Absolute error against true distance: median, 25–75 %, 5–95 %").with_title_size(16);
    SvgBackend::new().render_scene(&sheet.render())
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
        let shared: Vec<usize> = self.drawn().filter(|&index| self.estimators[index].variant.is_none()).collect();
        for index in self.drawn() {
            let Some(variant) = &self.estimators[index].variant else { continue };
            match panels.iter_mut().find(|panel| panel.title.as_ref() == Some(variant)) {
                Some(panel) => panel.estimators.push(index),
                None => {
                    let estimators = shared.iter().copied().chain([index]).collect();
                    panels.push(Panel { title: Some(variant.clone()), estimators });
                }
            }
        }
        if panels.is_empty() {
            panels.push(Panel { title: None, estimators: shared });
        }
        panels
    }

    /// Two bands and a line through the middles of the bins; a metre without samples interrupts them.
    fn curves(&self, index: usize, colour: &str) -> Vec<Plot> {
        let bins: Vec<&DistanceBin> = self.bins.iter().filter(|bin| bin.estimator == index).collect();
        let stretches = bins.chunk_by(|a, b| a.bin_m + 1 == b.bin_m);
        let mut plots = Vec::new();
        for stretch in stretches {
            let middles = || stretch.iter().map(|bin| f64::from(bin.bin_m) + 0.5);
            let percentile = |i: usize| stretch.iter().map(move |bin| bin.percentiles_m[i]);
            for (below, above, opacity) in [(0, 4, 0.13), (1, 3, 0.27)] {
                let band = BandPlot::new(middles(), percentile(below), percentile(above));
                plots.push(Plot::Band(band.with_color(colour).with_opacity(opacity)));
            }
            let line = LinePlot::new().with_data(middles().zip(percentile(2)));
            plots.push(Plot::Line(line.with_color(colour).with_stroke_width(1.8)));
        }
        plots
    }

    fn histogram(&self) -> Plot {
        let nearest = self.truth.keys().next().copied().unwrap_or(0);
        let farthest = self.truth.keys().next_back().copied().unwrap_or(0);
        let edges = (nearest..=farthest + 1).map(f64::from).collect();
        let counts = (nearest..=farthest).map(|metre| self.truth.get(&metre).copied().unwrap_or(0) as f64).collect();
        Plot::Histogram(Histogram::new().with_precomputed(edges, counts).with_color("#8d99ae"))
    }
}

/// What all panels have in common.
fn layout(far_m: f64) -> Layout {
    Layout::new((0.0, far_m), (0.0, 1.0))
        .with_theme(Theme { show_grid: true, grid_color: "#e6e6e6".into(), ..Theme::light() })
        .with_x_axis_min(0.0)
        .with_x_axis_max(far_m)
        .with_x_tick_step(10.0)
        .with_title_size(14)
        .with_label_size(12)
        .with_tick_size(10)
}

fn colour(names: &[&str], name: &str) -> &'static str {
    match name {
        "stereo" => BLUE,
        "mono" => RED,
        name => {
            let others = names.iter().filter(|name| !["stereo", "mono"].contains(name));
            OTHERS[others.take_while(|other| **other != name).count() % OTHERS.len()]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zz_look() {
        let csv = std::fs::read_to_string("/work/shared/oracle/golden/ground_plane/percentiles.csv").unwrap();
        let mut est: Vec<Estimator> = Vec::new();
        let mut bins = Vec::new();
        let mut truth = BTreeMap::new();
        for l in csv.lines().skip(1) {
            let c: Vec<&str> = l.split(',').collect();
            let i = est.iter().position(|e| e.label == c[0]).unwrap_or_else(|| {
                let (v, n) = c[0].split_once('/').map_or((None, c[0]), |(v, n)| (Some(v.to_owned()), n));
                est.push(Estimator {
                    label: c[0].into(),
                    name: n.into(),
                    variant: v,
                    run: 0,
                    sets: vec![],
                    settings: Default::default(),
                    score_topic: None,
                    estimate_topic: None,
                    truth_topic: None,
                });
                est.len() - 1
            });
            let f = |k: usize| c[k].parse::<f64>().unwrap();
            bins.push(DistanceBin {
                estimator: i,
                bin_m: f(1) as u32,
                count: f(2) as u64,
                percentiles_m: [f(3), f(4), f(5), f(6), f(7)],
            });
            if n_is(c[0]) {
                truth.insert(f(1) as u32, f(2) as u64);
            }
        }
        fn n_is(s: &str) -> bool {
            s == "full/mono"
        }
        let svg = render(&Figure { estimators: &est, bins: &bins, truth: &truth });
        std::fs::write("/tmp/figure.svg", &svg).unwrap();
        let first: Vec<Estimator> = est
            .iter()
            .cloned()
            .filter(|e| e.variant.is_none() || e.variant.as_deref() == Some("full"))
            .map(|mut e| {
                e.variant = None;
                e
            })
            .collect();
        let bins: Vec<_> = bins.into_iter().filter(|b| b.estimator < 3).collect();
        std::fs::write("/tmp/figure1.svg", render(&Figure { estimators: &first, bins: &bins, truth: &truth })).unwrap();
    }
}
