//! Errors against distance, or against the weight that they were given, as `analyse` finds them.

use depthloom_figures::{Bin, Scale, Spread, SpreadFigure, added};
use depthloom_graphs::counted;

use super::asked::{Asked, Watch, ask};
use super::errors::pixels_of;
use super::{Figure, FigureKind, FigureRequest, FigureRun, Layout, wrong_size};
use crate::analyse::{Bins, By, Inquiry, SampleSet, Unit};
use crate::error::AnalysisError;

pub(super) fn of_errors(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    watch: &Watch<'_>,
) -> Result<Figure, AnalysisError> {
    let by = match (request.kind, &request.by) {
        (_, Some(by)) => By::parse(by),
        (FigureKind::Reliability, None) => By::Weight,
        _ => By::Distance,
    };
    if by == By::Frame {
        let help = "`depthloom figure RUN frames` shows a score on every frame";
        return Err(AnalysisError::asked("frames are no axis for errors".to_owned(), help.to_owned()));
    }
    // Those that all answered, and beside them what each did.
    let sets = match request.set {
        Some(set) => vec![set],
        None => vec![SampleSet::Common, SampleSet::Answered],
    };
    let inquiry = Inquiry { by: by.clone(), bins: request.bins.clone(), sets, ..request.inquiry() };
    let (mut asked, grid, frames) = ask(runs, request, &inquiry, watch)?;
    let is_shared = asked.iter().any(|of| of.set == SampleSet::Common && of.rows.iter().any(|row| row.count > 0));
    if !is_shared {
        asked.retain(|of| of.set == SampleSet::Answered);
    }
    let compared_set = if is_shared { SampleSet::Common } else { SampleSet::Answered };
    let of_set = |set: SampleSet| asked.iter().filter(move |of| of.set == set);
    let spread = |of: &Asked| Spread {
        of: of.of.clone(),
        bins: bins(of),
        answered: match is_shared {
            true => of_set(SampleSet::Answered).find(|other| other.of == of.of).map_or_else(Vec::new, bins),
            false => Vec::new(),
        },
    };
    let spreads: Vec<Spread> = of_set(compared_set).map(spread).collect();
    let figure = SpreadFigure {
        truth: counts(of_set(SampleSet::Answered)),
        compared: if is_shared { counts(of_set(SampleSet::Common)) } else { Vec::new() },
        layout: request.layout,
        title: request.title.clone(),
        x_label: x_label(&by),
        y_label: match request.unit {
            Unit::Metres => "absolute error |y − t|, m".to_owned(),
            Unit::OfTruth => "relative error |y − t| / t".to_owned(),
        },
        x_scale: if matches!(request.bins, Some(Bins::Log(_))) { Scale::Log } else { Scale::Linear },
        thin: request.thin,
        most: request.most,
        size: request.size,
        spreads,
    };
    if request.layout == Layout::Multiples {
        request.few_panels(figure.panels())?;
    }
    let drawing = figure.drawing().map_err(wrong_size)?;
    let thin = match figure.has_thin() {
        true => format!("; bins of fewer than {} pixels are dotted", request.thin),
        false => String::new(),
    };
    let what = match request.unit {
        Unit::Metres => "Absolute error",
        Unit::OfTruth => "Absolute error as a share of the true distance",
    };
    let shown: Vec<Asked> = asked.into_iter().filter(|of| of.set == compared_set).collect();
    let about = format!(
        "{what} by {}, over {} on {}: median, 25 to 75 % and 5 to 95 %{thin}",
        by_words(&by),
        pixels_of(&shown),
        counted(frames, "frame")
    );
    Ok(Figure { drawing, about, data: grid.sheet().csv(), notes: Vec::new() })
}

fn bins(of: &Asked) -> Vec<Bin> {
    let bin = |row: &super::asked::Row| {
        let percentiles = row.percentiles.as_slice().try_into().ok()?;
        Some(Bin { from: row.from, to: row.to, count: row.count, percentiles })
    };
    of.rows.iter().filter_map(bin).collect()
}

/// Pixels by bin: of each group once, whatever number of its estimators has them.
fn counts<'a>(asked: impl Iterator<Item = &'a Asked>) -> Vec<(f64, f64, u64)> {
    let mut groups: Vec<&str> = Vec::new();
    let mut all = Vec::new();
    for of in asked {
        if !groups.contains(&of.of.group.as_str()) {
            groups.push(&of.of.group);
            all.extend(of.rows.iter().map(|row| (row.from, row.to, row.pixels)));
        }
    }
    added(all)
}

fn x_label(by: &By) -> String {
    match by {
        By::Distance => "true distance t, m".to_owned(),
        By::Estimate => "estimated distance y, m".to_owned(),
        By::Weight => "weight".to_owned(),
        By::Row => "image row, px".to_owned(),
        By::Column => "image column, px".to_owned(),
        By::Error => "absolute error, m".to_owned(),
        By::Frame => "frame".to_owned(),
        By::Named(name) => name.clone(),
    }
}

fn by_words(by: &By) -> String {
    let label = x_label(by);
    let words = label.split(", ").next().unwrap_or_default();
    words.trim_end_matches(" t").trim_end_matches(" y").to_owned()
}
