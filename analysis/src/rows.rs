//! Values that are rows as Parquet files, a file a topic: scores and calibrations by frame, a learning curve by step.

use std::sync::Arc;

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Curve};
use depthloom_recording::{Recording, RecordingError};
use depthloom_scores::{Metric, ScoreRow};

use crate::curves::{LearningCurve, table_of_points};
use crate::error::{AnalysisError, caught};
use crate::sheet::{Cells, Sheet};

/// The rows of a topic.
pub struct TopicRows {
    /// As a Parquet file.
    pub parquet: Vec<u8>,
    /// How many there are.
    pub rows: u64,
    /// What could not be read, and was left out.
    pub damaged: Vec<RecordingError>,
}

/// The rows that a topic of a stage run has on some of its frames: of scores a row a pixel set and zone, of calibrations one.
///
/// Columns are `position` (of the frame in its stage), `frame`, and what a row holds: of scores `scored_on, zone, pixels, truth, answered`,
/// the scores in the catalogue's order (null where no pixel counted), `density`; of calibrations `width, height` and `focal_px, cx_px, cy_px,
/// baseline_m`.
///
/// # Errors
/// If the recording cannot be read; [`AnalysisError::Stopped`] once `stop` says so.
pub fn topic_rows(
    recording: &Recording,
    run: usize,
    topic: &str,
    positions: &[usize],
    stop: &dyn Fn() -> bool,
) -> Result<TopicRows, AnalysisError> {
    let mut reader = recording.reader(run, &[topic])?;
    let (mut scores, mut calibrations, mut damaged) = (Vec::new(), Vec::new(), Vec::new());
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
        let at = position as u64;
        match value {
            Some(Value::Scores(rows)) => scores.extend(rows.iter().map(|row| (at, Arc::clone(frame), row.clone()))),
            Some(Value::Calibration(calibration)) => calibrations.push((at, Arc::clone(frame), calibration)),
            _ => {}
        }
    }
    let sheet = if calibrations.is_empty() { table_of_scores(&scores) } else { table_of_calibrations(&calibrations) };
    let rows = sheet.height() as u64;
    Ok(TopicRows { parquet: parquet(topic, sheet)?, rows, damaged })
}

/// A learning curve as a Parquet file with the columns of `learning_curves.csv`, and how many points it has.
///
/// # Errors
/// If polars fails.
pub fn curve_rows(label: &str, curve: &Curve) -> Result<TopicRows, AnalysisError> {
    let curves = [LearningCurve { label: label.to_owned(), curve: curve.clone() }];
    let rows = curve.points.len() as u64;
    Ok(TopicRows { parquet: parquet(label, table_of_points(&curves))?, rows, damaged: Vec::new() })
}

fn parquet(what: &str, sheet: Sheet<'_>) -> Result<Vec<u8>, AnalysisError> {
    caught(|| sheet.parquet().map_err(AnalysisError::compute(format!("the rows of {what}"))))
}

/// What a frame has a row of.
type OfFrame<T> = (u64, Arc<str>, T);

fn of_frames<T>(rows: &[OfFrame<T>]) -> Sheet<'_> {
    Sheet::new()
        .with("position", Cells::Count(rows.iter().map(|(position, ..)| *position).collect()))
        .with("frame", Cells::Text(rows.iter().map(|(_, frame, _)| &**frame).collect()))
}

fn table_of_scores(rows: &[OfFrame<ScoreRow>]) -> Sheet<'_> {
    let of = || rows.iter().map(|(.., row)| row);
    let mut table = of_frames(rows)
        .with("scored_on", Cells::Text(of().map(|row| row.set.name()).collect()))
        .with("zone", Cells::Text(of().map(|row| row.zone.as_str()).collect()))
        .with("pixels", Cells::Count(of().map(|row| row.pixels).collect()))
        .with("truth", Cells::Count(of().map(|row| row.truth).collect()))
        .with("answered", Cells::Count(of().map(|row| row.answered).collect()));
    let is_there = |metric: &&Metric| of().any(|row| row.get(metric).is_some());
    for metric in crate::metrics().filter(is_there) {
        table = table.with(metric.name, Cells::Number(of().map(|row| row.get(metric)).collect()));
    }
    table.with("density", Cells::Number(of().map(ScoreRow::density).collect()))
}

fn table_of_calibrations(rows: &[OfFrame<Arc<Calibration>>]) -> Sheet<'_> {
    let numbers = |of: fn(&Calibration) -> f64| Cells::Number(rows.iter().map(|(.., row)| Some(of(row))).collect());
    let counts = |of: fn(&Calibration) -> u32| Cells::Count(rows.iter().map(|(.., row)| u64::from(of(row))).collect());
    of_frames(rows)
        .with("width", counts(|of| of.width))
        .with("height", counts(|of| of.height))
        .with("focal_px", numbers(|of| of.focal_px))
        .with("cx_px", numbers(|of| of.cx_px))
        .with("cy_px", numbers(|of| of.cy_px))
        .with("baseline_m", numbers(|of| of.baseline_m))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use depthloom_graphs::values::CurvePoint;
    use depthloom_scores::PixelSet;
    use polars::frame::DataFrame;
    use polars::prelude::{ParallelStrategy, ParquetReader, SerReader};

    use super::*;

    fn read(bytes: Vec<u8>) -> DataFrame {
        ParquetReader::new(Cursor::new(bytes)).read_parallel(ParallelStrategy::None).finish().unwrap()
    }

    #[test]
    fn rows_of_scores_have_the_scores_that_there_are_and_null_where_no_pixel_counted() {
        let abs_rel = Metric::named("abs_rel").unwrap();
        let row = |zone: &str, pixels, value: Option<f64>| ScoreRow {
            set: PixelSet::All,
            zone: zone.to_owned(),
            pixels,
            truth: 8,
            answered: pixels,
            log_mean: None,
            scores: value.map(|value| (abs_rel, value)).into_iter().collect(),
        };
        let rows: [OfFrame<ScoreRow>; 2] =
            [(3, "a".into(), row("", 4, Some(0.1 + 0.2))), (3, "a".into(), row("10..20", 0, None))];
        let table = read(parquet("scores", table_of_scores(&rows)).unwrap());
        let names: Vec<String> = table.get_column_names().iter().map(ToString::to_string).collect();
        assert_eq!(
            names,
            ["position", "frame", "scored_on", "zone", "pixels", "truth", "answered", "abs_rel", "density"]
        );
        let numbers = |name: &str| table.column(name).unwrap().f64().unwrap().iter().collect::<Vec<_>>();
        assert_eq!((numbers("abs_rel"), numbers("density")), (vec![Some(0.1 + 0.2), None], vec![Some(0.5), Some(0.0)]));
        assert_eq!(table.column("zone").unwrap().str().unwrap().get(1), Some("10..20"));
        assert_eq!(table.column("position").unwrap().u64().unwrap().get(0), Some(3));
    }

    #[test]
    fn a_curve_has_a_row_a_point() {
        let point = |step, validation| CurvePoint { step, loss: 0.5, validation, learning_rate: 1e-3 };
        let curve = Curve { points: vec![point(0, None), point(7, Some(0.25))] };
        let TopicRows { parquet, rows, .. } = curve_rows("learn/teacher", &curve).unwrap();
        let table = read(parquet);
        assert_eq!((rows, table.height()), (2, 2));
        let validation: Vec<_> = table.column("validation").unwrap().f64().unwrap().iter().collect();
        assert_eq!(validation, [None, Some(0.25)]);
        assert_eq!(table.column("curve").unwrap().str().unwrap().get(0), Some("learn/teacher"));
    }

    #[test]
    fn a_calibration_is_a_row() {
        let calibration =
            Calibration { width: 64, height: 48, focal_px: 721.5, cx_px: 31.5, cy_px: 23.5, baseline_m: 0.54 };
        let rows = [(0, "a".into(), Arc::new(calibration))];
        let table = read(parquet("calibration", table_of_calibrations(&rows)).unwrap());
        assert_eq!(table.column("width").unwrap().u64().unwrap().get(0), Some(64));
        assert_eq!(table.column("baseline_m").unwrap().f64().unwrap().get(0), Some(0.54));
    }
}
