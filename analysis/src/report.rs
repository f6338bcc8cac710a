//! Everything a run's folder says of its recording.

use std::path::Path;

use depthloom_recording::{Condition, Recording};
use serde_json::{Map, Value as Json, json};

use crate::curves::{LearningCurve, learning_curves, table_of_points};
use crate::distance::{FARTHEST_M, table_of_bins};
use crate::error::{AnalysisError, caught};
use crate::estimators::{Estimator, estimators};
use crate::figure::{Figure, render};
use crate::files::Output;
use crate::reading;
use crate::scores::table_of_scores;
use crate::table::Table;

/// Columns of text of a terminal's table.
const TERMINAL_WIDTH: usize = 110;

/// What a report shows, and what it may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReportOptions {
    /// Whether the paper's numbers stand beside ours.
    pub paper: bool,
    /// How many samples of the error against distance are held in memory at most: 4 to 8 bytes each. What is more lies in a
    /// temporary file meanwhile; the numbers are the same to the bit.
    pub samples_in_memory: usize,
}

impl Default for ReportOptions {
    /// Without the paper's numbers; 4 MiB of samples at worst: few, so that memory is the same from the first hundred frames on
    /// (beyond, a file costs about as much time).
    fn default() -> Self {
        Self { paper: false, samples_in_memory: 1 << 19 }
    }
}

/// What a report found.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// The table for a terminal; what is missing, and why, under it.
    pub text: String,
    /// The same for programs: `recording` (its `condition`, `frames`, and in words what is wrong), `table` (a row an estimator and
    /// pixel set), `learning_curves` (where each ended), `notes`.
    pub json: Json,
    /// Whether something was scored: whether there are `scores.csv` and `table.*`.
    pub scored: bool,
    /// Whether maps were kept to compare: whether there are `error_vs_distance.*` and `true_distances.csv`.
    pub distances: bool,
    /// How many learning curves there are.
    pub learning_curves: usize,
}

/// Analyses a recording and writes into `folder`: if something was scored, `scores.csv` and `table.{csv,md,tex,parquet}`; if its
/// maps were kept, `error_vs_distance.{csv,parquet,svg}` and `true_distances.csv`; if something learned,
/// `learning_curves.{csv,parquet,svg}`.
///
/// Every file is written under another name first and renamed once it is on the disk. Equal recordings give equal files. `stop`
/// is asked between frames and between files, on several threads.
///
/// # Errors
/// If the recording cannot be read or a file not be written; [`AnalysisError::Stopped`] once `stop` says so.
pub fn report(
    recording: &Recording,
    folder: &Path,
    options: &ReportOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Summary, AnalysisError> {
    caught(|| analyse(recording, options, Output { folder, stop }))
}

fn analyse(recording: &Recording, options: &ReportOptions, output: Output<'_>) -> Result<Summary, AnalysisError> {
    let plan = recording.plan();
    let estimators = estimators(plan)?;
    let curves = learning_curves(recording)?;
    write_curves(&curves, output)?;
    let ends: Vec<Json> = curves.iter().map(LearningCurve::end).collect();
    let (condition, told) = condition(recording);
    if estimators.is_empty() {
        let mut notes = vec!["nothing was scored: no stage has a `score:`".to_owned()];
        notes.extend(told);
        let text = notes.iter().map(|note| format!("{note}\n")).collect();
        let json = json!({ "recording": condition, "table": [], "learning_curves": ends, "notes": notes });
        return Ok(Summary { text, json, scored: false, distances: false, learning_curves: curves.len() });
    }
    // The rows go before the samples come: what grows with the number of frames is never held beside them.
    let table = {
        let scores = reading::scores(recording, &estimators, output)?;
        output.write_csv("scores.csv", &table_of_scores(&scores, &estimators))?;
        let source = |run: usize, position: usize| recording.frames(run).get(position).and_then(|f| f.source_key);
        Table::new(&plan.experiment, &scores, &estimators, options.paper, &source)
    };
    output.write_csv("table.csv", &table.long_form())?;
    output.write_parquet("table.parquet", table.long_form())?;
    output.write("table.md", table.markdown().as_bytes())?;
    output.write("table.tex", table.latex().as_bytes())?;

    let distances = reading::distances(recording, &estimators, options.samples_in_memory, output)?;
    if !distances.bins.is_empty() {
        let bins = || table_of_bins(&distances.bins, &estimators);
        output.write_csv("error_vs_distance.csv", &bins())?;
        output.write_parquet("error_vs_distance.parquet", bins())?;
        output.write_csv("true_distances.csv", &distances.table_of_truth())?;
        let figure = Figure { estimators: &estimators, bins: &distances.bins, truth: &distances.truth };
        output.write("error_vs_distance.svg", render(&figure).as_bytes())?;
    }

    let mut notes: Vec<String> = told.into_iter().chain(estimators.iter().filter_map(without_maps)).collect();
    notes.extend(sparsely_kept(recording, &estimators, distances.bins.is_empty()));
    for (estimator, beyond) in estimators.iter().zip(&distances.beyond).filter(|(_, beyond)| **beyond > 0) {
        let label = &estimator.label;
        notes.push(format!("error against distance of {label} leaves out {beyond} pixels beyond {FARTHEST_M} m"));
    }
    let failed: usize =
        (0..plan.runs.len()).flat_map(|run| recording.frames(run)).filter(|f| !f.failures.is_empty()).count();
    if failed > 0 {
        let frames = if failed == 1 { "frame" } else { "frames" };
        notes.push(format!("{failed} {frames} failed somewhere; means are over the frames all estimators have"));
    }
    let mut text = table.terminal(TERMINAL_WIDTH);
    for note in &notes {
        text.push_str(&format!("note: {note}\n"));
    }
    let json = json!({
        "experiment": plan.experiment,
        "recording": condition,
        "table": rows(&table),
        "learning_curves": ends,
        "notes": notes,
    });
    let distances = !distances.bins.is_empty();
    Ok(Summary { text, json, scored: true, distances, learning_curves: curves.len() })
}

/// What an estimator lacks to be compared pixel by pixel, if anything.
fn without_maps(estimator: &Estimator) -> Option<String> {
    let truth = match &estimator.truth {
        Some(from) => format!("the truth `{}`", from.trim_start_matches('/')),
        None => "the truth".to_owned(),
    };
    let missing = match (&estimator.estimate_topic, &estimator.truth_topic) {
        (Some(_), Some(_)) => return None,
        (Some(_), None) => format!("{truth} was not recorded: add it to `record:`"),
        (None, Some(_)) => "the estimate was not recorded: add it to `record:`".to_owned(),
        (None, None) => format!("neither the estimate nor {truth} was recorded: add both to `record:`"),
    };
    Some(format!("no error against distance of {}: {missing}", estimator.label))
}

/// That not every frame kept its maps, or that none did; nothing is said where no maps were to be kept.
fn sparsely_kept(recording: &Recording, estimators: &[Estimator], none: bool) -> Option<String> {
    let every = recording.plan().every;
    if !none {
        let note = |ordinal: String| {
            format!("error against distance is of every {ordinal} frame: only their maps were recorded")
        };
        return (every > 1).then(|| note(ordinal(every)));
    }
    let mut with_maps = estimators.iter().filter(|e| e.estimate_topic.is_some() && e.truth_topic.is_some());
    let of = match every {
        0 | 1 => "no frame has".to_owned(),
        every => format!("maps were recorded of every {} frame only, and none of these has", ordinal(every)),
    };
    let note = || format!("no error against distance: {of} a pixel with both a truth and an answer");
    with_maps.any(|estimator| !recording.frames(estimator.run).is_empty()).then(note)
}

/// In what condition the recording is, for programs, and for people if it is not whole.
fn condition(recording: &Recording) -> (Json, Option<String>) {
    let frames: usize = (0..recording.plan().runs.len()).map(|run| recording.frames(run).len()).sum();
    let condition = recording.condition();
    let mut json = json!({ "condition": condition.name(), "frames": frames });
    if *condition == Condition::Whole {
        return (json, None);
    }
    json["what"] = condition.to_string().into();
    let s = if frames == 1 { "" } else { "s" };
    (json, Some(format!("the recording is {condition}; all numbers are of its {frames} whole frame{s}")))
}

/// Writes the points of the learning curves and their figure, if there are any.
fn write_curves(curves: &[LearningCurve], output: Output<'_>) -> Result<(), AnalysisError> {
    if curves.is_empty() {
        return Ok(());
    }
    output.write_csv("learning_curves.csv", &table_of_points(curves))?;
    output.write_parquet("learning_curves.parquet", table_of_points(curves))?;
    output.write("learning_curves.svg", crate::curves::render(curves).as_bytes())
}

/// `2nd`, `3rd`, `11th`.
fn ordinal(number: u64) -> String {
    let ending = match (number % 100, number % 10) {
        (11..=13, _) => "th",
        (_, 1) => "st",
        (_, 2) => "nd",
        (_, 3) => "rd",
        _ => "th",
    };
    format!("{number}{ending}")
}

/// The table's columns as objects.
fn rows(table: &Table) -> Vec<Json> {
    let scores = |values: [Option<f64>; 8]| -> Map<String, Json> {
        let named = depthloom_scores::SCORE_NAMES.into_iter().zip(values);
        named.map(|(name, value)| (name.to_owned(), value.into())).collect()
    };
    let row = |column: &crate::TableColumn| {
        let mut row = Map::new();
        row.insert("estimator".to_owned(), column.estimator.clone().into());
        row.insert("scored_on".to_owned(), column.set.name().into());
        row.insert("frames".to_owned(), column.frames.into());
        row.extend(scores(column.means));
        if let Some(paper) = column.paper {
            row.insert("paper".to_owned(), scores(paper.map(Some)).into());
        }
        Json::Object(row)
    };
    table.columns.iter().map(row).collect()
}
