//! Scores per frame: the rows the engine recorded, as a table.

use std::sync::Arc;

use depthloom_scores::{SCORE_NAMES, ScoreRow};
use polars::frame::DataFrame;
use polars::prelude::{Column, NamedFrom, PolarsResult, Series};

use crate::error::AnalysisError;
use crate::estimators::Estimator;

/// The scores of one estimator on one frame and one pixel set.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameScore {
    /// The frame's id.
    pub frame: Arc<str>,
    /// Index of the estimator.
    pub estimator: usize,
    /// Its scores.
    pub row: ScoreRow,
}

/// The rows of one frame in the order of `scores.csv`: pixel set by pixel set, in each estimator by estimator.
pub(crate) fn order_frame(rows: &mut [FrameScore]) {
    rows.sort_by_key(|score| (score.row.set, score.estimator));
}

/// The table `scores.csv` holds: `frame, estimator, scored_on, pixels`, then the eight scores; a score of no pixel is null.
pub(crate) fn table_of_scores(rows: &[FrameScore], estimators: &[Estimator]) -> Result<DataFrame, AnalysisError> {
    let text = |name: &str, of: &dyn for<'a> Fn(&'a FrameScore) -> &'a str| {
        Column::from(Series::new(name.into(), rows.iter().map(of).collect::<Vec<_>>()))
    };
    let labels: Vec<&str> = rows.iter().map(|score| estimators[score.estimator].label.as_str()).collect();
    let mut columns = vec![
        text("frame", &|score| &score.frame),
        Column::from(Series::new("estimator".into(), labels)),
        text("scored_on", &|score| score.row.set.name()),
        Column::from(Series::new("pixels".into(), rows.iter().map(|score| score.row.pixels).collect::<Vec<_>>())),
    ];
    for (i, name) in SCORE_NAMES.into_iter().enumerate() {
        let scores: Vec<Option<f64>> = rows.iter().map(|score| null_if_nan(score.row.scores()[i])).collect();
        columns.push(Column::from(Series::new(name.into(), scores)));
    }
    let table: PolarsResult<DataFrame> = DataFrame::new(rows.len(), columns);
    table.map_err(AnalysisError::compute("scores per frame"))
}

/// NaN says "no pixel counted"; tables say null.
pub(crate) fn null_if_nan(score: f64) -> Option<f64> {
    (!score.is_nan()).then_some(score)
}
