//! Which row is best in what: only among rows over the same pixels, scored in the same way.

use std::collections::{HashMap, HashSet};

use super::{Ablation, Row};

/// By metric and class of comparable rows, the best value.
pub(crate) struct Best {
    /// By row and metric: its class, and the value with which it competes there.
    competing: Vec<Vec<Option<(usize, f64)>>>,
    best: HashMap<(usize, usize), f64>,
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
            let near = a3.and_then(|a3| row.value(a3)).is_none_or(|share| share > 0.0);
            near && row.density.is_none_or(|density| density > 0.0)
        };
        let mut sizes: HashMap<usize, usize> = HashMap::new();
        for class in rows.iter().flat_map(Row::parts).filter_map(|row| row.comparable) {
            *sizes.entry(class).or_default() += 1;
        }
        let competes = |row: &Row, metric: usize| {
            let part = row.of(metric);
            let class = part.comparable_by(metric).filter(|class| sizes[class] > 1 && answers(part))?;
            part.values[metric].filter(|value| value.is_finite()).map(|value| (class, value))
        };
        let competing: Vec<Vec<Option<(usize, f64)>>> =
            rows.iter().map(|row| (0..row.values.len()).map(|metric| competes(row, metric)).collect()).collect();
        let mut best: HashMap<(usize, usize), f64> = HashMap::new();
        for values in &competing {
            for (metric, value) in values.iter().enumerate() {
                let Some((class, value)) = *value else { continue };
                let more = ablation.metrics[metric].more_is_better;
                let known = best.entry((metric, class)).or_insert(value);
                *known = if more { known.max(value) } else { known.min(value) };
            }
        }
        Self { competing, best }
    }

    /// Whether a row has the best value of a metric among two or more that are comparable; equals are all best.
    pub(crate) fn is_best(&self, metric: usize, row: usize) -> bool {
        self.competing[row][metric].is_some_and(|(class, value)| self.best.get(&(metric, class)) == Some(&value))
    }
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
