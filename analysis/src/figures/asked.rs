//! What figures of errors ask of samples: the rows that `depthloom analyse` has, by estimator.

use super::{FigureRequest, FigureRun};
use crate::analyse::{Inquiry, SampleSet, answered};
use crate::error::AnalysisError;
use crate::grid::Grid;
use depthloom_figures::Place;

/// An estimator's rows.
pub(super) struct Asked {
    pub(super) of: Place,
    pub(super) set: SampleSet,
    pub(super) rows: Vec<Row>,
}

/// A bin of an estimator.
pub(super) struct Row {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) pixels: u64,
    pub(super) count: u64,
    /// Those that were asked for; empty where there is no answer.
    pub(super) percentiles: Vec<f64>,
}

/// What stands in the way of a figure's progress and end.
pub(super) struct Watch<'a> {
    pub(super) progress: &'a (dyn Fn(u64, u64) + Sync),
    pub(super) stop: &'a (dyn Fn() -> bool + Sync),
}

/// Asks the samples of runs; gives the table that `analyse` gives, too, and how many frames these are of.
pub(super) fn ask(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    inquiry: &Inquiry,
    watch: &Watch<'_>,
) -> Result<(Vec<Asked>, Grid, usize), AnalysisError> {
    let files: Vec<_> =
        runs.iter().filter_map(|run| Some((run.called.to_owned(), run.samples.as_ref()?.clone()))).collect();
    let inquiry = Inquiry {
        estimators: request.estimators.clone(),
        variants: request.variants.clone(),
        stages: request.stages.clone(),
        ..inquiry.clone()
    };
    let (grid, _, frames) = answered(&files, &inquiry, watch.progress, watch.stop)?;
    Ok((by_estimator(&grid, &inquiry), grid, frames))
}

fn by_estimator(grid: &Grid, inquiry: &Inquiry) -> Vec<Asked> {
    let text = |name: &str, row: usize| grid.text_of(name, row).unwrap_or_default();
    let number = |names: &[&str], row: usize| names.iter().find_map(|name| grid.number_of(name, row));
    let several = |name: &str| (1..grid.height()).any(|row| text(name, row) != text(name, 0));
    let groups: Vec<&str> = ["run", "stage", "scoring"].into_iter().filter(|name| several(name)).collect();
    let suffix = if inquiry.unit == crate::analyse::Unit::Metres { ("", "_m") } else { ("relative_", "") };
    let names: Vec<String> =
        inquiry.percentiles.iter().map(|percentile| format!("{}error_p{percentile}{}", suffix.0, suffix.1)).collect();
    let mut found: Vec<Asked> = Vec::new();
    for row in 0..grid.height() {
        let of = Place {
            name: text("estimator", row),
            group: groups.iter().map(|name| text(name, row)).collect::<Vec<_>>().join(" "),
            variant: grid.text_of("variant", row),
        };
        let set = if text("set", row) == SampleSet::Common.name() { SampleSet::Common } else { SampleSet::Answered };
        let count = number(&["count"], row).unwrap_or(0.0) as u64;
        let values = Row {
            from: number(&["bin_from_m", "bin_from_px", "bin_from", "position"], row).unwrap_or(0.0),
            to: number(&["bin_to_m", "bin_to_px", "bin_to"], row).unwrap_or(0.0),
            pixels: number(&["pixels"], row).unwrap_or(0.0) as u64,
            count,
            percentiles: names.iter().filter_map(|name| grid.number_of(name, row)).collect(),
        };
        match found.iter_mut().find(|known| known.of == of && known.set == set) {
            Some(known) => known.rows.push(values),
            None => found.push(Asked { of, set, rows: vec![values] }),
        }
    }
    found
}
