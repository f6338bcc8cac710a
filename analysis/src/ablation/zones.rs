//! The best estimate in each zone.

use depthloom_scores::Pooling;

use super::best::Best;
use super::ranking::keys;
use super::{Ablation, Selection, listed};
use crate::error::AnalysisError;
use crate::grid::{Grid, GridCells, GridColumn};

/// Of the whole image and of each zone, which row is best, and what the row that is best over the whole image has there.
pub(crate) fn grid(ablation: &Ablation<'_>, selection: &Selection, metric: &str) -> Result<Grid, AnalysisError> {
    let column = ablation.column(metric)?;
    let Some(metric) = column.metric() else {
        return Err(AnalysisError::asked(
            format!("`{metric}` is no score: zones have a best of scores alone"),
            format!("there are {}", listed(ablation.metric_names())),
        ));
    };
    if ablation.zones().len() < 2 {
        return Err(AnalysisError::asked(
            "there are no zones: this recording has scores of the whole image alone".to_owned(),
            "declare `zones` where the experiment scores, and run it again".to_owned(),
        ));
    }
    let named = ablation.metrics[metric];
    // Only rows of which the score was taken are told apart.
    let mut all = ablation.rows(&Selection { zone: None, ..selection.clone() })?;
    ablation.require(&all, column)?;
    all.retain(|row| row.values[metric].is_some());
    let mut zones = Vec::new();
    let mut winners = Vec::new();
    let (mut counts, mut values, mut of_overall, mut pixels) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut overall: Option<usize> = None;
    let mut notes = Vec::new();
    let mut about = String::new();
    for &zone in ablation.zones() {
        let here = Selection { zone: (!zone.is_empty()).then(|| zone.to_owned()), ..selection.clone() };
        let Ok(mut rows) = ablation.rows(&here) else {
            notes.push(format!("nothing that is selected was scored in zone {zone}"));
            continue;
        };
        rows.retain(|row| row.values[metric].is_some() || ablation.estimator(row).metrics.contains(&named));
        let best = Best::of(ablation, &rows);
        if zone.is_empty() {
            about = ablation.about(&rows, &here)?;
        }
        let marked: Vec<usize> = (0..rows.len()).filter(|&row| best.is_best(metric, row)).collect();
        if marked.len() > 1 {
            notes.push(format!("in {} {} rows are equally good: the first is named", name(zone), marked.len()));
        }
        let Some(&winner) = marked.first() else {
            notes.push(format!(
                "no best in {}: fewer than two rows can be compared there by {}",
                name(zone),
                named.name
            ));
            continue;
        };
        let estimator = rows[winner].estimator;
        if zone.is_empty() {
            overall = Some(estimator);
        }
        let there = overall.and_then(|overall| rows.iter().find(|row| row.estimator == overall));
        zones.push(Some(name(zone)));
        counts.push(Some(
            rows.iter().filter(|row| row.comparable_by(metric) == rows[winner].comparable_by(metric)).count() as u64,
        ));
        pixels.push(Some(rows[winner].pixels));
        values.push(rows[winner].values[metric]);
        of_overall.push(there.and_then(|row| row.values[metric]));
        winners.push(rows[winner].clone());
    }
    if winners.is_empty() {
        return Err(AnalysisError::asked(
            "there is no best in any zone: no two of the selected rows can be compared".to_owned(),
            format!(
                "two or more estimates over the same pixels are needed: over `--set answered` each has its own{}",
                match named.pooling {
                    Pooling::MeanOfAnswers => format!(", and so has `{}` but over `--set filled`", named.name),
                    _ => String::new(),
                }
            ),
        ));
    }
    let decimals = named.decimals + 1;
    let number = |values: Vec<Option<f64>>| {
        let best = vec![false; values.len()];
        GridCells::Number { decimals, values, best }
    };
    let mut columns = vec![GridColumn::key("zone", zones)];
    columns.extend(keys(ablation, selection, &all, &winners.iter().collect::<Vec<_>>())?);
    columns.push(GridColumn::score(named, number(values)));
    columns.push(GridColumn::of("best_overall", number(of_overall)));
    columns.push(GridColumn::of("rows", GridCells::Count(counts)));
    columns.push(GridColumn::of("pixels", GridCells::Count(pixels)));
    let label = [vec![format!("{}-zones-{}", ablation.experiment, named.name)], selection.label()].concat().join("-");
    let about = format!("best {} in each zone over {about}", named.name);
    Ok(Grid { about, label, columns, notes, ..Grid::default() })
}

fn name(zone: &str) -> String {
    if zone.is_empty() { "whole image".to_owned() } else { zone.to_owned() }
}
