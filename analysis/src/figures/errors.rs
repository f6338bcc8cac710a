//! Histogram and cumulative distribution of errors.

use depthloom_figures::{Axis, Place, compared_curves};
use depthloom_graphs::counted;

use super::error_bins::{Errors, Watch, read_errors};
use super::{Figure, FigureRequest, FigureRun};
use crate::error::AnalysisError;
use crate::query::{Bins, By, Inquiry, SampleSet, Unit};

/// The default number of bins of a histogram, which have a constant ratio, and the percentiles of each estimate's
/// errors at the first and the last edge.
const BINS: u32 = 40;
const LEAST_PERCENT: f64 = 1.0;
const MOST_PERCENT: f64 = 99.5;
/// The percentage of each estimate's pixels whose errors are within the axis of a cumulative distribution.
const SHOWN_PERCENT: f64 = 95.0;

type Curve = (Place, Vec<(f64, f64)>);

/// Error histogram.
pub(super) fn histogram(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    watch: &Watch<'_>,
) -> Result<Figure, AnalysisError> {
    let percentiles = vec![LEAST_PERCENT, MOST_PERCENT];
    let (all, ..) =
        read_errors(runs, request, Inquiry { bins: Some(one_bin()), percentiles, ..request.inquiry() }, watch)?;
    let percentile = |at: usize| {
        let bins = all.iter().flat_map(|errors| &errors.bins);
        bins.filter_map(move |bin| bin.percentiles.get(at)).copied().filter(|error| *error > 0.0)
    };
    let most = request.y_max.or_else(|| percentile(1).reduce(f64::max)).unwrap_or(1.0);
    let least = percentile(0).reduce(f64::min).filter(|least| *least < most).unwrap_or(most * 1e-3);
    // Errors span decades: on a linear axis nearly all of them would be in one bar. Errors of zero have no place on a
    // logarithmic axis.
    let ratios = |count: u32| {
        let edge = |edge: u32| least * libm::pow(most / least, f64::from(edge) / f64::from(count));
        (Bins::Edges((0..=count).map(edge).collect()), true)
    };
    let (bins, is_log) = match &request.bins {
        None => ratios(BINS),
        Some(Bins::Log(count)) => ratios(*count),
        Some(bins) => (bins.clone(), false),
    };
    let inquiry = Inquiry { by: By::Error, bins: Some(bins), percentiles: Vec::new(), ..request.inquiry() };
    let (errors, grid, frames) = read_errors(runs, request, inquiry, watch)?;
    let (mut outside, mut high, mut curves) = (0.0_f64, 0.0_f64, Vec::<Curve>::new());
    for one in &errors {
        let same = all.iter().filter(|all| all.place == one.place).flat_map(|all| &all.bins);
        let pixels = same.map(|bin| bin.count).sum::<u64>().max(1) as f64;
        outside = outside.max(1.0 - one.bins.iter().map(|bin| bin.count).sum::<u64>() as f64 / pixels);
        let mut points: Vec<(f64, f64)> = Vec::new();
        for bin in one.bins.iter().filter(|bin| bin.edges.1 > bin.edges.0) {
            // A bin without pixels has no row.
            if let Some((end, _)) = points.last().copied().filter(|(end, _)| *end < bin.edges.0) {
                points.extend([(end, 0.0), (bin.edges.0, 0.0)]);
            }
            let percent = 100.0 * bin.count as f64 / pixels;
            high = high.max(percent);
            points.extend([(bin.edges.0, percent), (bin.edges.1, percent)]);
        }
        curves.push((one.place.clone(), points));
    }
    let edges = || errors.iter().flat_map(|errors| &errors.bins).map(|bin| bin.edges);
    let ends = edges().map(|(_, to)| to).fold(0.0, f64::max);
    let starts = edges().map(|(from, _)| from).fold(if is_log { ends } else { 0.0 }, f64::min);
    let label = label(request.unit);
    let x = if is_log { Axis::log(starts, ends, label) } else { Axis::new(starts, ends, label) };
    let y = Axis::new(0.0, high.max(1e-9) * 1.05, "share of pixels, %");
    let sheet = compared_curves(&curves, request.layout, (&x, &y), true);
    let ratio = if is_log { ", logarithmic bins" } else { "" };
    let mut about = about(&format!("Histogram of the {}{ratio}", what(request.unit)), &errors, frames);
    if outside > 0.0005 {
        let (from, to, outside) = (written(x.low, request), written(x.high, request), 100.0 * outside);
        about.push_str(&format!(
            "; the bins cover {from} to {to} (up to {outside:.1} % of an estimate's pixels are outside)"
        ));
    }
    request.figure(sheet, about, grid.csv())
}

/// Cumulative error distribution.
pub(super) fn cdf(runs: &[FigureRun<'_>], request: &FigureRequest, watch: &Watch<'_>) -> Result<Figure, AnalysisError> {
    let percentiles: Vec<f64> = (0..=100).map(f64::from).collect();
    let inquiry = Inquiry { bins: Some(one_bin()), percentiles: percentiles.clone(), ..request.inquiry() };
    let (errors, grid, frames) = read_errors(runs, request, inquiry, watch)?;
    let curve = |errors: &Errors| {
        let percentiles_of_errors = errors.bins.first().map_or(&[][..], |bin| &bin.percentiles);
        (errors.place.clone(), percentiles_of_errors.iter().copied().zip(percentiles.iter().copied()).collect())
    };
    let curves: Vec<Curve> = errors.iter().map(curve).collect();
    let shown = curves.iter().filter_map(|(_, points)| points.get(SHOWN_PERCENT as usize)).map(|(error, _)| *error);
    let top = request.y_max.unwrap_or_else(|| shown.fold(0.0, f64::max).max(1e-9));
    let (x, y) = (Axis::new(0.0, top, label(request.unit)), Axis::new(0.0, 100.0, "share of pixels, %"));
    let sheet = compared_curves(&curves, request.layout, (&x, &y), false);
    let mut about = about(&format!("Cumulative distribution of the {}", what(request.unit)), &errors, frames);
    // Some errors are beyond the end of the axis.
    let beyond = curves.iter().map(|(_, points)| 100.0 - percent_at(points, top)).fold(0.0, f64::max);
    if beyond > 0.05 {
        let top = written(top, request);
        about.push_str(&format!("; the axis ends at {top} (up to {beyond:.1} % of an estimate's pixels are beyond)"));
    }
    request.figure(sheet, about, grid.csv())
}

/// The percentage of a curve's pixels with at most this error.
fn percent_at(points: &[(f64, f64)], error: f64) -> f64 {
    match points.partition_point(|(own, _)| *own <= error) {
        0 => 0.0,
        all if all == points.len() => 100.0,
        above => {
            let ((from, percent), (to, _)) = (points[above - 1], points[above]);
            percent + (error - from) / (to - from)
        }
    }
}

/// One bin for all samples.
fn one_bin() -> Bins {
    Bins::Edges(vec![0.0, 1e9])
}

/// An error with three significant digits, and its unit.
fn written(value: f64, request: &FigureRequest) -> String {
    let rounded = format!("{value:.2e}").parse::<f64>().unwrap_or(value);
    format!("{rounded}{}", if request.unit == Unit::Metres { " m" } else { "" })
}

pub(super) fn about(what: &str, errors: &[Errors], frames: usize) -> String {
    let each = errors.first().is_none_or(|errors| errors.set != SampleSet::Common);
    let whose = if each { "each of them" } else { "all of them" };
    format!("{what}, over the pixels that are valid in {whose} on {}", counted(frames, "frame"))
}

pub(super) fn what(unit: Unit) -> &'static str {
    match unit {
        Unit::Metres => "absolute error",
        Unit::OfTruth => "absolute error as a share of the ground-truth distance",
    }
}

pub(super) fn label(unit: Unit) -> &'static str {
    match unit {
        Unit::Metres => "absolute error |y − t|, m",
        Unit::OfTruth => "relative error |y − t| / t",
    }
}
