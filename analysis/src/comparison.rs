//! What makes scores comparable.

use depthloom_graphs::Key;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_scores::{Mean, Settings};

use crate::estimators::Estimator;
use crate::scores::FrameScore;

/// Scores of equal comparisons may be compared: they are over as many pixels of the same frames, by source and id, held against the same truth,
/// scored and averaged in the same way.
#[derive(PartialEq)]
pub(crate) struct Comparison<'a> {
    settings: (&'a Option<Settings>, Mean),
    truth: Option<&'a str>,
    frames: Vec<(Option<Key>, &'a str, u64)>,
}

impl<'a> Comparison<'a> {
    /// Of an estimator's scores on one pixel set of one zone; `source(run, position)` is the key of a frame's source values.
    pub(crate) fn of(
        estimator: &'a Estimator,
        mean: Mean,
        scores: impl Iterator<Item = &'a FrameScore>,
        source: &dyn Fn(RunId, FrameIndex) -> Option<Key>,
    ) -> Self {
        let frame = |score: &'a FrameScore| (source(estimator.run, score.position), &*score.frame, score.row.pixels);
        Self {
            settings: (&estimator.settings, mean),
            truth: estimator.truth.as_deref(),
            frames: scores.map(frame).collect(),
        }
    }
}
