//! Marks the best rows by each metric, only among rows over the same pixels that were scored in the same way.

use std::collections::HashSet;

use super::{Ablation, Row};
use crate::tables::best::{Candidate, Mark, marks};

/// For each metric and row, whether the row is the best or second best among comparable rows.
pub(crate) struct Best(Vec<Vec<Mark>>);

impl Best {
    /// The best rows of each metric, by the [rule for all tables](crate::tables::best).
    pub(crate) fn new(ablation: &Ablation<'_>, rows: &[Row]) -> Self {
        let marks_by_metric = |metric: usize| {
            let candidate = |row: &Row| candidate(ablation, row, metric, row.comparable_by(metric));
            marks(&rows.iter().map(candidate).collect::<Vec<_>>())
        };
        Self((0..ablation.metrics.len()).map(marks_by_metric).collect())
    }

    /// Whether a row has the best value of a metric among two or more comparable rows. All equal rows are best.
    pub(crate) fn is_best(&self, metric: usize, row: usize) -> bool {
        self.mark(metric, row) == Mark::Best
    }

    pub(crate) fn mark(&self, metric: usize, row: usize) -> Mark {
        self.0[metric][row]
    }
}

/// The [goodness](depthloom_scores::Metric::goodness) of a row as a candidate for the best of its class.
pub(super) fn candidate(ablation: &Ablation<'_>, row: &Row, metric: usize, class: Option<usize>) -> Candidate {
    let part = row.part_with(metric);
    let a3 = ablation.metrics.iter().position(|metric| metric.name == "a3");
    let a3 = a3.and_then(|a3| part.values[a3]);
    let value = part.values[metric].map(|value| ablation.metrics[metric].goodness(value));
    Candidate { class, value, a3, density: part.density }
}

/// A note for rows that are not all comparable by one of these metrics.
pub(crate) fn note(rows: &[&Row], metrics: &[usize]) -> Option<String> {
    let classes = |&metric: &usize| -> Vec<usize> {
        let parts = rows.iter().map(|row| row.part_with(metric)).filter(|row| row.values[metric].is_some());
        parts.filter_map(|row| row.comparable).collect()
    };
    let all: Vec<Vec<usize>> = metrics.iter().map(classes).collect();
    let distinct = |classes: &Vec<usize>| classes.iter().collect::<HashSet<_>>().len();
    let most = all.iter().map(distinct).max().unwrap_or(0);
    // A row alone in its group is not marked.
    let has_marks = all.iter().any(|classes| distinct(classes) < classes.len());
    (most > 1).then(|| {
        let marks = if has_marks { "the best of each group is marked" } else { "none is marked as best" };
        format!(
            "the rows form {most} groups that cannot be compared, because frames, pixels or scoring differ: {marks}"
        )
    })
}
