//! The leading metric of the table: the order of rows by it, and the significance of differences from the best row.

use std::collections::BTreeMap;

use depthloom_graphs::counted;
use depthloom_recording::Recording;
use depthloom_scores::{Metric, PixelSet};
use serde_json::{Value as Json, json};

use crate::ablation::{Ablation, Row, ScoreTable, Selection};
use crate::compare::{Differences, with_best};
use crate::error::AnalysisError;
use crate::estimates::Estimate;
use crate::tables::best::Mark;

/// The leading metric is the first of these that was scored, or else the first metric of the table.
const LEADING: [&str; 3] = ["abs_rel", "d1", "epe"];

/// The place of the leading metric among metrics; `None` without metrics.
pub(super) fn leading_metric(metrics: &[&Metric]) -> Option<usize> {
    let known = LEADING.iter().find_map(|name| metrics.iter().position(|metric| metric.name == *name));
    known.or((!metrics.is_empty()).then_some(0))
}

/// How to get intervals, which the page of a run does not have because they take time.
const INTERVALS: &str = "Confidence intervals: `depthloom report RUN --ci` adds one to each metric of this table.";

/// Adds to the data of the table: the leading metric, the order of rows with the best first, the verdict on each row,
/// what was tested, and how to get intervals.
///
/// # Errors
/// [`AnalysisError::Stopped`] once `stop` returns true.
pub(super) fn add(
    data: &mut Json,
    table: &ScoreTable,
    recording: &Recording,
    (ablation, estimates): (&Ablation<'_>, &[Estimate]),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(), AnalysisError> {
    let Some(leading) = leading_metric(&table.metrics) else { return Ok(()) };
    data["leading"] = leading.into();
    data["best_first"] = best_first(table, leading).into();
    // The same selection as that of the table, so the same rows in the same order.
    let rows = ablation.rows_on_all_sets(&Selection::default())?;
    let metric = table.metrics[leading];
    let mut compared: Vec<Differences> = Vec::new();
    for group in groups(table, leading, ablation, &rows) {
        let Some(best) = best_of(table, leading, &group) else { continue };
        let others: Vec<usize> = group.iter().copied().filter(|row| *row != best).collect();
        let places: Vec<usize> = others.iter().map(|&row| rows[row].estimate).collect();
        let baseline = (metric, rows[best].set);
        let differences = with_best(recording, (ablation, estimates), baseline, rows[best].estimate, &places, stop)?;
        if differences.too_few.is_none() {
            for (&row, difference) in others.iter().zip(&differences.differences) {
                let Some(difference) = difference else { continue };
                let verdict = if difference.is_equal { "equal" } else { difference.verdict.name() };
                data["rows"][row]["verdict"] = json!({ "name": verdict, "p": difference.p });
            }
        }
        if differences.tests > 0 {
            compared.push(differences);
        }
    }
    let mut texts = texts(metric, &compared);
    if !table.has_intervals() && table.rows.iter().any(|row| row.frames > 1) {
        texts.push(INTERVALS.to_owned());
    }
    data["tested"] = json!(texts);
    Ok(())
}

/// The rows by the leading metric, the best first, stage by stage and pixel set by pixel set: other sets have other
/// values.
fn best_first(table: &ScoreTable, leading: usize) -> Vec<usize> {
    let mut stages: Vec<&str> = Vec::new();
    let keys = table.rows.iter().map(|row| {
        let stage = stages.iter().position(|known| *known == row.key.stage).unwrap_or_else(|| {
            stages.push(&row.key.stage);
            stages.len() - 1
        });
        let value = row.values[leading].filter(|value| value.is_finite());
        let goodness = value.map_or(f64::NEG_INFINITY, |value| table.metrics[leading].goodness(value));
        ((stage, row.set), goodness)
    });
    let keys: Vec<((usize, PixelSet), f64)> = keys.collect();
    let mut order: Vec<usize> = (0..keys.len()).collect();
    order.sort_by(|&a, &b| keys[a].0.cmp(&keys[b].0).then(keys[b].1.total_cmp(&keys[a].1)));
    order
}

/// The rows with a value that can be compared with each other: of one stage, over the same pixels of the same frames.
fn groups(table: &ScoreTable, leading: usize, ablation: &Ablation<'_>, rows: &[Row]) -> Vec<Vec<usize>> {
    let Some(place) = ablation.metrics.iter().position(|known| *known == table.metrics[leading]) else {
        return Vec::new();
    };
    let mut groups: BTreeMap<(&str, PixelSet, usize), Vec<usize>> = BTreeMap::new();
    for (at, (row, shown)) in rows.iter().zip(&table.rows).enumerate() {
        let is_finite = shown.values[leading].is_some_and(f64::is_finite);
        if let (Some(class), true) = (row.comparable_by(place), is_finite) {
            groups.entry((&shown.key.stage, row.set, class)).or_default().push(at);
        }
    }
    groups.into_values().filter(|group| group.len() > 1).collect()
}

/// The row of a group that the table marks as the best, or else the one with the best value.
fn best_of(table: &ScoreTable, leading: usize, group: &[usize]) -> Option<usize> {
    let marked = group.iter().copied().find(|&row| table.rows[row].marks[leading] == Mark::Best);
    let goodness = |row: usize| table.rows[row].values[leading].map(|value| table.metrics[leading].goodness(value));
    marked.or_else(|| group.iter().copied().reduce(|best, row| if goodness(row) > goodness(best) { row } else { best }))
}

/// What was tested, in words, and that there are too few frames where that is so.
fn texts(metric: &Metric, compared: &[Differences]) -> Vec<String> {
    let mut texts = Vec::new();
    let decided = compared.iter().filter(|differences| differences.too_few.is_none());
    if let Some(first) = decided.clone().next() {
        let (level, tests) = (first.level, decided.map(|differences| differences.tests).sum::<usize>());
        texts.push(format!(
            "Significance: {} of each row is compared with that of the best row of the same stage and pixel set, frame by frame (Wilcoxon's signed-rank test, p adjusted by Holm, {}); a row is worse if p is below {level} and the interval of the difference excludes 0. Frames count as independent. The best row was chosen on these frames, so its advantage may be overestimated.",
            metric.plain,
            counted(tests, "test"),
        ));
    }
    let most = |one: &&Differences, two: &&Differences| one.frames.cmp(&two.frames);
    if let Some(few) = compared.iter().filter(|differences| differences.too_few.is_some()).max_by(most) {
        let p = few.too_few.unwrap_or(1.0);
        texts.push(format!(
            "Significance: {} too few to decide whether {} of a row differs from that of the best row. Even if all frames agreed, the adjusted p of Wilcoxon's signed-rank test would be {p:.3}, not below {}.",
            if few.frames == 1 { "1 frame is".to_owned() } else { format!("{} are", counted(few.frames, "frame")) },
            metric.plain,
            few.level,
        ));
    }
    texts
}
