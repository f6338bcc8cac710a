//! Exports with one file per topic: trained models, and rows.

use depthloom_analysis::{AnalysisError, TopicRows, curve_rows, topic_rows};
use depthloom_graphs::Value;
use depthloom_graphs::contracts::Slot;
use depthloom_recording::{RecordedAggregate, Recording, RecordingError};
use depthloom_runs::read_failed;
use depthloom_terminal::{CliError, ExitCode};

use crate::ExportFormat;
use crate::{Chosen, Exported, Folder, Frames};

/// Writes what a topic has learned: a network or a reliability.
///
/// # Errors
/// If the recording is damaged there, or the file cannot be written.
pub fn write_learned(
    recording: &Recording,
    chosen: &Chosen<'_>,
    format: ExportFormat,
    folder: &Folder,
) -> Result<Exported, CliError> {
    let once = aggregate_value(recording, chosen);
    let value = once
        .map(|once| recording.aggregate_value(once))
        .transpose()
        .map_err(|error| read_failed("failed to read what was learned", &error))?;
    let model = value.as_ref().and_then(Value::artifact).map(|model| &*model.bytes);
    write(chosen, format, model, folder)
}

/// Writes the rows of a topic on some frames, or its learning curve; and what of it is damaged.
///
/// # Errors
/// As any write error; `None` once `stop` returns true.
pub fn write_rows(
    recording: &Recording,
    chosen: &Chosen<'_>,
    frames: &Frames,
    folder: &Folder,
    stop: &dyn Fn() -> bool,
) -> Result<Option<(Exported, Vec<RecordingError>)>, CliError> {
    let of_curve = |once: &RecordedAggregate| -> Result<Option<TopicRows>, AnalysisError> {
        match recording.aggregate_value(once)? {
            Value::Curve(curve) => curve_rows(recording.plan(), once.run, once.node, &curve).map(Some),
            _ => Ok(None),
        }
    };
    let rows = match aggregate_value(recording, chosen) {
        Some(once) => of_curve(once),
        None => topic_rows(recording, chosen.run, chosen.topic, &frames.positions, stop).map(Some),
    };
    let rows = match rows {
        Ok(rows) => rows.filter(|rows| rows.rows > 0 || !rows.damaged.is_empty()),
        Err(AnalysisError::Stopped) => return Ok(None),
        Err(error) => {
            let exit = if error.is_damage() { ExitCode::FrameFailures } else { ExitCode::Engine };
            return Err(CliError::remedied(exit, format_args!("failed to export {}", chosen.name), &error));
        }
    };
    let (parquet, damaged) = rows.map(|rows| (rows.parquet, rows.damaged)).unzip();
    let exported = write(chosen, ExportFormat::Parquet, parquet.as_deref(), folder)?;
    Ok(Some((exported, damaged.unwrap_or_default())))
}

fn aggregate_value<'a>(recording: &'a Recording, chosen: &Chosen<'_>) -> Option<&'a RecordedAggregate> {
    let is_it = |once: &&RecordedAggregate| {
        let Slot::Node { node, port } = chosen.slot else { return false };
        (once.run, once.node, once.port) == (chosen.run, node, port)
    };
    recording.aggregate_values().iter().find(is_it)
}

/// Writes the file of a topic, if it has anything.
fn write(
    chosen: &Chosen<'_>,
    format: ExportFormat,
    bytes: Option<&[u8]>,
    folder: &Folder,
) -> Result<Exported, CliError> {
    let path = chosen.path_with(format.name());
    if let Some(bytes) = bytes {
        folder.write(&path, bytes)?;
    }
    Ok(Exported {
        topic: chosen.name.to_owned(),
        value_type: chosen.value_type.name(),
        format: format.name(),
        path: path.to_string_lossy().into_owned(),
        files: u64::from(bytes.is_some()),
        clipped_pixels: 0,
    })
}
