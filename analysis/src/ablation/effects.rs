//! The effect of each axis on a score or a cost as a table: marginal means by level, and shares of the variance.

use super::factor::Factor;
use super::front::Better;
use super::measure::Measure;
use super::variance::{Effects, MeansOf, effects};
use super::{Ablation, Row, Selection};
use crate::error::AnalysisError;
use crate::tables::{Column, Format, Rows, Table};
use depthloom_graphs::counted;

/// The number of ranges into which a numeric axis is grouped if nearly every row has its own level.
const RANGES: usize = 4;
/// The maximum number of interactions of two axes that are shown, and the smallest share that is shown.
const PAIRS: usize = 3;
const LEAST_PAIR: f64 = 0.005;

/// An axis of the table: the names of its levels, and the level of each row.
struct AxisLevels {
    name: String,
    levels: Vec<String>,
    /// `None` if the row does not have this axis.
    of_row: Vec<Option<usize>>,
    is_numeric: bool,
    in_ranges: bool,
}

/// A line of the table.
#[derive(Default)]
struct Line {
    axis: String,
    level: Option<String>,
    level_is_number: bool,
    rows: Option<u64>,
    mean: Option<f64>,
    difference: Option<f64>,
    share: Option<f64>,
    is_best: bool,
    is_start: bool,
    has_gap: bool,
}

/// The effect of each axis on a metric or a cost. Each level has the number of its rows, their mean, and the difference
/// from the mean of all rows with the axis. Each axis has its share of the variance, the largest first.
pub(crate) fn table(ablation: &Ablation<'_>, selection: &Selection, measure: &str) -> Result<Table, AnalysisError> {
    let column = ablation.goal_measure(measure, "`--effects`")?;
    let all = ablation.rows(selection)?;
    ablation.require(&all, column)?;
    // A row without the metric does not take part.
    let has_metric = |row: &Row| match column.metric() {
        Some(metric) => {
            row.values[metric].is_some() || ablation.estimate(row).metrics.contains(&ablation.metrics[metric])
        }
        None => true,
    };
    let all: Vec<Row> = all.into_iter().filter(has_metric).collect();
    let has_axis = |row: &&Row| (0..ablation.axes.len()).any(|axis| ablation.level(row, axis).is_some());
    let value = |row: &Row| ablation.number(row, column).filter(|value| value.is_finite());
    let rows: Vec<&Row> = all.iter().filter(has_axis).filter(|row| value(row).is_some()).collect();
    let axes = differing_axes(ablation, &rows);
    if axes.is_empty() {
        return Err(AnalysisError::request(
            "no axis has an effect: the selected estimates do not differ on any axis".to_owned(),
            "declare axes with `matrix:` or `variants:`, or select more estimates with `--estimates`".to_owned(),
        ));
    }
    let values: Vec<f64> = rows.iter().filter_map(|row| value(row)).collect();
    let factors: Vec<Factor> =
        axes.iter().map(|axis| Factor { levels: axis.levels.len(), of_row: axis.of_row.clone() }).collect();
    let found = effects(&values, &factors);

    let (named, more_is_better) = (ablation.measure_name(column), ablation.better(column) == Better::More);
    // CPU times are comparable, whatever was scored.
    let comparable = |row: &Row| match column {
        Measure::Ms => Some(0),
        Measure::Metric(metric) => row.comparable_by(metric),
        _ => row.comparable,
    };
    let is_comparable = rows.iter().all(|row| comparable(row).is_some() && comparable(row) == comparable(rows[0]));
    let lines = lines(&axes, &found, more_is_better, is_comparable);
    let decimals = ablation.decimals(column);
    let cells = Rows(&lines);
    let mean = cells.number(named, |line| line.mean).better(more_is_better).decimals(decimals);
    let mean = match column {
        Measure::Metric(metric) => mean.metric(ablation.metrics[metric]),
        Measure::Ms => mean.format(Format::Fixed(decimals)),
        _ => mean,
    };
    let levels = lines.iter().map(|line| line.level.clone());
    let places = |is_place: fn(&Line) -> bool| (0..lines.len()).filter(|&line| is_place(&lines[line])).collect();
    Ok(Table {
        about: format!(
            "effect of each axis on {named}{}; {} rows, mean {:.decimals$}, standard deviation {:.decimals$}; share: share of the variance between \
             rows (eta squared)",
            match column {
                Measure::Ms => ", core-milliseconds per frame".to_owned(),
                _ => format!(" over {}", ablation.about(&all, selection)?),
            },
            rows.len(),
            found.mean,
            found.deviation,
        ),
        label: [vec![format!("{}-effects-{measure}", ablation.experiment)], selection.label()].concat().join("-"),
        gaps: places(|line| line.has_gap),
        starts: places(|line| line.is_start),
        notes: notes(ablation, &all, &rows, &axes, &found, is_comparable),
        ..Table::new(vec![
            cells.key("axis", |line| &line.axis).once(),
            Column::levels("level", levels, |line| lines[line].level_is_number),
            cells.count("rows", |line| line.rows),
            mean.marked(lines.iter().map(|line| line.is_best.into()).collect()),
            cells.number("difference", |line| line.difference).decimals(decimals),
            cells.share("share", |line| line.share).once(),
        ])
    })
}

/// The axes on which rows differ. The name of the estimate is one of them if there are several.
fn differing_axes(ablation: &Ablation<'_>, rows: &[&Row]) -> Vec<AxisLevels> {
    let mut axes = Vec::new();
    for (axis, named) in ablation.axes.iter().enumerate() {
        let of_row = rows.iter().map(|row| ablation.level(row, axis));
        axes.extend(differing(&named.name, of_row, named.is_numeric, |level| named.levels[level].clone()));
    }
    let mut names: Vec<&str> = Vec::new();
    let of_row: Vec<usize> = rows
        .iter()
        .map(|row| {
            let name = ablation.estimate(row).name.as_str();
            names.iter().position(|known| *known == name).unwrap_or_else(|| {
                names.push(name);
                names.len() - 1
            })
        })
        .collect();
    axes.extend(differing("estimate", of_row.into_iter().map(Some), false, |level| names[level].to_owned()));
    axes
}

/// An axis with the levels of its rows, if these rows differ on it.
fn differing(
    name: &str,
    of_row: impl Iterator<Item = Option<usize>>,
    is_numeric: bool,
    level_name: impl Fn(usize) -> String,
) -> Option<AxisLevels> {
    let of_row: Vec<Option<usize>> = of_row.collect();
    let mut present: Vec<usize> = of_row.iter().copied().flatten().collect();
    present.sort_unstable();
    present.dedup();
    if present.len() < 2 {
        return None;
    }
    let levels: Vec<String> = present.iter().copied().map(level_name).collect();
    let place = |level: usize| present.binary_search(&level).ok();
    let of_row = of_row.into_iter().map(|level| level.and_then(place)).collect();
    let axis = AxisLevels { name: name.to_owned(), levels, of_row, is_numeric, in_ranges: false };
    Some(in_ranges(&axis).unwrap_or(axis))
}

/// A numeric axis on which nearly every row has its own level, grouped in ranges of equal row counts. `None` for other
/// axes.
fn in_ranges(axis: &AxisLevels) -> Option<AxisLevels> {
    let rows = axis.of_row.iter().flatten().count();
    if !axis.is_numeric || axis.levels.len() < 2 * RANGES || rows >= 2 * axis.levels.len() {
        return None;
    }
    let numbers: Vec<f64> = axis.levels.iter().map(|level| level.parse().ok()).collect::<Option<_>>()?;
    let mut sorted: Vec<f64> = axis.of_row.iter().flatten().map(|&level| numbers[level]).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    // Equal numbers stay in one range.
    let mut firsts: Vec<f64> = (0..RANGES).map(|range| sorted[range * sorted.len() / RANGES]).collect();
    firsts.dedup();
    let range = |number: f64| firsts.iter().rposition(|first| *first <= number).unwrap_or(0);
    let name = |of: usize| {
        let inside = || sorted.iter().copied().filter(|number| range(*number) == of);
        format!("{} to {}", inside().fold(f64::INFINITY, f64::min), inside().fold(f64::NEG_INFINITY, f64::max))
    };
    Some(AxisLevels {
        name: axis.name.clone(),
        levels: (0..firsts.len()).map(name).collect(),
        of_row: axis.of_row.iter().map(|level| level.map(|level| range(numbers[level]))).collect(),
        is_numeric: false,
        in_ranges: true,
    })
}

fn lines(axes: &[AxisLevels], found: &Effects, more_is_better: bool, is_comparable: bool) -> Vec<Line> {
    let mut order: Vec<usize> = (0..axes.len()).collect();
    let share = |axis: usize| found.factors[axis].share.unwrap_or(-1.0);
    order.sort_by(|&a, &b| share(b).total_cmp(&share(a)));
    let mut lines = Vec::new();
    for axis in order {
        let effect = &found.factors[axis];
        let means = effect.levels.iter().filter_map(|(_, mean)| *mean);
        let best = if more_is_better { means.reduce(f64::max) } else { means.reduce(f64::min) };
        lines.extend(effect.levels.iter().enumerate().map(|(level, (rows, mean))| Line {
            axis: axes[axis].name.clone(),
            level: Some(axes[axis].levels[level].clone()),
            level_is_number: axes[axis].is_numeric,
            rows: Some(*rows as u64),
            mean: *mean,
            difference: mean.map(|mean| mean - effect.mean),
            share: effect.share,
            is_best: is_comparable && effect.means != MeansOf::Confounded && *mean == best,
            is_start: level == 0,
            has_gap: level == 0,
        }));
    }
    let others = |axis: String, share: f64, has_gap: bool| Line {
        axis,
        share: Some(share),
        is_start: true,
        has_gap,
        ..Line::default()
    };
    if let Some(residual) = found.residual.filter(|_| axes.len() > 1) {
        lines.push(others("interactions".to_owned(), residual, true));
        let largest = found.pairs.iter().take(PAIRS).filter(|(.., share)| *share >= LEAST_PAIR);
        lines.extend(
            largest.map(|(a, b, share)| others(format!("{} x {}", axes[*a].name, axes[*b].name), *share, false)),
        );
    }
    lines
}

fn notes(
    ablation: &Ablation<'_>,
    all: &[Row],
    rows: &[&Row],
    axes: &[AxisLevels],
    found: &Effects,
    is_comparable: bool,
) -> Vec<String> {
    let mut notes = Vec::new();
    let shared = all.iter().filter(|row| (0..ablation.axes.len()).all(|axis| ablation.level(row, axis).is_none()));
    let mut shared: Vec<&str> = shared.map(|row| ablation.estimate(row).label.as_str()).collect();
    shared.dedup();
    if !shared.is_empty() {
        notes.push(format!("excluded, because no axis changes it: {}", shared.join(", ")));
    }
    let without = all.len() - shared.len() - rows.len();
    if without > 0 {
        notes.push(format!("excluded: {} without a value", counted(without, "row")));
    }
    if !is_comparable {
        notes.push(
            "the rows differ in pixels or scoring, so the differences are not only effects of the axes".to_owned(),
        );
    }
    for axis in axes {
        let have = axis.of_row.iter().flatten().count();
        if have < rows.len() {
            notes.push(format!(
                "{have} of {} rows have the axis {}: its means and differences cover these rows, its share is of the variance between all rows",
                rows.len(),
                axis.name
            ));
        }
    }
    let ranges: Vec<&str> = axes.iter().filter(|axis| axis.in_ranges).map(|axis| axis.name.as_str()).collect();
    if !ranges.is_empty() {
        notes.push(format!(
            "nearly every row has its own level of {}: the levels are grouped in ranges",
            ranges.join(", ")
        ));
    }
    let single = axes.iter().zip(&found.factors).filter(|(_, effect)| effect.levels.iter().all(|(rows, _)| *rows <= 1));
    for (axis, _) in single {
        notes
            .push(format!("no share for {}: every row has its own level, which would explain any variance", axis.name));
    }
    let names = |means: MeansOf| {
        let matching = axes.iter().zip(&found.factors).filter(|(_, effect)| effect.means == means);
        matching.map(|(axis, _)| axis.name.as_str()).collect::<Vec<_>>().join(", ")
    };
    let adjusted = names(MeansOf::LeastSquares);
    if !adjusted.is_empty() {
        notes.push(format!(
            "means of {adjusted} are adjusted by least squares for the settings of the other axes, which are not the same at each level"
        ));
    }
    let confounded = names(MeansOf::Confounded);
    if !confounded.is_empty() {
        notes.push(format!(
            "the effect of {confounded} cannot be separated from the other axes: its means cover different settings, and none is marked as best"
        ));
    }
    if !found.is_orthogonal {
        notes.push(
            "the levels of the axes are not combined in equal proportions: shares overlap and do not add up".to_owned(),
        );
    }
    notes
}
