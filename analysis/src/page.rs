//! Writes `report.html`, the page of a run.

mod choice;
mod data;
mod leading;
mod limits;

use std::io::BufWriter;
use std::path::Path;

use depthloom_figures::page::{self, Pictures, plan_drawing};
use depthloom_recording::Recording;
use serde_json::{Value as Json, json};

use crate::ablation::{Ablation, source_keys};
use crate::error::{AnalysisError, caught};
use crate::estimates::estimates;
use crate::files::Output;
use crate::input::reading;
use crate::input::timings::Timing;
use crate::input::warnings::warnings;
use crate::report::Summary;
use crate::titles::Titles;

pub use limits::{MOST_DETAILED, MOST_LAYERS, MOST_PICTURED, PageRuns};
pub use page::PAGE_MARK;

/// The file name of the page in the folder of a report.
pub const PAGE: &str = "report.html";

/// Contents of a page that are not in the recording: the environment and the timings of the run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// The contents of `environment.json`; null if the file is missing.
    pub environment: Json,
    /// The contents of `timings.parquet`.
    pub timings: Vec<Timing>,
}

/// The options of a page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageOptions {
    /// The number of frames with pictures of all stage runs with a `score:`; `None`: the usual one.
    pub frames: Option<usize>,
}

/// Describes the written page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageWritten {
    /// The number of frames with pictures.
    pub frames: usize,
    /// The size of the page in bytes.
    pub bytes: u64,
}

/// Writes [`PAGE`] into `folder`. `summary` is the result of the [report](crate::report()) of the recording. Equal
/// recordings and surroundings give equal bytes. Memory use does not depend on the number of frames or maps.
///
/// # Errors
/// If the recording cannot be read or the page cannot be written; [`AnalysisError::Stopped`] once `stop` returns true.
/// Damaged maps are skipped.
pub fn write_page(
    recording: &Recording,
    folder: &Path,
    summary: &Summary,
    surroundings: &Surroundings,
    options: PageOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<PageWritten, AnalysisError> {
    caught(|| written(recording, summary, surroundings, options, Output { folder, stop }))
}

fn written(
    recording: &Recording,
    summary: &Summary,
    surroundings: &Surroundings,
    options: PageOptions,
    output: Output<'_>,
) -> Result<PageWritten, AnalysisError> {
    let (plan, report) = (recording.plan(), &summary.data);
    let estimates = estimates(plan)?;
    let scores = reading::scores(recording, &estimates, output.stop)?;
    let table = report.table.as_ref();
    let shown = choice::estimates_shown(&estimates, table);
    let mut series = choice::series(recording, &estimates, &shown, table, &scores, options.frames);
    let mut notes = warnings(recording, None);
    notes.extend(summary.notes.iter().cloned());
    let source = source_keys(recording);
    let ablation = Ablation::new(plan, &estimates, &scores, &source, None);
    let titles = Titles::new([plan]);
    let shown_table = table.map(|table| -> Result<_, AnalysisError> {
        let mut shown_table = data::table(table, &estimates, &shown, &titles);
        leading::add(&mut shown_table, table, recording, (&ablation, &estimates), output.stop)?;
        Ok(shown_table)
    });
    let mut data = json!({
        "experiment": plan.experiment,
        "description": plan.description,
        "depthloom": env!("CARGO_PKG_VERSION"),
        "variants": plan.variants.len(),
        "condition": summary.recording,
        "notes": notes,
        "table": shown_table.transpose()?,
        "answers": table.map_or(Ok(Vec::new()), |table| data::query_tables(&ablation, table, &titles))?,
        "estimates": data::estimates(&estimates, &shown),
        "estimates_in_all": estimates.len(),
        "distances": data::distances(report, &shown),
        "scores": data::scores(recording, &estimates, &shown, &series, &scores),
        "curves": data::curves(report),
        "every": plan.every,
        "failures": data::failures(recording),
        "timings": data::timings(&surroundings.timings),
        "environment": surroundings.environment,
        "keys": data::keys(plan),
    });
    // Frees the memory for the pictures.
    drop(ablation);
    drop(scores);
    let drawing = plan_drawing(plan);
    let numbers = (data.to_string().len() + drawing.len()) as u64;
    let mut pictures = Pictures::new(recording, &mut series, numbers, output.folder, output.stop)?;
    let frames = series.iter().map(|series| series.positions.len()).sum();
    data["pictures"] = data::pictures(recording, &estimates, &shown, &series, &pictures);
    data["steps"] = pictures.steps_json();
    data["damaged"] = pictures.damaged().into();
    let path = output.folder.join(PAGE);
    let mut bytes = 0;
    output.check_stop()?;
    let result = depthloom_durable::write_with(&path, |file| -> std::io::Result<()> {
        let mut file = BufWriter::with_capacity(1 << 16, file);
        bytes = page::write_page(&mut file, &plan.experiment, &drawing, &data, &mut pictures)?;
        Ok(())
    });
    result.map_err(AnalysisError::write(&path))?;
    Ok(PageWritten { frames, bytes })
}
