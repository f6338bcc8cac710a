//! Which row is best in what: only among rows over the same pixels, scored in the same way.

use std::collections::HashMap;

use super::{Ablation, Row};

/// By metric and class of comparable rows, the best value.
pub(crate) struct Best {
    /// By row, its class and whether it answered anywhere near the truth.
    rows: Vec<(Option<usize>, bool)>,
    values: Vec<Vec<Option<f64>>>,
    best: HashMap<(usize, usize), f64>,
    classes: usize,
}

impl Best {
    /// The best of each metric.
    ///
    /// What was within a factor of 1.25^3 of the truth nowhere, or never answered, is never best: `silog` would prefer an estimate that
    /// never answered, for a missing answer counts as one constant, and a constant has the truth's spread and no error of its own.
    pub(crate) fn of(ablation: &Ablation<'_>, rows: &[Row]) -> Self {
        let a3 = ablation.metrics.iter().position(|metric| metric.name == "a3");
        let answers = |row: &Row| {
            // Of disparities there is none.
            let near = a3.and_then(|a3| row.values[a3]).is_none_or(|share| share > 0.0);
            near && row.density.is_none_or(|density| density > 0.0)
        };
        let places: Vec<(Option<usize>, bool)> = rows.iter().map(|row| (row.comparable, answers(row))).collect();
        let mut sizes: HashMap<usize, usize> = HashMap::new();
        for class in rows.iter().filter_map(|row| row.comparable) {
            *sizes.entry(class).or_default() += 1;
        }
        let comparable = |row: &Row| -> Vec<Option<f64>> {
            (0..row.values.len())
                .map(|metric| row.values[metric].filter(|_| row.comparable_by(metric).is_some()))
                .collect()
        };
        let values: Vec<Vec<Option<f64>>> = rows.iter().map(comparable).collect();
        let mut best: HashMap<(usize, usize), f64> = HashMap::new();
        for (values, (class, answers)) in values.iter().zip(&places) {
            let Some(class) = class.filter(|class| *answers && sizes[class] > 1) else { continue };
            for (metric, value) in values.iter().enumerate() {
                let Some(value) = value.filter(|value| value.is_finite()) else { continue };
                let more = ablation.metrics[metric].more_is_better;
                let known = best.entry((metric, class)).or_insert(value);
                *known = if more { known.max(value) } else { known.min(value) };
            }
        }
        Self { rows: places, values, best, classes: sizes.len() }
    }

    /// Whether a row has the best value of a metric among two or more that are comparable; equals are all best.
    pub(crate) fn is_best(&self, metric: usize, row: usize) -> bool {
        let (Some(class), true) = self.rows[row] else { return false };
        self.best.get(&(metric, class)).is_some_and(|best| self.values[row][metric] == Some(*best))
    }

    /// What is to be said where not all rows are comparable.
    pub(crate) fn note(&self) -> Option<String> {
        (self.classes > 1).then(|| {
            format!(
                "rows are of {} kinds that cannot be compared, for they are over other frames or pixels or scored in another way: each has its best",
                self.classes
            )
        })
    }
}
