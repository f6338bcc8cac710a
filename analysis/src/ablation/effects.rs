//! The effect of each axis on a score or a cost as a table: marginal means by level, and shares of the variance.

use super::factor::Factor;
use super::front::Better;
use super::measure::Measure;
use super::variance::{Effects, MeansOf, effects};
use super::{Ablation, Row, Selection};
use crate::error::AnalysisError;
use crate::tables::{Column, Format, Rows, Table};
use depthloom_graphs::counted;

/// Levels that are numbers are taken together in so many ranges where nearly every row has one of its own.
const RANGES: usize = 4;
/// So many interactions of two axes are named, if they explain at least this share.
const PAIRS: usize = 3;
const LEAST_PAIR: f64 = 0.005;

/// An axis as it is looked at: the names of its levels, and the level of each row.
struct Looked {
    name: String,
    levels: Vec<String>,
    /// `None`: the row is not on this axis.
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

/// What each axis did to a score or a cost: of each level how many rows, their mean and how far that is from the mean
/// of all rows with the axis; of each axis its share of the variance, the largest first.
pub(crate) fn table(ablation: &Ablation<'_>, selection: &Selection, of: &str) -> Result<Table, AnalysisError> {
    let column = ablation.goal_measure(of, "effects are")?;
    let all = ablation.rows(selection)?;
    ablation.require(&all, column)?;
    // Of a score, the rows of which it was taken.
    let was_taken = |row: &Row| match column.metric() {
        Some(metric) => {
            row.values[metric].is_some() || ablation.estimate(row).metrics.contains(&ablation.metrics[metric])
        }
        None => true,
    };
    let all: Vec<Row> = all.into_iter().filter(was_taken).collect();
    let has_axis = |row: &&Row| (0..ablation.axes.len()).any(|axis| ablation.level(row, axis).is_some());
    let value = |row: &Row| ablation.number(row, column).filter(|value| value.is_finite());
    let rows: Vec<&Row> = all.iter().filter(has_axis).filter(|row| value(row).is_some()).collect();
    let looked = looked_at(ablation, &rows);
    if looked.is_empty() {
        return Err(AnalysisError::asked(
            "there is no axis to see the effect of: the selected estimates do not differ on any".to_owned(),
            "`matrix` and `variants` make axes; `--estimates` may have left one value of each".to_owned(),
        ));
    }
    let values: Vec<f64> = rows.iter().filter_map(|row| value(row)).collect();
    let factors: Vec<Factor> =
        looked.iter().map(|axis| Factor { levels: axis.levels.len(), of_row: axis.of_row.clone() }).collect();
    let found = effects(&values, &factors);

    let (named, more_is_better) = (ablation.measure_name(column), ablation.better(column) == Better::More);
    // Time is time, whatever was scored.
    let comparable = |row: &Row| match column {
        Measure::Ms => Some(0),
        Measure::Metric(metric) => row.comparable_by(metric),
        _ => row.comparable,
    };
    let is_comparable = rows.iter().all(|row| comparable(row).is_some() && comparable(row) == comparable(rows[0]));
    let lines = lines(&looked, &found, more_is_better, is_comparable);
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
            "effect of each axis on {named}{}; {} rows, mean {:.decimals$}, standard deviation {:.decimals$}; share: of the variance between \
             rows (eta squared)",
            match column {
                Measure::Ms => ", core-milliseconds a frame".to_owned(),
                _ => format!(" over {}", ablation.about(&all, selection)?),
            },
            rows.len(),
            found.mean,
            found.deviation,
        ),
        label: [vec![format!("{}-effects-{of}", ablation.experiment)], selection.label()].concat().join("-"),
        gaps: places(|line| line.has_gap),
        starts: places(|line| line.is_start),
        notes: notes(ablation, &all, &rows, &looked, &found, is_comparable),
        ..Table::new(vec![
            cells.key("axis", |line| &line.axis).once(),
            Column::levels("level", levels, |line| lines[line].level_is_number),
            cells.count("rows", |line| line.rows),
            mean.marked(lines.iter().map(|line| line.is_best).collect()),
            cells.number("difference", |line| line.difference).decimals(decimals),
            cells.share("share", |line| line.share).once(),
        ])
    })
}

/// The axes on which rows differ, the estimate's name among them where there are several.
fn looked_at(ablation: &Ablation<'_>, rows: &[&Row]) -> Vec<Looked> {
    let mut looked = Vec::new();
    for (axis, named) in ablation.axes.iter().enumerate() {
        let of_row = rows.iter().map(|row| ablation.level(row, axis));
        looked.extend(differing(&named.name, of_row, named.is_numeric, |level| named.levels[level].clone()));
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
    looked.extend(differing("estimate", of_row.into_iter().map(Some), false, |level| names[level].to_owned()));
    looked
}

/// An axis, if the rows that have it differ on it: with the levels that they have.
fn differing(
    name: &str,
    of_row: impl Iterator<Item = Option<usize>>,
    is_numeric: bool,
    level_name: impl Fn(usize) -> String,
) -> Option<Looked> {
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
    let looked = Looked { name: name.to_owned(), levels, of_row, is_numeric, in_ranges: false };
    Some(in_ranges(&looked).unwrap_or(looked))
}

/// An axis of numbers of which nearly every row has one of its own, in ranges of as many rows; `None` of others.
fn in_ranges(axis: &Looked) -> Option<Looked> {
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
    Some(Looked {
        name: axis.name.clone(),
        levels: (0..firsts.len()).map(name).collect(),
        of_row: axis.of_row.iter().map(|level| level.map(|level| range(numbers[level]))).collect(),
        is_numeric: false,
        in_ranges: true,
    })
}

fn lines(looked: &[Looked], found: &Effects, more_is_better: bool, is_comparable: bool) -> Vec<Line> {
    let mut order: Vec<usize> = (0..looked.len()).collect();
    let share = |axis: usize| found.factors[axis].share.unwrap_or(-1.0);
    order.sort_by(|&a, &b| share(b).total_cmp(&share(a)));
    let mut lines = Vec::new();
    for axis in order {
        let effect = &found.factors[axis];
        let means = effect.levels.iter().filter_map(|(_, mean)| *mean);
        let best = if more_is_better { means.reduce(f64::max) } else { means.reduce(f64::min) };
        lines.extend(effect.levels.iter().enumerate().map(|(level, (rows, mean))| Line {
            axis: looked[axis].name.clone(),
            level: Some(looked[axis].levels[level].clone()),
            level_is_number: looked[axis].is_numeric,
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
    if let Some(left) = found.left.filter(|_| looked.len() > 1) {
        lines.push(others("interactions".to_owned(), left, true));
        let told = found.pairs.iter().take(PAIRS).filter(|(.., share)| *share >= LEAST_PAIR);
        lines.extend(
            told.map(|(a, b, share)| others(format!("{} x {}", looked[*a].name, looked[*b].name), *share, false)),
        );
    }
    lines
}

fn notes(
    ablation: &Ablation<'_>,
    all: &[Row],
    rows: &[&Row],
    looked: &[Looked],
    found: &Effects,
    is_comparable: bool,
) -> Vec<String> {
    let mut notes = Vec::new();
    let shared = all.iter().filter(|row| (0..ablation.axes.len()).all(|axis| ablation.level(row, axis).is_none()));
    let mut shared: Vec<&str> = shared.map(|row| ablation.estimate(row).label.as_str()).collect();
    shared.dedup();
    if !shared.is_empty() {
        notes.push(format!("left out, for no axis changes it: {}", shared.join(", ")));
    }
    let without = all.len() - shared.len() - rows.len();
    if without > 0 {
        notes.push(format!("left out: {} without a value", counted(without, "row")));
    }
    if !is_comparable {
        notes.push(
            "rows are not over the same pixels scored in the same way: differences are not the axes' alone".to_owned(),
        );
    }
    for axis in looked {
        let have = axis.of_row.iter().flatten().count();
        if have < rows.len() {
            notes.push(format!(
                "{} is there in {have} of {} rows: its means and differences are over those, its share of the variance between all",
                axis.name,
                rows.len()
            ));
        }
    }
    let ranges: Vec<&str> = looked.iter().filter(|axis| axis.in_ranges).map(|axis| axis.name.as_str()).collect();
    if !ranges.is_empty() {
        notes.push(format!(
            "nearly every row has a value of its own of {}: taken together in ranges",
            ranges.join(", ")
        ));
    }
    let single =
        looked.iter().zip(&found.factors).filter(|(_, effect)| effect.levels.iter().all(|(rows, _)| *rows <= 1));
    for (axis, _) in single {
        notes
            .push(format!("no share of {}: every row has a level of its own, which would explain anything", axis.name));
    }
    let named = |of: MeansOf| {
        let some = looked.iter().zip(&found.factors).filter(|(_, effect)| effect.means == of);
        some.map(|(axis, _)| axis.name.as_str()).collect::<Vec<_>>().join(", ")
    };
    let adjusted = named(MeansOf::LeastSquares);
    if !adjusted.is_empty() {
        notes.push(format!(
            "means of {adjusted} are adjusted by least squares for the settings of the other axes, which are not the same at each level"
        ));
    }
    let confounded = named(MeansOf::Confounded);
    if !confounded.is_empty() {
        notes.push(format!(
            "the rows do not tell {confounded} from the other axes: its means are over different settings, and none is marked as best"
        ));
    }
    if !found.is_orthogonal {
        notes.push(
            "not every level of an axis meets those of the others in the same proportions: shares overlap, and do not add up".to_owned(),
        );
    }
    notes
}
