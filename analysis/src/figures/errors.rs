//! Histogram and cumulative distribution of errors.

use super::asked::{Asked, Watch, ask};
use super::places::{Place, dashes, panels};
use super::{Figure, FigureRequest, FigureRun, Layout, SampleSet};
use crate::analyse::{Bins, By, Inquiry, Unit};
use crate::colours::colour as colour_of;
use crate::drawing::{Drawing, Fill, Stroke, colour};
use crate::error::AnalysisError;
use crate::plot::{Axis, Entry, Item, Panel, Sheet, Swatch};

/// So many bins has a histogram where nothing else is asked for, up to the error that so many per cent of an estimator's pixels are below.
const BINS: u32 = 40;
const SHOWN_PERCENT: f64 = 95.0;
const LINE_PT: f64 = 1.2;
const FILL_OPACITY: f64 = 0.12;

/// A curve of an estimator.
struct Curve {
    of: Place,
    points: Vec<(f64, f64)>,
}

/// How often errors of which size are.
pub(super) fn histogram(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    watch: &Watch<'_>,
) -> Result<Figure, AnalysisError> {
    let (all, top) = whole(runs, request, watch, vec![SHOWN_PERCENT])?;
    let bins = request
        .bins
        .clone()
        .unwrap_or_else(|| Bins::Edges((0..=BINS).map(|edge| top * f64::from(edge) / f64::from(BINS)).collect()));
    let inquiry = Inquiry { by: By::Error, bins: Some(bins), percentiles: Vec::new(), ..request.inquiry() };
    let (asked, grid, _) = ask(runs, request, &inquiry, watch)?;
    let mut curves = Vec::new();
    let (mut beyond, mut high) = (0.0_f64, 0.0_f64);
    for one in &asked {
        let pixels = all.iter().find(|of| of.of == one.of).map_or(0, |of| of.rows.iter().map(|row| row.count).sum());
        let shown: u64 = one.rows.iter().map(|row| row.count).sum();
        beyond = beyond.max(1.0 - shown as f64 / pixels.max(1) as f64);
        let mut points = Vec::new();
        let mut last = None;
        for row in one.rows.iter().filter(|row| row.to > row.from) {
            // A bin without a pixel is no row.
            if let Some(end) = last.filter(|end| *end < row.from) {
                points.extend([(end, 0.0), (row.from, 0.0)]);
            }
            let percent = 100.0 * row.count as f64 / pixels.max(1) as f64;
            high = high.max(percent);
            points.extend([(row.from, percent), (row.to, percent)]);
            last = Some(row.to);
        }
        curves.push(Curve { of: one.of.clone(), points });
    }
    let ends = asked.iter().flat_map(|of| &of.rows).map(|row| row.to).fold(0.0, f64::max);
    let low = asked.iter().flat_map(|of| &of.rows).map(|row| row.from).fold(0.0, f64::min);
    let x = Axis::new(low, ends, label(request));
    let y = Axis::new(0.0, high.max(1e-9) * 1.05, "share of pixels, %");
    let drawing = drawn(&curves, request, &x, &y, true)?;
    let mut about = format!("Histogram of the {}, over {}", what(request), pixels_of(&asked));
    if beyond > 0.0005 {
        about.push_str(&format!("; up to {:.1} % of an estimator's pixels lie beyond", 100.0 * beyond));
    }
    Ok(Figure { drawing, about, data: grid.sheet().csv() })
}

/// Of how many pixels the error is below what.
pub(super) fn cdf(runs: &[FigureRun<'_>], request: &FigureRequest, watch: &Watch<'_>) -> Result<Figure, AnalysisError> {
    let percentiles: Vec<f64> = (0..=100).map(f64::from).collect();
    let inquiry = Inquiry { bins: Some(everything()), percentiles: percentiles.clone(), ..request.inquiry() };
    let (asked, grid, _) = ask(runs, request, &inquiry, watch)?;
    let curve = |of: &Asked| {
        let errors = of.rows.first().map_or(&[][..], |row| &row.percentiles);
        Curve { of: of.of.clone(), points: errors.iter().copied().zip(percentiles.iter().copied()).collect() }
    };
    let curves: Vec<Curve> = asked.iter().map(curve).collect();
    let top = curves.iter().filter_map(|curve| curve.points.get(SHOWN_PERCENT as usize)).map(|(error, _)| *error);
    let top = request.most.unwrap_or_else(|| top.fold(0.0, f64::max).max(1e-9));
    let drawing = drawn(
        &curves,
        request,
        &Axis::new(0.0, top, label(request)),
        &Axis::new(0.0, 100.0, "share of pixels, %"),
        false,
    )?;
    let about = format!("Cumulative distribution of the {}, over {}", what(request), pixels_of(&asked));
    Ok(Figure { drawing, about, data: grid.sheet().csv() })
}

/// One bin for all samples.
fn everything() -> Bins {
    Bins::Edges(vec![0.0, 1e9])
}

/// All errors in one bin, and the greatest of their percentiles.
fn whole(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    watch: &Watch<'_>,
    percentiles: Vec<f64>,
) -> Result<(Vec<Asked>, f64), AnalysisError> {
    let inquiry = Inquiry { bins: Some(everything()), percentiles, ..request.inquiry() };
    let (all, ..) = ask(runs, request, &inquiry, watch)?;
    let top = all.iter().flat_map(|of| &of.rows).filter_map(|row| row.percentiles.first()).copied();
    let top = request.most.unwrap_or_else(|| top.fold(0.0, f64::max));
    Ok((all, if top > 0.0 { top } else { 1.0 }))
}

fn what(request: &FigureRequest) -> &'static str {
    match request.unit {
        Unit::Metres => "absolute error",
        Unit::OfTruth => "absolute error as a share of the true distance",
    }
}

fn label(request: &FigureRequest) -> &'static str {
    match request.unit {
        Unit::Metres => "absolute error |y − t|, m",
        Unit::OfTruth => "relative error |y − t| / t",
    }
}

pub(super) fn pixels_of(asked: &[Asked]) -> &'static str {
    match asked.first().map(|of| of.set) {
        Some(SampleSet::Common) => "the pixels that all of them answered",
        _ => "the pixels that each of them answered",
    }
}

fn drawn(
    curves: &[Curve],
    request: &FigureRequest,
    x: &Axis,
    y: &Axis,
    is_filled: bool,
) -> Result<Drawing, AnalysisError> {
    let places: Vec<&Place> = curves.iter().map(|curve| &curve.of).collect();
    let mut names: Vec<&str> = Vec::new();
    for place in &places {
        if !names.contains(&place.name.as_str()) {
            names.push(&place.name);
        }
    }
    let groups = panels(&places, request.layout);
    request.few_panels(groups.len())?;
    let columns = if request.size.is_wide() { groups.len().clamp(1, 2) } else { 1 };
    let stroke = |curve: &Curve| {
        let own = match request.layout {
            Layout::Multiples => &[][..],
            Layout::Overlaid => dashes(places.iter().copied(), &curve.of),
        };
        Stroke::new(colour(colour_of(&names, &curve.of.name)), LINE_PT).dashed(own)
    };
    let mut sheets = Vec::new();
    for (place, (title, of)) in groups.iter().enumerate() {
        let mut panel = Panel::new(x.clone(), y.clone());
        if place + columns < groups.len() {
            panel.x.label = String::new();
        }
        if place % columns != 0 {
            panel.y.label = String::new();
        }
        panel.title.clone_from(title);
        if columns == 1 && request.size.is_wide() {
            panel.aspect = 0.5;
        }
        for curve in of.iter().map(|at| &curves[*at]) {
            let tint = colour(colour_of(&names, &curve.of.name));
            if is_filled {
                let points = curve.points.iter().map(|(x, y)| (*x, 0.0, *y)).collect();
                panel.items.push(Item::Band { points, fill: Fill::new(tint, FILL_OPACITY) });
            }
        }
        for curve in of.iter().map(|at| &curves[*at]) {
            panel.items.push(Item::Line { points: curve.points.clone(), stroke: stroke(curve) });
        }
        sheets.push(panel);
    }
    let legend = match request.layout {
        Layout::Multiples => names
            .iter()
            .map(|name| Entry::new(*name, Swatch::Line(Stroke::new(colour(colour_of(&names, name)), LINE_PT))))
            .collect(),
        Layout::Overlaid => {
            curves.iter().map(|curve| Entry::new(curve.of.label(), Swatch::Line(stroke(curve)))).collect()
        }
    };
    request.sheet(Sheet { columns, panels: sheets, legend, ..Sheet::default() })
}
