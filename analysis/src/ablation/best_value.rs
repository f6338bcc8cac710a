//! The best value of a run, for lists of runs.

use depthloom_recording::Recording;

use super::answer::{scored, source_keys};
use super::best::Best;
use super::{Ablation, Selection};
use crate::error::{AnalysisError, caught};
use crate::estimates::{Estimate, estimates};
use crate::tables::RowKey;

/// The best value of a run and its estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct BestValue {
    /// The metric: `abs_rel`, or if that was not scored, the metric that `table` sorts by.
    pub metric: &'static str,
    /// Its value.
    pub value: f64,
    /// The stage and variant of the estimate.
    pub row_key: RowKey,
    /// The name of the estimate, as in tables.
    pub estimate: String,
    /// The label of the estimate.
    pub label: String,
}

/// The best estimate of a recording over all pixels with ground truth, or the only one. `None` if no estimate can be
/// compared with another.
///
/// # Errors
/// As [`answer`](super::answer()); also if nothing was scored.
pub fn best_value(recording: &Recording, stop: &(dyn Fn() -> bool + Sync)) -> Result<Option<BestValue>, AnalysisError> {
    caught(|| {
        let estimates = estimates(recording.plan())?;
        let scores = scored(recording, &estimates, stop)?;
        let source = source_keys(recording);
        let ablation = Ablation::new(recording.plan(), &estimates, &scores, &source, None);
        let rows = ablation.rows(&Selection::default())?;
        let metric = ablation.first_error(&rows);
        let best = Best::new(&ablation, &rows);
        let best_value = |row: usize| {
            let value = rows[row].values[metric]?;
            let Estimate { row_key, name, label, .. } = ablation.estimate(&rows[row]).clone();
            Some(BestValue { metric: ablation.metrics[metric].name, value, row_key, estimate: name, label })
        };
        Ok((0..rows.len()).find(|&row| rows.len() == 1 || best.is_best(metric, row)).and_then(best_value))
    })
}
