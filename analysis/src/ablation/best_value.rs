//! The best value of a run, for lists of runs.

use depthloom_recording::Recording;

use super::answer::{scored, source_of};
use super::best::Best;
use super::{Ablation, Selection};
use crate::error::{AnalysisError, caught};
use crate::estimators::{Estimator, estimators};
use crate::tables::RowKey;

/// The best value of a run, and the estimate that it is of.
#[derive(Clone, Debug, PartialEq)]
pub struct BestValue {
    /// The score: `abs_rel`, or where that was not taken, what `table` sorts by.
    pub metric: &'static str,
    /// Its value.
    pub value: f64,
    /// What the estimator is of.
    pub lead: RowKey,
    /// Its name, as tables have it.
    pub estimator: String,
    /// What people call it.
    pub label: String,
}

/// The best of a recording's estimators over all true pixels, or the only one; `None` where none can be compared with
/// another.
///
/// # Errors
/// As [`answer`](super::answer()); nothing to be scored is one.
pub fn best_value(recording: &Recording, stop: &(dyn Fn() -> bool + Sync)) -> Result<Option<BestValue>, AnalysisError> {
    caught(|| {
        let estimators = estimators(recording.plan())?;
        let scores = scored(recording, &estimators, stop)?;
        let source = source_of(recording);
        let ablation = Ablation::new(recording.plan(), &estimators, &scores, &source, None);
        let rows = ablation.rows(&Selection::default())?;
        let metric = ablation.first_error(&rows);
        let best = Best::of(&ablation, &rows);
        let of = |row: usize| {
            let value = rows[row].values[metric]?;
            let Estimator { lead, name, label, .. } = ablation.estimator(&rows[row]).clone();
            Some(BestValue { metric: ablation.metrics[metric].name, value, lead, estimator: name, label })
        };
        Ok((0..rows.len()).find(|&row| rows.len() == 1 || best.is_best(metric, row)).and_then(of))
    })
}
