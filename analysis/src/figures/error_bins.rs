//! The errors of a figure, read from samples: the rows of `depthloom analyse`, by estimate.

use depthloom_figures::{Place, distinct};

use super::{FigureRequest, FigureRun};
use crate::error::AnalysisError;
use crate::query::{Inquiry, SampleSet, Unit, analyse_frames};
use crate::tables::Table;
use crate::titles::Titles;

/// The bins of an estimate over a pixel set.
pub(super) struct Errors {
    pub(super) place: Place,
    pub(super) set: SampleSet,
    pub(super) bins: Vec<ErrorBin>,
}

/// A bin with the percentiles of the query; empty without valid pixels.
pub(super) struct ErrorBin {
    pub(super) edges: (f64, f64),
    pub(super) pixels: u64,
    pub(super) count: u64,
    pub(super) percentiles: Vec<f64>,
}

/// The callbacks of a figure: progress and stop.
pub(super) struct Watch<'a> {
    pub(super) progress: &'a (dyn Fn(u64, u64) + Sync),
    pub(super) stop: &'a (dyn Fn() -> bool + Sync),
}

/// Reads the errors of runs from samples: by estimate, as the table of `analyse`, and the number of frames.
pub(super) fn read_errors(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    inquiry: Inquiry,
    watch: &Watch<'_>,
) -> Result<(Vec<Errors>, Table, usize), AnalysisError> {
    let files: Vec<_> =
        runs.iter().filter_map(|run| Some((run.called.to_owned(), run.samples.as_ref()?.clone()))).collect();
    let (estimates, variants, stages) = (request.estimates.clone(), request.variants.clone(), request.stages.clone());
    let inquiry = Inquiry { estimates, variants, stages, ..inquiry };
    let (grid, _, frames) = analyse_frames(&files, &inquiry, watch.progress, watch.stop)?;
    let titles = Titles::new(runs.iter().map(|run| run.recording.plan()));
    Ok((by_estimate(&grid, &inquiry, &titles), grid, frames))
}

fn by_estimate(grid: &Table, inquiry: &Inquiry, titles: &Titles) -> Vec<Errors> {
    let text = |name: &str, row: usize| grid.text_of(name, row).unwrap_or_default();
    let number = |names: &[&str], row: usize| names.iter().find_map(|name| grid.number_of(name, row)).unwrap_or(0.0);
    let several = |name: &&str| (1..grid.height()).any(|row| text(name, row) != text(name, 0));
    let groups: Vec<&str> = ["run", "stage", "scoring"].into_iter().filter(several).collect();
    let (before, after) = if inquiry.unit == Unit::Metres { ("", "_m") } else { ("relative_", "") };
    let key = |row: usize| {
        let group = distinct(groups.iter().map(|name| text(name, row))).join(" ");
        let place = titles.place(text("estimate", row), group, grid.text_of("variant", row));
        (place, text("set", row) == SampleSet::Common.name())
    };
    let bin = |row: usize| ErrorBin {
        edges: (
            number(&["bin_from_m", "bin_from_px", "bin_from", "position"], row),
            number(&["bin_to_m", "bin_to_px", "bin_to"], row),
        ),
        pixels: number(&["pixels"], row) as u64,
        count: number(&["count"], row) as u64,
        percentiles: (inquiry.percentiles.iter())
            .filter_map(|percentile| grid.number_of(&format!("{before}error_p{percentile}{after}"), row))
            .collect(),
    };
    let errors = |(place, is_common): (Place, bool)| {
        let set = if is_common { SampleSet::Common } else { SampleSet::Valid };
        let rows = (0..grid.height()).filter(|&row| key(row) == (place.clone(), is_common));
        Errors { set, bins: rows.map(bin).collect(), place }
    };
    distinct((0..grid.height()).map(key)).into_iter().map(errors).collect()
}
