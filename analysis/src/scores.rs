//! Scores per frame: the rows the engine recorded, as a table.

use std::ops::RangeInclusive;
use std::sync::Arc;

use depthloom_graphs::counted;
use depthloom_graphs::plan::FrameIndex;
use depthloom_scores::{Mean, Metric, ScoreRow};

use crate::estimators::Estimator;
use crate::leading::sheet_of_estimators;
use crate::sheet::{Cells, Sheet};

/// The scores of one estimator on one frame and one pixel set.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameScore {
    /// The frame's id: what people call it. Sources that are joined may repeat one, and a frame may be asked for twice.
    pub frame: Arc<str>,
    /// The frame's place in its stage run: what tells it from all others of the run.
    pub position: FrameIndex,
    /// Index of the estimator.
    pub estimator: usize,
    /// Its scores.
    pub row: ScoreRow,
}

/// The rows of one frame in the order of `scores.csv`: pixel set by pixel set, in each estimator by estimator.
pub(crate) fn order_frame(rows: &mut [FrameScore]) {
    // Within an estimator the zones stay as they were recorded, the whole image first.
    rows.sort_by_key(|score| (score.row.set, score.estimator));
}

/// Over how many frames rows are, and how: `is_all(mean)` says whether each of them is averaged so.
pub(crate) fn averaged(frames: RangeInclusive<u64>, is_all: impl Fn(Mean) -> bool) -> String {
    let (least, most) = frames.into_inner();
    let frames = match least == most {
        true => counted(most, "frame"),
        false => format!("{least} to {}", counted(most, "frame")),
    };
    match (is_all(Mean::Frames), is_all(Mean::Pixels)) {
        (true, _) => format!("mean over {frames}"),
        (_, true) => format!("over the pixels of {frames} together"),
        _ => format!("over {frames}, of some the mean, of others the pixels together"),
    }
}

/// The scores that any of the estimators has, in the catalogue's order: what tables have columns for.
pub(crate) fn metrics_of(estimators: &[Estimator]) -> Vec<&'static Metric> {
    let mut metrics: Vec<&'static Metric> = Vec::new();
    for metric in estimators.iter().flat_map(|estimator| &estimator.metrics) {
        if !metrics.contains(metric) {
            metrics.push(metric);
        }
    }
    metrics.sort_by_key(|metric| metric.place());
    metrics
}

/// The table `scores.csv` holds: what a row is of, with its `zone` (null: the whole image), `position` and `frame`; `pixels`, the scores that
/// were asked for, `density`; a score of no pixel is null. No two rows have the same stage, variant, estimator, set, zone and position,
/// whatever frames are called.
pub(crate) fn table_of_scores<'a>(rows: &'a [FrameScore], estimators: &'a [Estimator]) -> Sheet<'a> {
    let of: Vec<(&Estimator, &str)> =
        rows.iter().map(|score| (&estimators[score.estimator], score.row.set.name())).collect();
    let zones = rows.iter().map(|score| Some(score.row.zone.as_str()).filter(|zone| !zone.is_empty()));
    let mut table = sheet_of_estimators(&of, [("zone", Cells::TextIfAny(zones.collect()))])
        .with("position", Cells::Count(rows.iter().map(|score| score.position.0 as u64).collect()))
        .with("frame", Cells::Text(rows.iter().map(|score| &*score.frame).collect()))
        .with_unit("pixels", "pixels", Cells::Count(rows.iter().map(|score| score.row.pixels).collect()));
    for metric in metrics_of(estimators) {
        table = table.with_score(metric, Cells::Number(rows.iter().map(|score| score.row.get(metric)).collect()));
    }
    table.with_share("density", rows.iter().map(|score| score.row.density()).collect())
}
