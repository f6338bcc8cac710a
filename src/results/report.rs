//! The report of a run: its tables and plots, and what of them is printed.

use std::path::Path;

use depthloom_analysis::{
    AnalysisError, CurveEnd, PAGE, Prepared, RecordingCondition, ReportOptions, SAMPLES, Summary, TableRow, report_with,
};
use depthloom_recording::Recording;
use depthloom_runner::Interrupt;
use depthloom_runs::{MODELS, RECORDING};
use depthloom_terminal::{CliError, ExitCode};
use schemars::JsonSchema;
use serde::Serialize;

use crate::output::diagnostics::Error;

/// Of `report`: what was found.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Report {
    experiment: String,
    recording: RecordingCondition,
    /// The rows of `table.csv`.
    table: Vec<TableRow>,
    /// Where each learning curve ended.
    learning_curves: Vec<CurveEnd>,
    notes: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

impl Report {
    /// From the summary of the analysis, with the error of the command.
    pub(crate) fn new(summary: &Summary, error: Option<Error>) -> Self {
        Self {
            experiment: summary.experiment.clone(),
            recording: summary.recording.clone(),
            table: summary.rows.clone(),
            learning_curves: summary.curve_ends.clone(),
            notes: summary.notes.clone(),
            error,
        }
    }
}

/// The error of a run whose frames were scored without one pixel that counted.
pub(crate) fn no_pixel_counted(report: &Summary) -> Option<CliError> {
    report.no_pixel_counted.then(|| CliError::new(ExitCode::FrameFailures, "no pixel was scored"))
}

/// Analyses a recording until it is done or asked to stop. What is prepared is not computed again.
pub(crate) fn analyse(
    recording: &Recording,
    folder: &Path,
    options: &ReportOptions,
    prepared: Prepared<'_>,
    interrupt: &Interrupt,
) -> Result<Summary, CliError> {
    let interrupted = || CliError::new(ExitCode::Interrupted, "interrupted while analysing");
    if interrupt.stops_admission() {
        return Err(interrupted());
    }
    let report = report_with(recording, folder, options, prepared, &|| interrupt.stops_admission());
    report.map_err(|error| match error {
        AnalysisError::Stopped => interrupted(),
        error => {
            let exit = if error.is_damage() { ExitCode::FrameFailures } else { ExitCode::Engine };
            CliError::remedied(exit, "failed to analyse the recording", &error)
        }
    })
}

pub(crate) fn summary(report: &Summary, folder: &Path) -> String {
    let has_model = |extension: &str| {
        let models = std::fs::read_dir(folder.join(MODELS)).into_iter().flatten().flatten();
        models.into_iter().any(|entry| entry.path().extension().is_some_and(|found| found == extension))
    };
    let files = [
        (folder.join(RECORDING).is_file(), "what was recorded", "recording.mcap (MCAP viewers open it, too)"),
        (report.scored, "scores per frame", "scores.{csv,parquet}"),
        (report.table, "this table", "table.{csv,md,tex,parquet}"),
        (report.distances, "error against distance", "error_vs_distance.{csv,parquet,svg}"),
        (folder.join(SAMPLES).is_file(), "a row per scored pixel", "samples.parquet (`depthloom analyse` reads it)"),
        (report.learning_curves > 0, "learning curves", "learning_curves.{csv,parquet,svg}"),
        (folder.join(PAGE).is_file(), "all of it on one page", "report.html (`depthloom report RUN --open`)"),
        (has_model("onnx"), "learnt models", "models/<stage>.<node>.onnx"),
        (has_model("json"), "learned reliability", "models/<stage>.<node>.json"),
    ];
    let there = files.iter().filter(|(is_there, ..)| *is_there);
    let list: String = there.map(|(_, what, file)| format!("  {what:24}{file}\n")).collect();
    if list.is_empty() { report.text.clone() } else { format!("{}\nin {}:\n{list}", report.text, folder.display()) }
}
