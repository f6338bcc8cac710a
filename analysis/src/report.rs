//! Everything a run's folder says of its recording.

mod figure;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use depthloom_graphs::plan::RunId;
use depthloom_graphs::{Key, counted};
use depthloom_recording::Recording;

use crate::ablation::{Ablation, Ranking, ScoreTable, Selection, TableRow, source_of};
use crate::curves::{CurveEnd, LearningCurve, figure as figure_of, learning_curves, table_of_points};
use crate::distance::{DistanceBin, Distances, FARTHEST_M, RecordedSamples, distances};
use crate::error::{AnalysisError, caught};
use crate::estimates::{Estimate, estimates};
use crate::files::Output;
use crate::input::condition::{self, Findings, RecordingCondition};
use crate::input::maps::{not_recorded, sparsely_kept};
use crate::input::reading;
use crate::input::unscored::Unscored;
use crate::scores::{incomplete_frames, table_of_scores};
use crate::statistics::Resampling;
use crate::tables::{Table, plan_key};

use figure::{Figure, render};

/// Columns of text of a terminal's table.
const TERMINAL_WIDTH: usize = 110;

/// So many variants stand in columns, as in Table I; of more, each is a row.
const MOST_IN_COLUMNS: usize = 12;
/// So many rows are printed then, and in LaTeX.
const PRINTED: usize = 20;
/// What is printed below them.
const MORE: &str = "\nmore: `depthloom table RUN` has all rows; `--effects SCORE` says what each axis did, `--best-per-zone SCORE` which is best where\n";
/// Rows of scores that are put into the form of a table at a time, and a row group of the Parquet file.
const ROWS_AT_ONCE: usize = 1 << 12;

/// What a report shows, and what it may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportOptions {
    /// Whether the paper's numbers stand beside ours.
    pub paper: bool,
    /// How frames are resampled for an interval beside each number of the table; `None`: there are none.
    pub intervals: Option<Resampling>,
    /// Whether bytes are checked, too, that no number comes from.
    pub check_every_byte: bool,
    /// How many samples of the error against distance are held in memory at most, of 4 to 8 bytes. More are in a
    /// temporary file; the numbers are the same to the bit.
    pub samples_in_memory: usize,
}

impl Default for ReportOptions {
    /// Without the paper's numbers; what is read is checked; 8 MiB of samples at worst: few, so that memory is the same
    /// from the first hundred frames on (beyond, a file costs about as much time).
    fn default() -> Self {
        Self { paper: false, intervals: None, check_every_byte: false, samples_in_memory: 1 << 20 }
    }
}

/// What a report found.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// The table for a terminal, if a frame was scored; what is missing, and why, under it.
    pub text: String,
    /// The name of the experiment.
    pub experiment: String,
    /// In what condition the recording is.
    pub recording: RecordingCondition,
    /// The rows of the table, one an estimate and pixel set; none if there is no table.
    pub rows: Vec<TableRow>,
    /// Where each learning curve ended.
    pub curve_ends: Vec<CurveEnd>,
    /// What is missing, and why.
    pub notes: Vec<String>,
    /// Whether a frame was scored: whether there are `scores.*`.
    pub scored: bool,
    /// Whether there is a mean to show: whether there are `table.*`.
    pub table: bool,
    /// Whether frames were scored, and not one pixel of them counted: the truth and the score's limits do not go
    /// together.
    pub no_pixel_counted: bool,
    /// Whether maps were kept to compare: whether there are `error_vs_distance.*` and `true_distances.csv`.
    pub distances: bool,
    /// How many learning curves there are.
    pub learning_curves: usize,
    /// Whether bytes of the recording are not what was written; no number comes from there.
    pub is_damaged: bool,
    /// What else was found, for the [page](crate::write_page).
    pub(crate) found: Found,
}

/// What was found, as it is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Found {
    pub(crate) table: Option<ScoreTable>,
    pub(crate) bins: Vec<DistanceBin>,
    /// Scored pixels with ground truth by metre.
    pub(crate) truth: BTreeMap<u32, u64>,
    pub(crate) curves: Vec<LearningCurve>,
}

/// Analyses a recording and writes into `folder`: if something was scored, `scores.{csv,parquet}` and
/// `table.{csv,md,tex,parquet}`; if its maps were kept, `error_vs_distance.{csv,parquet,svg}` and `true_distances.csv`;
/// if something learned, `learning_curves.{csv,parquet,svg}`.
///
/// Every file is written under another name first and renamed once it is on the disk. Equal recordings give equal
/// files. `stop` is asked between frames and between files, on several threads.
///
/// # Errors
/// If the recording cannot be read, or is damaged where a number would come from, or a file cannot be written;
/// [`AnalysisError::Stopped`] once `stop` says so.
pub fn report(
    recording: &Recording,
    folder: &Path,
    options: &ReportOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Summary, AnalysisError> {
    report_with(recording, folder, options, Prepared::default(), stop)
}

/// What a run has at hand when its recording is finished, and its report need not compute from the recorded maps.
#[derive(Default)]
pub struct Prepared<'a> {
    /// Samples that were taken while frames were recorded.
    pub samples: Option<RecordedSamples<'a>>,
    /// The folders of the earlier runs whose values were reused. The error against distance of equal maps is taken from
    /// their reports.
    pub reports: Vec<PathBuf>,
}

/// As [`report`], with the same result. What is [prepared](Prepared) is not computed again.
///
/// # Errors
/// As [`report`].
pub fn report_with(
    recording: &Recording,
    folder: &Path,
    options: &ReportOptions,
    prepared: Prepared<'_>,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Summary, AnalysisError> {
    caught(|| analyse(recording, options, Output { folder, stop }, prepared))
}

fn analyse(
    recording: &Recording,
    options: &ReportOptions,
    output: Output<'_>,
    prepared: Prepared<'_>,
) -> Result<Summary, AnalysisError> {
    let plan = recording.plan();
    let estimates = estimates(plan)?;
    let mut written = Vec::new();
    let Scored { table, scored, unscored, incomplete } = write_scores(recording, &estimates, options, output)?;
    written.extend(scored.then_some("scores.*"));
    written.extend(table.is_some().then_some("table.*"));
    let found = write_distances(recording, &estimates, options, output, prepared)
        .map_err(|error| error.but_whole(&written, output.folder))?;
    let (distances, truth) = (!found.bins.is_empty(), found.truth_of_all());
    let Distances { bins, beyond, .. } = found;
    written.extend(distances.then_some("error_vs_distance.*"));
    let curves = learning_curves(recording).map_err(|error| error.but_whole(&written, output.folder))?;
    write_curves(&curves, &plan_key(plan), output)?;
    let damage = if options.check_every_byte { recording.damage(output.stop) } else { Vec::new() };
    output.go_on()?;

    let Findings { recording: condition, mut notes, is_damaged } =
        condition::findings(recording, &damage, scored || !curves.is_empty());
    match (estimates.is_empty(), scored, &table) {
        (true, ..) => notes.insert(0, "nothing was scored: no stage has a `score:`".to_owned()),
        (_, false, _) => notes.insert(0, "no table: no frame was scored".to_owned()),
        (_, _, None) if unscored.everything => notes.insert(0, "no table: no pixel was scored".to_owned()),
        (_, _, None) => notes.insert(0, "no table: no frame has the scores of all estimates of its stage".to_owned()),
        _ => {}
    }
    let unscored_everything = unscored.everything;
    notes.extend(unscored.note);
    notes.extend(incomplete);
    if options.paper && estimates.iter().any(|e| e.lead.variant.is_none() && e.name != "stereo") {
        notes.push(
            "the paper's numbers beside estimates that no variant changes are those of its method `full`".to_owned(),
        );
    }
    // Disparities have none; and of frames that all lack their truth more is said above.
    if scored || !unscored_everything {
        let of_depths: Vec<&Estimate> = estimates.iter().filter(|of| of.settings.is_some()).collect();
        notes.extend(not_recorded(plan, &of_depths, "no error against distance"));
        notes.extend(sparsely_kept(recording, &of_depths, !distances));
    }
    for (estimate, beyond) in estimates.iter().zip(&beyond).filter(|(_, beyond)| **beyond > 0) {
        let label = &estimate.label;
        notes.push(format!("error against distance of {label} leaves out {beyond} pixels beyond {FARTHEST_M} m"));
    }
    let failed: usize =
        RunId::all(plan.runs.len()).flat_map(|run| recording.frames(run)).filter(|f| !f.failures.is_empty()).count();
    if failed > 0 {
        let frames = counted(failed, "frame");
        notes.push(format!("{frames} failed somewhere; means are over the frames all estimates have"));
    }
    let mut text = table.as_ref().map_or_else(String::new, |(_, text)| text.clone());
    for note in &notes {
        text.push_str(&format!("note: {note}\n"));
    }
    Ok(Summary {
        text,
        experiment: plan.experiment.clone(),
        recording: condition,
        rows: table.as_ref().map_or_else(Vec::new, |(table, _)| table.json_rows()),
        curve_ends: curves.iter().map(LearningCurve::end).collect(),
        notes,
        scored,
        table: table.is_some(),
        no_pixel_counted: unscored_everything,
        distances,
        learning_curves: curves.len(),
        is_damaged,
        found: Found { table: table.map(|(table, _)| table), bins, truth, curves },
    })
}

/// What came of the scores.
#[derive(Default)]
struct Scored {
    /// The table of their means, and as text, if there is a mean.
    table: Option<(ScoreTable, String)>,
    /// Whether there are scores.
    scored: bool,
    /// The frames without one.
    unscored: Unscored,
    /// What is to be said of frames on which an estimate is missing.
    incomplete: Vec<String>,
}

/// Writes the scores by frame, if there are any, and the table of their means.
fn write_scores(
    recording: &Recording,
    estimates: &[Estimate],
    options: &ReportOptions,
    output: Output<'_>,
) -> Result<Scored, AnalysisError> {
    let plan = recording.plan();
    let scores = reading::scores(recording, estimates, output.stop)?;
    let (unscored, run) = (Unscored::of(recording, estimates, &scores)?, plan_key(plan));
    if scores.is_empty() {
        return Ok(Scored { unscored, ..Scored::default() });
    }
    let incomplete = incomplete_frames(recording, estimates, &scores);
    let parts = || scores.chunks(ROWS_AT_ONCE).map(|rows| table_of_scores(rows, estimates));
    output.write_table_in_parts("scores", &run, parts)?;
    let source = source_of(recording);
    let (ablation, all) = (Ablation::new(plan, estimates, &scores, &source, None), Selection::default());
    let rows = ablation.rows_on_all_sets(&all)?;
    if rows.iter().all(|row| row.frames == 0) {
        return Ok(Scored { table: None, scored: true, unscored, incomplete });
    }
    let scores = ScoreTable::new(&ablation, &rows, &all, options.paper, options.intervals, output.stop)?;
    let table = Table { label: plan.experiment.clone(), ..scores.table() };
    output.write_table("table", &run, &table)?;
    // Of many variants each is a row, and the best of them are printed.
    let (all, printed, more) = match plan.variants.len() > MOST_IN_COLUMNS && !options.paper {
        true => {
            let ranked = |top: Option<usize>| {
                let ranking = Ranking { top, intervals: options.intervals, ..Ranking::default() };
                ranking.table(&ablation, &all, output.stop)
            };
            (ranked(None)?, ranked(Some(PRINTED))?, MORE)
        }
        false => (table.clone(), table, ""),
    };
    output.write("table.md", all.markdown().as_bytes())?;
    output.write("table.tex", printed.latex().as_bytes())?;
    let text = format!("{}{more}", printed.terminal(TERMINAL_WIDTH));
    Ok(Scored { table: Some((scores, text)), scored: true, unscored, incomplete })
}

/// Writes the error against distance, if there are maps to compare.
fn write_distances(
    recording: &Recording,
    estimates: &[Estimate],
    options: &ReportOptions,
    output: Output<'_>,
    Prepared { samples, reports }: Prepared<'_>,
) -> Result<Distances, AnalysisError> {
    let in_memory = options.samples_in_memory;
    let (distances, table) = distances(recording, estimates, in_memory, samples, &reports, output)?;
    if distances.bins.is_empty() {
        return Ok(distances);
    }
    output.write_table("error_vs_distance", &plan_key(recording.plan()), &table)?;
    output.write_csv("true_distances.csv", &distances.table_of_truth(recording.plan()))?;
    let figure = Figure { estimates, bins: &distances.bins, truth: &distances.truth_of_all() };
    output.write("error_vs_distance.svg", render(&figure).as_bytes())?;
    Ok(distances)
}

/// Writes the points of the learning curves and their figure, if there are any.
fn write_curves(curves: &[LearningCurve], run: &Key, output: Output<'_>) -> Result<(), AnalysisError> {
    if curves.is_empty() {
        return Ok(());
    }
    output.write_table("learning_curves", run, &table_of_points(curves))?;
    output.write("learning_curves.svg", figure_of(curves).as_bytes())
}
