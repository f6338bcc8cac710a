//! The best estimate in each zone.

use depthloom_scores::Pooling;

use super::best::Best;
use super::ranking::keys;
use super::{Ablation, Row, Selection};
use crate::error::{AnalysisError, listed};
use crate::tables::{Rows, Table};

/// The best row in the whole image and in each zone, with the value there of the row that is best over the whole image.
pub(crate) fn table(ablation: &Ablation<'_>, selection: &Selection, metric: &str) -> Result<Table, AnalysisError> {
    let column = ablation.measure(metric)?;
    let Some(metric) = column.metric() else {
        return Err(AnalysisError::request(
            format!("`{metric}` is not a metric: `--best-per-zone` needs a metric"),
            format!("available: {}", listed(ablation.metric_names())),
        ));
    };
    if ablation.zones().len() < 2 {
        return Err(AnalysisError::request(
            "there are no zones: this recording has scores only for the whole image".to_owned(),
            "declare `zones` in the score of the experiment, and run it again".to_owned(),
        ));
    }
    let named = ablation.metrics[metric];
    // Only rows with this metric are identified by their axes.
    let mut all = ablation.rows(&Selection { zone: None, ..selection.clone() })?;
    ablation.require(&all, column)?;
    all.retain(|row| row.values[metric].is_some());
    let mut winners: Vec<Winner> = Vec::new();
    let mut overall: Option<usize> = None;
    let mut notes = Vec::new();
    let mut about = String::new();
    for &zone in ablation.zones() {
        let here = Selection { zone: (!zone.is_empty()).then(|| zone.to_owned()), ..selection.clone() };
        let Ok(mut rows) = ablation.rows(&here) else {
            notes.push(format!("no selected estimate was scored in zone {zone}"));
            continue;
        };
        rows.retain(|row| row.values[metric].is_some() || ablation.estimate(row).metrics.contains(&named));
        let best = Best::new(ablation, &rows);
        if zone.is_empty() {
            about = ablation.about(&rows, &here)?;
        }
        let marked: Vec<usize> = (0..rows.len()).filter(|&row| best.is_best(metric, row)).collect();
        if marked.len() > 1 {
            notes.push(format!("in {}, {} rows are equally good: the first is shown", name(zone), marked.len()));
        }
        let Some(&winner) = marked.first() else {
            notes.push(format!(
                "no best in {}: fewer than two rows can be compared there by {}",
                name(zone),
                named.name
            ));
            continue;
        };
        let estimate = rows[winner].estimate;
        if zone.is_empty() {
            overall = Some(estimate);
        }
        let there = overall.and_then(|overall| rows.iter().find(|row| row.estimate == overall));
        let class = rows[winner].comparable_by(metric);
        winners.push(Winner {
            zone: name(zone),
            best_overall: there.and_then(|row| row.values[metric]),
            rows: rows.iter().filter(|row| row.comparable_by(metric) == class).count() as u64,
            row: rows.swap_remove(winner),
        });
    }
    if winners.is_empty() {
        return Err(AnalysisError::request(
            "no zone has a best row: no two of the selected rows can be compared".to_owned(),
            format!(
                "select two or more estimates over the same pixels: with `--pixels valid` each has its own pixels{}",
                match named.pooling {
                    Pooling::MeanOfValid => format!(", and `{}` needs `--pixels filled`", named.name),
                    _ => String::new(),
                }
            ),
        ));
    }
    let rows = Rows(&winners);
    let mut columns = vec![rows.key("zone", |winner| &winner.zone)];
    columns.extend(keys(ablation, selection, &all, &winners.iter().map(|winner| &winner.row).collect::<Vec<_>>()));
    columns.extend([
        rows.metric(named, |winner| winner.row.values[metric]),
        rows.number("best_overall", |winner| winner.best_overall).decimals(named.decimals + 1),
        rows.count("rows", |winner| winner.rows),
        rows.count("pixels", |winner| winner.row.pixels),
    ]);
    let label = [vec![format!("{}-zones-{}", ablation.experiment, named.name)], selection.label()].concat().join("-");
    let about = format!("best {} in each zone over {about}", named.name);
    Ok(Table { about, label, notes, ..Table::new(columns) })
}

/// The best row in a zone.
struct Winner {
    zone: String,
    row: Row,
    /// The value in this zone of the row that is best over the whole image.
    best_overall: Option<f64>,
    /// The number of comparable rows, including itself.
    rows: u64,
}

fn name(zone: &str) -> String {
    if zone.is_empty() { "whole image".to_owned() } else { zone.to_owned() }
}
