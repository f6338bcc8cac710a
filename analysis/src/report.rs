//! Everything a run's folder says of its recording.

use std::path::Path;

use depthloom_recording::Recording;
use serde_json::{Map, Value as Json, json};

use crate::curves::{LearningCurve, learning_curves, table_of_points};
use crate::distance::table_of_bins;
use crate::error::AnalysisError;
use crate::estimators::estimators;
use crate::figure::{Figure, render};
use crate::files;
use crate::reading;
use crate::scores::table_of_scores;
use crate::table::Table;

/// How many samples of the error against distance are held in memory at most: 4 to 8 bytes each, so 4 MiB at worst: few, so
/// that memory is the same from the first hundred frames on (beyond, counting over files costs about as much time).
const SAMPLES_IN_MEMORY: usize = 1 << 19;
/// Columns of text of a terminal's table.
const TERMINAL_WIDTH: usize = 110;

/// What a report shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReportOptions {
    /// Whether the paper's numbers stand beside ours.
    pub paper: bool,
}

/// What a report found.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// The table for a terminal; what is missing, and why, under it.
    pub text: String,
    /// The same for programs: `table` (a row an estimator and pixel set), `learning_curves` (where each ended), `notes`.
    pub json: Json,
    /// How many learning curves there are.
    pub learning_curves: usize,
}

/// Analyses a recording and writes into `folder`: `scores.csv`, `table.{csv,md,tex,parquet}`,
/// `error_vs_distance.{csv,parquet,svg}`, `true_distances.csv`; if something learned, also `learning_curves.{csv,parquet,svg}`.
///
/// Every file is written under another name first and renamed when whole. Equal recordings give equal files.
///
/// # Errors
/// If the recording cannot be read or a file not be written.
pub fn report(recording: &Recording, folder: &Path, options: &ReportOptions) -> Result<Summary, AnalysisError> {
    let plan = recording.plan();
    let estimators = estimators(plan)?;
    let curves = learning_curves(recording)?;
    write_curves(&curves, folder)?;
    let ends: Vec<Json> = curves.iter().map(LearningCurve::end).collect();
    if estimators.is_empty() {
        let text = "nothing was scored: no stage has a `score:`\n".to_owned();
        let json = json!({ "table": [], "learning_curves": ends, "notes": [text.trim_end()] });
        return Ok(Summary { text, json, learning_curves: curves.len() });
    }
    // The rows go before the samples come: what grows with the number of frames is never held beside them.
    let table = {
        let scores = reading::scores(recording, &estimators)?;
        files::write_csv(folder, "scores.csv", &mut table_of_scores(&scores, &estimators)?)?;
        Table::new(&scores, &estimators, options.paper)?
    };
    let mut long_form = table.long_form()?;
    files::write_csv(folder, "table.csv", &mut long_form)?;
    files::write_parquet(folder, "table.parquet", &mut long_form)?;
    files::write(folder, "table.md", table.markdown().as_bytes())?;
    files::write(folder, "table.tex", table.latex().as_bytes())?;

    let distances = reading::distances(recording, &estimators, SAMPLES_IN_MEMORY, folder)?;
    let mut bins = table_of_bins(&distances.bins, &estimators)?;
    files::write_csv(folder, "error_vs_distance.csv", &mut bins)?;
    files::write_parquet(folder, "error_vs_distance.parquet", &mut bins)?;
    files::write_csv(folder, "true_distances.csv", &mut distances.table_of_truth()?)?;
    let figure = Figure { estimators: &estimators, bins: &distances.bins, truth: &distances.truth };
    files::write(folder, "error_vs_distance.svg", render(&figure).as_bytes())?;

    let mut notes = Vec::new();
    let without_maps = estimators.iter().filter(|e| e.estimate_topic.is_none() || e.truth_topic.is_none());
    for estimator in without_maps {
        notes.push(format!("no error against distance of {}: its maps were not recorded", estimator.label));
    }
    let failed: usize =
        (0..plan.runs.len()).flat_map(|run| recording.frames(run)).filter(|f| !f.failures.is_empty()).count();
    if failed > 0 {
        let frames = if failed == 1 { "frame" } else { "frames" };
        notes.push(format!("{failed} {frames} failed somewhere; means are over the frames all estimators have"));
    }
    if plan.every > 1 {
        let ordinal = ordinal(plan.every);
        notes.push(format!("error against distance is of every {ordinal} frame: only their maps were recorded"));
    }
    let mut text = table.terminal(TERMINAL_WIDTH);
    for note in &notes {
        text.push_str(&format!("note: {note}\n"));
    }
    let json = json!({
        "experiment": plan.experiment,
        "table": rows(&table),
        "learning_curves": ends,
        "notes": notes,
    });
    Ok(Summary { text, json, learning_curves: curves.len() })
}

/// Writes the points of the learning curves and their figure, if there are any.
fn write_curves(curves: &[LearningCurve], folder: &Path) -> Result<(), AnalysisError> {
    if curves.is_empty() {
        return Ok(());
    }
    let mut points = table_of_points(curves)?;
    files::write_csv(folder, "learning_curves.csv", &mut points)?;
    files::write_parquet(folder, "learning_curves.parquet", &mut points)?;
    files::write(folder, "learning_curves.svg", crate::curves::render(curves).as_bytes())
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
