//! Which row is best in what: only among rows over the same pixels, scored in the same way.

use std::collections::HashSet;

use super::{Ablation, Row};
use crate::tables::best::{Candidate, best};

/// By row and metric, whether it is the best among comparable rows.
pub(crate) struct Best(Vec<Vec<bool>>);

impl Best {
    /// The best of each metric, by the [one rule](crate::tables::best).
    pub(crate) fn of(ablation: &Ablation<'_>, rows: &[Row]) -> Self {
        let of_metric = |metric: usize| {
            let candidate = |row: &Row| candidate(ablation, row, metric, row.comparable_by(metric));
            best(&rows.iter().map(candidate).collect::<Vec<_>>(), ablation.metrics[metric].more_is_better)
        };
        Self((0..ablation.metrics.len()).map(of_metric).collect())
    }

    /// Whether a row has the best value of a metric among two or more that are comparable; equals are all best.
    pub(crate) fn is_best(&self, metric: usize, row: usize) -> bool {
        self.0[metric][row]
    }
}

/// A row's value of a metric as one that may be the best of a class.
pub(super) fn candidate(ablation: &Ablation<'_>, row: &Row, metric: usize, class: Option<usize>) -> Candidate {
    let part = row.of(metric);
    let a3 = ablation.metrics.iter().position(|metric| metric.name == "a3");
    let a3 = a3.and_then(|a3| part.values[a3]);
    Candidate { class, value: part.values[metric], a3, density: part.density }
}

/// What is to be said where not all of some rows are comparable by one of some metrics.
pub(crate) fn note(rows: &[&Row], metrics: &[usize]) -> Option<String> {
    let classes = |&metric: &usize| {
        let of = rows.iter().map(|row| row.of(metric)).filter(|row| row.values[metric].is_some());
        of.filter_map(|row| row.comparable).collect::<HashSet<usize>>().len()
    };
    let most = metrics.iter().map(classes).max().unwrap_or(0);
    (most > 1).then(|| {
        format!(
            "rows are of {most} kinds that cannot be compared, for they are over other frames or pixels or scored in another way: each has its best"
        )
    })
}
