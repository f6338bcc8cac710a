//! `report.html`: what the page of a run shows.

mod choice;
mod data;

use std::io::BufWriter;
use std::path::Path;

use depthloom_figures::page::{self, Pictures, plan_drawing};
use depthloom_recording::Recording;
use serde_json::{Value as Json, json};

use crate::ablation::{Ablation, source_of};
use crate::error::{AnalysisError, caught};
use crate::estimates::estimates;
use crate::files::Output;
use crate::input::reading;
use crate::input::timings::Timing;
use crate::input::warnings::warnings;
use crate::report::Summary;

pub use page::PAGE_MARK;

/// Its name in the folder of a report.
pub const PAGE: &str = "report.html";

/// What a page says besides what its recording holds: where the run was made, and where its time went.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// What `environment.json` says; null where there is none.
    pub environment: Json,
    /// What `timings.parquet` says.
    pub timings: Vec<Timing>,
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageWritten {
    /// Frames with pictures.
    pub frames: usize,
    /// Bytes.
    pub bytes: u64,
}

/// Writes [`PAGE`] into `folder`, of a recording whose [report](crate::report()) said `summary`. Equal recordings and
/// surroundings give equal bytes; memory depends on neither the number of frames nor on that of maps.
///
/// # Errors
/// If the recording cannot be read or the page not be written; [`AnalysisError::Stopped`] once `stop` says so. Maps
/// whose bytes are damaged are left out.
pub fn write_page(
    recording: &Recording,
    folder: &Path,
    summary: &Summary,
    surroundings: &Surroundings,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<PageWritten, AnalysisError> {
    caught(|| written(recording, summary, surroundings, Output { folder, stop }))
}

fn written(
    recording: &Recording,
    summary: &Summary,
    surroundings: &Surroundings,
    output: Output<'_>,
) -> Result<PageWritten, AnalysisError> {
    let (plan, found) = (recording.plan(), &summary.found);
    let estimates = estimates(plan)?;
    let scores = reading::scores(recording, &estimates, output.stop)?;
    let table = found.table.as_ref();
    let shown = choice::estimates_shown(&estimates, table);
    let mut series = choice::series(recording, &estimates, &shown, table, &scores);
    let mut notes = warnings(recording, None);
    notes.extend(summary.notes.iter().cloned());
    let mut data = json!({
        "experiment": plan.experiment,
        "about": plan.about,
        "depthloom": env!("CARGO_PKG_VERSION"),
        "variants": plan.variants.len(),
        "condition": summary.recording,
        "notes": notes,
        "table": table.map(|table| data::table(table, &estimates)),
        "answers": table.map_or(Ok(Vec::new()), |table| {
            let source = source_of(recording);
            data::answers(&Ablation::new(plan, &estimates, &scores, &source, None), table)
        })?,
        "estimates": data::estimates(&estimates, &shown),
        "estimates_in_all": estimates.len(),
        "distances": data::distances(found, &shown),
        "scores": data::scores(recording, &estimates, &shown, &series, &scores),
        "curves": data::curves(found),
        "every": plan.every,
        "failures": data::failures(recording),
        "timings": data::timings(&surroundings.timings),
        "environment": surroundings.environment,
        "keys": data::keys(plan),
    });
    // Pictures take the memory that these did.
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
    output.go_on()?;
    let result = depthloom_durable::write_with(&path, |file| -> std::io::Result<()> {
        let mut file = BufWriter::with_capacity(1 << 16, file);
        bytes = page::write_page(&mut file, &plan.experiment, &drawing, &data, &mut pictures)?;
        Ok(())
    });
    result.map_err(AnalysisError::write(&path))?;
    Ok(PageWritten { frames, bytes })
}
