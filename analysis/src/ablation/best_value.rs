//! The best value of a run, for lists of runs.

use depthloom_recording::Recording;

use super::answer::{scored, source_of};
use super::best::Best;
use super::{Ablation, Selection};
use crate::error::{AnalysisError, caught};
use crate::estimates::{Estimate, estimates};
use crate::tables::RowKey;

/// The best value of a run, and the estimate that it is of.
#[derive(Clone, Debug, PartialEq)]
pub struct BestValue {
    /// The score: `abs_rel`, or where that was not taken, what `table` sorts by.
    pub metric: &'static str,
    /// Its value.
    pub value: f64,
    /// What the estimate is of.
    pub lead: RowKey,
    /// Its name, as tables have it.
    pub estimate: String,
    /// What people call it.
    pub label: String,
}

/// The best of a recording's estimates over all pixels with ground truth, or the only one; `None` where none can be
/// compared with another.
///
/// # Errors
/// As [`answer`](super::answer()); nothing to be scored is one.
pub fn best_value(recording: &Recording, stop: &(dyn Fn() -> bool + Sync)) -> Result<Option<BestValue>, AnalysisError> {
    caught(|| {
        let estimates = estimates(recording.plan())?;
        let scores = scored(recording, &estimates, stop)?;
        let source = source_of(recording);
        let ablation = Ablation::new(recording.plan(), &estimates, &scores, &source, None);
        let rows = ablation.rows(&Selection::default())?;
        let metric = ablation.first_error(&rows);
        let best = Best::of(&ablation, &rows);
        let of = |row: usize| {
            let value = rows[row].values[metric]?;
            let Estimate { lead, name, label, .. } = ablation.estimate(&rows[row]).clone();
            Some(BestValue { metric: ablation.metrics[metric].name, value, lead, estimate: name, label })
        };
        Ok((0..rows.len()).find(|&row| rows.len() == 1 || best.is_best(metric, row)).and_then(of))
    })
}
