//! Writes the report of a recording into the folder of its run.

mod figure;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use depthloom_graphs::plan::RunId;
use depthloom_graphs::{Key, counted};
use depthloom_recording::Recording;

use crate::ablation::{Ablation, Ranking, ScoreTable, Selection, TableRow, source_keys};
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
use crate::titles::Titles;

use figure::{Figure, render};

/// The width of tables on the terminal.
const TERMINAL_WIDTH: usize = 110;

/// The maximum number of variants that are shown as columns, as in Table I. More variants are shown as rows.
const MOST_IN_COLUMNS: usize = 12;
/// The maximum number of such rows on the terminal and in LaTeX.
const PRINTED: usize = 20;
/// The text below them.
const MORE: &str = "\nmore: `depthloom table RUN` shows all rows; `--effects METRIC` the effect of each axis, `--best-per-zone METRIC` the best row of each zone\n";
/// The number of rows of scores per part of the table, and per row group of the Parquet file.
const ROWS_AT_ONCE: usize = 1 << 12;

/// The options of a report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportOptions {
    /// Whether the table also shows the published numbers of the paper.
    pub paper: bool,
    /// The resampling of frames for an interval of each number of the table; `None`: no intervals.
    pub intervals: Option<Resampling>,
    /// Whether all bytes are checked, including those that no number depends on.
    pub check_every_byte: bool,
    /// The maximum number of samples of the error against distance in memory, of 4 to 8 bytes each. Further samples are
    /// stored in a temporary file; the numbers are identical.
    pub samples_in_memory: usize,
}

impl Default for ReportOptions {
    /// Without the published numbers; only bytes that are read are checked; at most 8 MiB of samples, so that memory
    /// use is constant after about a hundred frames (a file takes about as much time).
    fn default() -> Self {
        Self { paper: false, intervals: None, check_every_byte: false, samples_in_memory: 1 << 20 }
    }
}

/// The results of a report.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// The table for a terminal, if a frame was scored, followed by notes on missing results.
    pub text: String,
    /// The name of the experiment.
    pub experiment: String,
    /// The condition of the recording.
    pub recording: RecordingCondition,
    /// The rows of the table, one per estimate and pixel set; empty without a table.
    pub rows: Vec<TableRow>,
    /// The ends of the learning curves.
    pub curve_ends: Vec<CurveEnd>,
    /// Notes on missing results, with reasons.
    pub notes: Vec<String>,
    /// Whether a frame was scored, so that there are `scores.*`.
    pub scored: bool,
    /// Whether there are means, so that there are `table.*`.
    pub table: bool,
    /// Whether frames were scored, but no pixel counted: the ground truth does not match the limits of the score.
    pub no_pixel_counted: bool,
    /// Whether maps were recorded, so that there are `error_vs_distance.*` and `true_distances.csv`.
    pub distances: bool,
    /// The number of learning curves.
    pub learning_curves: usize,
    /// Whether bytes of the recording are damaged; no number depends on them.
    pub is_damaged: bool,
    /// Further results, for the [page](crate::write_page).
    pub(crate) data: ReportData,
}

/// The results that are drawn on the page.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ReportData {
    pub(crate) table: Option<ScoreTable>,
    pub(crate) bins: Vec<DistanceBin>,
    /// Scored pixels with ground truth by metre.
    pub(crate) truth: BTreeMap<u32, u64>,
    pub(crate) curves: Vec<LearningCurve>,
}

/// Analyses a recording and writes files into `folder`. If something was scored: `scores.{csv,parquet}` and
/// `table.{csv,md,tex,parquet}`. If maps were recorded: `error_vs_distance.{csv,parquet,svg}` and `true_distances.csv`.
/// If a network was trained: `learning_curves.{csv,parquet,svg}`.
///
/// Every file is written under a temporary name and renamed once it is on disk. Equal recordings give equal files.
/// `stop` is polled between frames and between files, on several threads.
///
/// # Errors
/// If the recording cannot be read, if damage affects a number, or if a file cannot be written;
/// [`AnalysisError::Stopped`] once `stop` returns true.
pub fn report(
    recording: &Recording,
    folder: &Path,
    options: &ReportOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Summary, AnalysisError> {
    report_with(recording, folder, options, Prepared::default(), stop)
}

/// Data that a run has already computed, so that the report need not compute it from the recorded maps.
#[derive(Default)]
pub struct Prepared<'a> {
    /// Samples that were collected during recording.
    pub samples: Option<RecordedSamples<'a>>,
    /// The folders of the earlier runs whose values were reused. The error against distance of equal maps is reused
    /// from their reports.
    pub reports: Vec<PathBuf>,
}

/// As [`report`], with the same result, but reuses [prepared](Prepared) data.
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
    let errors = write_distances(recording, &estimates, options, output, prepared)
        .map_err(|error| error.with_complete_files(&written, output.folder))?;
    let (distances, truth) = (!errors.bins.is_empty(), errors.truth_of_all());
    let Distances { bins, beyond, .. } = errors;
    written.extend(distances.then_some("error_vs_distance.*"));
    let curves = learning_curves(recording).map_err(|error| error.with_complete_files(&written, output.folder))?;
    write_curves(&curves, &plan_key(plan), output)?;
    let damage = if options.check_every_byte { recording.damage(output.stop) } else { Vec::new() };
    output.check_stop()?;

    let Findings { recording: condition, mut notes, is_damaged } =
        condition::findings(recording, &damage, scored || !curves.is_empty());
    match (estimates.is_empty(), scored, &table) {
        (true, ..) => notes.insert(0, "nothing was scored: no stage has a `score:`".to_owned()),
        (_, false, _) => notes.insert(0, "no table: no frame was scored".to_owned()),
        (_, _, None) if unscored.everything => notes.insert(0, "no table: no pixel was scored".to_owned()),
        (_, _, None) => notes.insert(0, "no table: no frame has scores of all estimates of its stage".to_owned()),
        _ => {}
    }
    let unscored_everything = unscored.everything;
    notes.extend(unscored.note);
    notes.extend(incomplete);
    if options.paper && estimates.iter().any(|e| e.row_key.variant.is_none() && e.name != "stereo") {
        notes.push(
            "estimates that no variant changes are compared with the published numbers of the method `full`".to_owned(),
        );
    }
    // Disparities have no error against distance. Frames without ground truth are reported above.
    if scored || !unscored_everything {
        let depths: Vec<&Estimate> = estimates.iter().filter(|estimate| estimate.settings.is_some()).collect();
        notes.extend(not_recorded(plan, &depths, "no error against distance"));
        notes.extend(sparsely_kept(recording, &depths, !distances));
    }
    for (estimate, beyond) in estimates.iter().zip(&beyond).filter(|(_, beyond)| **beyond > 0) {
        let label = &estimate.label;
        notes.push(format!("error against distance of {label} excludes {beyond} pixels beyond {FARTHEST_M} m"));
    }
    let failed: usize =
        RunId::all(plan.runs.len()).flat_map(|run| recording.frames(run)).filter(|f| !f.failures.is_empty()).count();
    if failed > 0 {
        let frames = counted(failed, "frame");
        notes.push(format!("{frames} failed; means cover only the frames that all estimates have"));
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
        data: ReportData { table: table.map(|(table, _)| table), bins, truth, curves },
    })
}

/// The results of the scores.
#[derive(Default)]
struct Scored {
    /// The table of their means, also as text, if there are means.
    table: Option<(ScoreTable, String)>,
    /// Whether there are scores.
    scored: bool,
    /// The frames without scores.
    unscored: Unscored,
    /// Notes on frames with missing estimates.
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
    let (unscored, run) = (Unscored::new(recording, estimates, &scores)?, plan_key(plan));
    if scores.is_empty() {
        return Ok(Scored { unscored, ..Scored::default() });
    }
    let incomplete = incomplete_frames(recording, estimates, &scores, None);
    let parts = || scores.chunks(ROWS_AT_ONCE).map(|rows| table_of_scores(rows, estimates));
    output.write_table_in_parts("scores", &run, parts)?;
    let source = source_keys(recording);
    let (ablation, all) = (Ablation::new(plan, estimates, &scores, &source, None), Selection::default());
    let rows = ablation.rows_on_all_sets(&all)?;
    if rows.iter().all(|row| row.frames == 0) {
        return Ok(Scored { table: None, scored: true, unscored, incomplete });
    }
    let scores = ScoreTable::new(&ablation, &rows, &all, options.paper, options.intervals, output.stop)?;
    let titles = Titles::new([plan]);
    let mut table = Table { label: plan.experiment.clone(), ..scores.table() };
    titles.apply(&mut table);
    output.write_table("table", &run, &table)?;
    // Many variants are shown as rows, and only the best are printed.
    let (all, printed, more) = match plan.variants.len() > MOST_IN_COLUMNS && !options.paper {
        true => {
            let ranked = |top: Option<usize>| {
                let ranking = Ranking { top, intervals: options.intervals, ..Ranking::default() };
                let mut table = ranking.table(&ablation, &all, output.stop)?;
                titles.apply(&mut table);
                Ok::<_, AnalysisError>(table)
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
    let (truth, titles) = (distances.truth_of_all(), Titles::new([recording.plan()]));
    let figure = Figure { estimates, bins: &distances.bins, truth: &truth, titles: &titles };
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
