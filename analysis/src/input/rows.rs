//! Values with rows as Parquet files, one file per topic: scores and calibrations by frame, a learning curve by step.

use std::sync::Arc;

use depthloom_graphs::Value;
use depthloom_graphs::plan::{FrameIndex, NodeId, RunId};
use depthloom_graphs::values::{Calibration, Curve};
use depthloom_recording::{RecordedPlan, Recording, RecordingError};
use depthloom_scores::{Metric, ScoreRow};

use crate::curves::{learning_curve, table_of_points};
use crate::error::AnalysisError;
use crate::tables::{Column, DIMENSIONLESS, Rows, Table, plan_key};

/// The rows of a topic.
pub struct TopicRows {
    /// As a Parquet file.
    pub parquet: Vec<u8>,
    /// The number of rows.
    pub rows: u64,
    /// The errors of values that could not be read and were skipped.
    pub damaged: Vec<RecordingError>,
}

/// The rows of a topic of a stage run on some of its frames: scores have one row per pixel set and zone, calibrations
/// have one row.
///
/// Columns are `position` (of the frame in its stage), `frame`, and the contents. For scores these are `set, zone,
/// pixels, truth, valid`, the metrics in the order of the catalogue, and `density`. A metric is null if no pixel
/// counted; `zone` is null for the whole image. For calibrations the contents are `width, height` and `focal_px, cx_px,
/// cy_px, baseline_m`, for numbers `value`.
///
/// # Errors
/// If the recording cannot be read; [`AnalysisError::Stopped`] once `stop` returns true.
pub fn topic_rows(
    recording: &Recording,
    run: RunId,
    topic: &str,
    positions: &[FrameIndex],
    stop: &dyn Fn() -> bool,
) -> Result<TopicRows, AnalysisError> {
    let mut reader = recording.reader(run, &[topic])?;
    let (mut scores, mut calibrations, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
    let mut damaged = Vec::new();
    for &position in positions {
        if stop() {
            return Err(AnalysisError::Stopped);
        }
        let value = match reader.read(position) {
            Ok(mut values) => values.pop().flatten(),
            Err(error) if error.is_damage() => {
                damaged.push(error);
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        let frame = &recording.frames(run)[position].id;
        let at = position.0 as u64;
        match value {
            Some(Value::Scores(rows)) => scores.extend(rows.iter().map(|row| (at, Arc::clone(frame), row.clone()))),
            Some(Value::Calibration(calibration)) => calibrations.push((at, Arc::clone(frame), calibration)),
            Some(Value::Number(number)) => numbers.push((at, Arc::clone(frame), number.value)),
            _ => {}
        }
    }
    let table = match (calibrations.is_empty(), numbers.is_empty()) {
        (false, _) => table_of_calibrations(&calibrations),
        (_, false) => table_of_numbers(&numbers),
        _ => table_of_scores(&scores),
    };
    let rows = table.height() as u64;
    Ok(TopicRows { parquet: table.parquet(topic, &plan_key(recording.plan()))?, rows, damaged })
}

/// A node's learning curve as a Parquet file with the columns of `learning_curves.csv`, and its number of points.
///
/// # Errors
/// If polars fails.
pub fn curve_rows(plan: &RecordedPlan, run: RunId, node: NodeId, curve: &Curve) -> Result<TopicRows, AnalysisError> {
    let curves = [learning_curve(plan, run, node, curve)];
    let (name, rows) = (&plan.runs[run].nodes[node].name, curve.points.len() as u64);
    Ok(TopicRows { parquet: table_of_points(&curves).parquet(name, &plan_key(plan))?, rows, damaged: Vec::new() })
}

/// A row of a frame: position, id, contents.
type FrameRow<T> = (u64, Arc<str>, T);

fn frame_columns<T>(rows: &[FrameRow<T>]) -> Vec<Column> {
    let rows = Rows(rows);
    vec![rows.count("position", |(position, ..)| *position), rows.text("frame", |(_, frame, _)| &**frame)]
}

fn table_of_scores(scores: &[FrameRow<ScoreRow>]) -> Table {
    let rows = Rows(scores);
    let mut columns = frame_columns(scores);
    columns.extend([
        rows.text("set", |(.., row)| row.set.name()),
        rows.text("zone", |(.., row)| Some(&row.zone).filter(|zone| !zone.is_empty())),
        rows.count("pixels", |(.., row)| row.pixels).unit("pixels"),
        rows.count("truth", |(.., row)| row.truth).unit("pixels"),
        rows.count("valid", |(.., row)| row.valid).unit("pixels"),
    ]);
    let is_there = |metric: &&Metric| scores.iter().any(|(.., row)| row.get(metric).is_some());
    columns.extend(crate::metrics().filter(is_there).map(|metric| rows.metric(metric, |(.., row)| row.get(metric))));
    columns.push(rows.share("density", |(.., row)| row.density()).unit(DIMENSIONLESS));
    Table::new(columns)
}

fn table_of_numbers(numbers: &[FrameRow<f64>]) -> Table {
    let mut columns = frame_columns(numbers);
    columns.push(Rows(numbers).number("value", |(.., value)| *value));
    Table::new(columns)
}

fn table_of_calibrations(calibrations: &[FrameRow<Arc<Calibration>>]) -> Table {
    let rows = Rows(calibrations);
    let mut columns = frame_columns(calibrations);
    columns.extend([
        rows.count("width", |(.., row)| u64::from(row.width)).unit("px"),
        rows.count("height", |(.., row)| u64::from(row.height)).unit("px"),
        rows.number("focal_px", |(.., row)| row.focal_px).unit("px"),
        rows.number("cx_px", |(.., row)| row.cx_px).unit("px"),
        rows.number("cy_px", |(.., row)| row.cy_px).unit("px"),
        rows.number("baseline_m", |(.., row)| row.baseline_m).unit("m"),
        rows.number("doffs_px", |(.., row)| row.doffs_px).unit("px"),
    ]);
    Table::new(columns)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use depthloom_graphs::Key;
    use depthloom_scores::PixelSet;
    use polars::frame::DataFrame;
    use polars::prelude::{ParallelStrategy, ParquetReader, SerReader};

    use super::*;

    fn read(bytes: Vec<u8>) -> DataFrame {
        ParquetReader::new(Cursor::new(bytes)).read_parallel(ParallelStrategy::None).finish().unwrap()
    }

    #[test]
    fn rows_of_scores_have_null_where_no_pixel_counted() {
        let abs_rel = Metric::named("abs_rel").unwrap();
        let row = |zone: &str, pixels, value: Option<f64>| ScoreRow {
            set: PixelSet::All,
            zone: zone.to_owned(),
            pixels,
            truth: 8,
            valid: pixels,
            log_mean: None,
            scores: value.map(|value| (abs_rel, value)).into_iter().collect(),
        };
        let rows: [FrameRow<ScoreRow>; 2] =
            [(3, "a".into(), row("", 4, Some(0.1 + 0.2))), (3, "a".into(), row("10..20", 0, None))];
        let table = read(table_of_scores(&rows).parquet("scores", &Key::of_content(b"")).unwrap());
        let names: Vec<String> = table.get_column_names().iter().map(ToString::to_string).collect();
        assert_eq!(names, ["position", "frame", "set", "zone", "pixels", "truth", "valid", "abs_rel", "density"]);
        let numbers = |name: &str| table.column(name).unwrap().f64().unwrap().iter().collect::<Vec<_>>();
        assert_eq!((numbers("abs_rel"), numbers("density")), (vec![Some(0.1 + 0.2), None], vec![Some(0.5), Some(0.0)]));
        assert_eq!(table.column("zone").unwrap().str().unwrap().iter().collect::<Vec<_>>(), [None, Some("10..20")]);
        assert_eq!(table.column("position").unwrap().u64().unwrap().get(0), Some(3));
    }

    #[test]
    fn a_calibration_has_one_row() {
        let calibration = Calibration {
            width: 64,
            height: 48,
            focal_px: 721.5,
            cx_px: 31.5,
            cy_px: 23.5,
            baseline_m: 0.54,
            doffs_px: 0.5,
        };
        let rows = [(0, "a".into(), Arc::new(calibration))];
        let table = read(table_of_calibrations(&rows).parquet("calibration", &Key::of_content(b"")).unwrap());
        assert_eq!(table.column("width").unwrap().u64().unwrap().get(0), Some(64));
        assert_eq!(table.column("baseline_m").unwrap().f64().unwrap().get(0), Some(0.54));
        assert_eq!(table.column("doffs_px").unwrap().f64().unwrap().get(0), Some(0.5));
    }
}
