//! Histogram and cumulative distribution of errors.

use depthloom_figures::{
    Axis, Drawing, Entry, Fill, Item, Panel, Place, Sheet, Stroke, Swatch, colour, colour_of, dashes, panels, shade,
};
use depthloom_graphs::counted;

use super::asked::{Asked, Watch, ask};
use super::{Figure, FigureRequest, FigureRun, Layout, SampleSet};
use crate::analyse::{Bins, By, Inquiry, Unit};
use crate::error::AnalysisError;

/// So many bins of one ratio has a histogram where nothing else is asked for, from the error that so many per cent of an estimator's pixels are below to the one that so
/// many are.
const BINS: u32 = 40;
const LEAST_PERCENT: f64 = 1.0;
const MOST_PERCENT: f64 = 99.5;
/// The axis of a cumulative distribution ends where so many per cent of each estimator's pixels are below.
const SHOWN_PERCENT: f64 = 95.0;
const LINE_PT: f64 = 1.2;
const FILL_OPACITY: f64 = 0.12;
/// More curves than this hide each other's areas.
const MOST_FILLED: usize = 4;

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
    let (all, least, most) = whole(runs, request, watch)?;
    let most = request.most.unwrap_or(most);
    // Errors differ by decades: on a linear axis all but a few would be one bar. Those of zero have no place on this one.
    let of_ratio = |count: u32| {
        let least = if least > 0.0 && least < most { least } else { most * 1e-3 };
        let edge = |edge: u32| least * libm::pow(most / least, f64::from(edge) / f64::from(count));
        Bins::Edges((0..=count).map(edge).collect())
    };
    let (bins, is_log) = match &request.bins {
        None => (of_ratio(BINS), true),
        Some(Bins::Log(count)) => (of_ratio(*count), true),
        Some(bins) => (bins.clone(), false),
    };
    let inquiry = Inquiry { by: By::Error, bins: Some(bins), percentiles: Vec::new(), ..request.inquiry() };
    let (asked, grid, frames) = ask(runs, request, &inquiry, watch)?;
    let mut curves = Vec::new();
    let (mut outside, mut high) = (0.0_f64, 0.0_f64);
    for one in &asked {
        let pixels = all.iter().find(|of| of.of == one.of).map_or(0, |of| of.rows.iter().map(|row| row.count).sum());
        let shown: u64 = one.rows.iter().map(|row| row.count).sum();
        outside = outside.max(1.0 - shown as f64 / pixels.max(1) as f64);
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
    let rows = || asked.iter().flat_map(|of| &of.rows);
    let ends = rows().map(|row| row.to).fold(0.0, f64::max);
    let x = match is_log {
        true => Axis::log(rows().map(|row| row.from).fold(ends, f64::min), ends, label(request)),
        false => Axis::new(rows().map(|row| row.from).fold(0.0, f64::min), ends, label(request)),
    };
    let y = Axis::new(0.0, high.max(1e-9) * 1.05, "share of pixels, %");
    let drawing = drawn(&curves, request, &x, &y, true)?;
    let bins = if is_log { ", bins of one ratio" } else { "" };
    let mut about =
        format!("Histogram of the {}{bins}, over {} on {}", what(request), pixels_of(&asked), counted(frames, "frame"));
    if outside > 0.0005 {
        let ends = format!("{} to {}", told(x.low, request), told(x.high, request));
        about.push_str(&format!("; from {ends}, up to {:.1} % of an estimator's pixels lie outside", 100.0 * outside));
    }
    Ok(Figure { drawing, about, data: grid.sheet().csv(), notes: Vec::new() })
}

/// An error with three digits that count, and its unit.
fn told(value: f64, request: &FigureRequest) -> String {
    let rounded = format!("{value:.2e}").parse::<f64>().unwrap_or(value);
    format!("{rounded}{}", if request.unit == Unit::Metres { " m" } else { "" })
}

/// Of how many pixels the error is below what.
pub(super) fn cdf(runs: &[FigureRun<'_>], request: &FigureRequest, watch: &Watch<'_>) -> Result<Figure, AnalysisError> {
    let percentiles: Vec<f64> = (0..=100).map(f64::from).collect();
    let inquiry = Inquiry { bins: Some(everything()), percentiles: percentiles.clone(), ..request.inquiry() };
    let (asked, grid, frames) = ask(runs, request, &inquiry, watch)?;
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
    // The axis ends before the last errors do.
    let beyond = curves.iter().map(|curve| 100.0 - percent_at(curve, top)).fold(0.0, f64::max);
    let end = match beyond > 0.05 {
        true => {
            format!("; up to {}, beyond which lie up to {beyond:.1} % of an estimator's pixels", told(top, request))
        }
        false => String::new(),
    };
    let about = format!(
        "Cumulative distribution of the {}, over {} on {}{end}",
        what(request),
        pixels_of(&asked),
        counted(frames, "frame")
    );
    Ok(Figure { drawing, about, data: grid.sheet().csv(), notes: Vec::new() })
}

/// How many per cent of a curve's pixels have an error up to that.
fn percent_at(curve: &Curve, error: f64) -> f64 {
    let Some(above) = curve.points.iter().position(|(of, _)| *of > error) else { return 100.0 };
    let Some(before) = above.checked_sub(1) else { return 0.0 };
    let ((from, percent), (to, _)) = (curve.points[before], curve.points[above]);
    percent + (error - from) / (to - from)
}

/// One bin for all samples.
fn everything() -> Bins {
    Bins::Edges(vec![0.0, 1e9])
}

/// All errors in one bin; the least that counts of any estimator, and the greatest.
fn whole(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    watch: &Watch<'_>,
) -> Result<(Vec<Asked>, f64, f64), AnalysisError> {
    let percentiles = vec![LEAST_PERCENT, MOST_PERCENT];
    let inquiry = Inquiry { bins: Some(everything()), percentiles, ..request.inquiry() };
    let (all, ..) = ask(runs, request, &inquiry, watch)?;
    let at =
        |place: usize| all.iter().flat_map(|of| &of.rows).filter_map(move |row| row.percentiles.get(place)).copied();
    let least = at(0).filter(|error| *error > 0.0).fold(f64::INFINITY, f64::min);
    let most = at(1).fold(0.0, f64::max);
    Ok((all, least, if most > 0.0 { most } else { 1.0 }))
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
        let tint = colour(colour_of(&names, &curve.of.name));
        let tint = match request.layout {
            Layout::Multiples => tint,
            Layout::Overlaid => shade(places.iter().copied(), &curve.of, tint),
        };
        Stroke::new(tint, LINE_PT).dashed(own)
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
            if is_filled && of.len() <= MOST_FILLED {
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
