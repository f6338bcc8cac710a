//! Errors against distance or confidence, as in `analyse`.

use depthloom_figures::{Bin, Scale, Spread, SpreadFigure};

use super::error_bins::{ErrorBin, Errors, Watch, read_errors};
use super::errors::{about, label, what};
use super::{Figure, FigureKind, FigureRequest, FigureRun};
use crate::error::AnalysisError;
use crate::query::{Bins, By, Inquiry, SampleSet, Unit};

pub(super) fn spreads(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    watch: &Watch<'_>,
) -> Result<Figure, AnalysisError> {
    let by = match (request.kind, &request.by) {
        (_, Some(by)) => By::parse(by),
        (FigureKind::Reliability, None) => By::Weight,
        _ => By::Distance,
    };
    let (by_words, x_label) = match &by {
        By::Distance => ("ground-truth distance", "ground-truth distance t, m"),
        By::Estimate => ("estimated distance", "estimated distance y, m"),
        By::Weight => ("confidence", "confidence"),
        By::Row => ("image row", "image row, px"),
        By::Column => ("image column", "image column, px"),
        By::Error if request.unit == Unit::OfTruth => ("relative error", "relative error"),
        By::Error => ("absolute error", "absolute error, m"),
        By::Named(name) => (name.as_str(), name.as_str()),
        By::Frame => {
            let help = "`depthloom figure RUN frames` shows a metric on every frame";
            return Err(AnalysisError::request(
                "this figure does not support `--by frame`".to_owned(),
                help.to_owned(),
            ));
        }
    };
    // The pixels that are valid in all estimates, and additionally the valid pixels of each.
    let sets = request.set.map_or_else(|| vec![SampleSet::Common, SampleSet::Valid], |set| vec![set]);
    let inquiry = Inquiry { by: by.clone(), bins: request.bins.clone(), sets, ..request.inquiry() };
    let (mut errors, grid, frames) = read_errors(runs, request, inquiry, watch)?;
    let is_shared = errors.iter().any(|one| one.set == SampleSet::Common && one.bins.iter().any(|bin| bin.count > 0));
    errors.retain(|one| is_shared || one.set == SampleSet::Valid);
    let (compared, valid): (Vec<Errors>, Vec<Errors>) =
        errors.into_iter().partition(|one| (one.set == SampleSet::Common) == is_shared);
    let spread = |one: &Errors| Spread {
        place: one.place.clone(),
        bins: bins(&one.bins),
        valid: valid.iter().find(|other| other.place == one.place).map_or_else(Vec::new, |other| bins(&other.bins)),
    };
    let figure = SpreadFigure {
        spreads: compared.iter().map(spread).collect(),
        truth: pixels(if is_shared { &valid } else { &compared }),
        compared: if is_shared { pixels(&compared) } else { Vec::new() },
        layout: request.layout,
        labels: [x_label.to_owned(), label(request.unit).to_owned()],
        scale: if matches!(request.bins, Some(Bins::Log(_))) { Scale::Log } else { Scale::Linear },
        thin: request.min_count,
        most: request.y_max,
    };
    let what = what(request.unit).replacen('a', "A", 1);
    let about = about(&format!("{what} by {by_words}"), &compared, frames);
    let thin = match figure.has_thin() {
        true => format!("; bins with fewer than {} pixels are dotted", request.min_count),
        false => String::new(),
    };
    let about = format!("{about}: median, 25 to 75 % and 5 to 95 %{thin}");
    request.figure(figure.sheet(), about, grid.csv())
}

fn bins(bins: &[ErrorBin]) -> Vec<Bin> {
    let bin = |bin: &ErrorBin| {
        let percentiles = bin.percentiles.as_slice().try_into().ok()?;
        Some(Bin { from: bin.edges.0, to: bin.edges.1, count: bin.count, percentiles })
    };
    bins.iter().filter_map(bin).collect()
}

/// Pixels by bin. Each group counts once, regardless of its number of estimates.
fn pixels(errors: &[Errors]) -> Vec<(f64, f64, u64)> {
    let is_first = |at: &usize| errors[..*at].iter().all(|other| other.place.group != errors[*at].place.group);
    let firsts = (0..errors.len()).filter(is_first).flat_map(|at| &errors[at].bins);
    firsts.map(|bin| (bin.edges.0, bin.edges.1, bin.pixels)).collect()
}
