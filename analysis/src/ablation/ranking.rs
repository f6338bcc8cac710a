//! The rows of an ablation, sorted, cut and in columns.

use std::collections::HashMap;

use depthloom_graphs::counted;
use depthloom_scores::{Family, PixelSet};

use super::best::{self, Best};
use super::column::{Column, Part};
use super::front::{Better, Goal, front};
use super::joined::joined;
use super::{Ablation, Row, Selection, listed};
use crate::error::AnalysisError;
use crate::grid::{Grid, GridCells, GridColumn};
use crate::leading::{COMMON, LEADING};
use crate::sheet::DIMENSIONLESS;
use crate::sheet::unit_of;
use crate::statistics::{Interval, Resampling, Statistic, Weighted};

/// Rows whose cost differs by no more than this share are equally fast: timings of one run vary by as much.
pub(super) const TIMING_NOISE: f64 = 0.05;

/// A table with a row an estimator, or a depth and the disparity it was computed from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranking {
    /// What to sort by: a score or a column of numbers, best first; or an axis, numbers by size, others in the file's order. `None`: by the first error that was
    /// shown and that a row has, `abs_rel` before others.
    pub sort: Option<String>,
    /// How many rows are shown at most.
    pub top: Option<usize>,
    /// The columns behind the axes; empty: all scores, `density` where not every pixel was answered, and `ms` where it is known.
    pub columns: Vec<String>,
    /// Columns on whose Pareto front the rows are to be; empty: all rows.
    pub pareto: Vec<String>,
    /// How frames are resampled for an interval beside each score; `None`: there are none.
    pub intervals: Option<Resampling>,
}

impl Ranking {
    /// The table of the selected rows; `stop` is asked while frames are resampled.
    pub(crate) fn grid(
        &self,
        ablation: &Ablation<'_>,
        selection: &Selection,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Grid, AnalysisError> {
        let selection = &self.with_depths(selection);
        let (rows, left_out) = self.rows(ablation, ablation.rows(selection)?)?;
        let mut about = ablation.about(&rows, selection)?;
        let all = rows.len();
        let sort = match (&self.sort, self.pareto.first()) {
            (Some(name), _) | (None, Some(name)) => ablation.column(name)?,
            (None, None) => self.sort_of_itself(ablation, &rows)?,
        };
        let by = ablation.column_name(sort);
        let mut order: Vec<usize> = (0..rows.len()).collect();
        let mut grid_notes = Vec::new();
        if !self.pareto.is_empty() {
            order = ablation.front(&rows, &self.pareto)?;
            let rows = counted(order.len(), "row");
            about.push_str(&format!("; the {rows} on the Pareto front of {}", self.pareto.join(" and ")));
        }
        if self.pareto.iter().any(|name| name == "ms") {
            let percent = 100.0 * TIMING_NOISE;
            grid_notes.push(format!("on the front, costs that differ by no more than {percent} % are equal"));
        }
        ablation.require(&rows, sort)?;
        ablation.sort(&rows, &mut order, sort);
        let best = Best::of(ablation, &rows);
        let label = self.label(ablation, selection);
        let mut grid = Grid { label, notes: grid_notes, ..Grid::default() };
        if let Some(top) = self.top.filter(|&top| top < order.len()) {
            about.push_str(&format!("; the first {top} of {} rows by {by}", order.len()));
            let without = order[top..].iter().filter(|&&row| ablation.number(&rows[row], sort).is_none()).count();
            if without > 0 {
                grid.notes.push(format!("{without} of the rows that are not shown have no {by}: they come last"));
            }
            order.truncate(top);
        } else if self.pareto.is_empty() {
            about.push_str(&format!("; {} by {by}", counted(all, "row")));
        }
        grid.about = about;
        let shown: Vec<&Row> = order.iter().map(|&row| &rows[row]).collect();
        grid.columns = keys(ablation, selection, &rows, &shown)?;
        let zone = GridColumn::key("zone", vec![selection.zone.clone(); shown.len()]);
        grid.columns.insert(LEADING.len(), GridColumn { only_in_files: true, ..zone });
        let columns = self.columns(ablation, &rows)?;
        if columns.contains(&Column::Ms) {
            grid.notes.push(
                "ms: processor time of all nodes that an estimate is computed from, core-milliseconds a frame"
                    .to_owned(),
            );
        }
        for column in &columns {
            grid.columns.push(ablation.cells(&rows, &order, *column, &best));
            if let (Some(metric), Some(resampling)) = (column.metric(), &self.intervals) {
                grid.columns.extend(intervals(ablation, selection, metric, &shown, resampling, stop)?);
            }
        }
        if let Some(resampling) = &self.intervals {
            grid.notes.push(format!("intervals: {}", resampling.about()));
        }
        if columns.contains(&Column::Density(Part::Disparity)) {
            grid.notes.push(
                "a row is of a depth and of the disparity it was made of: density is the depth's, disparity_density the disparity's"
                    .to_owned(),
            );
        }
        if left_out > 0 {
            let rows = counted(left_out, "row");
            grid.notes.push(format!("left out: {rows} of which none of these scores was taken"));
        }
        if rows.iter().all(|row| row.set == PixelSet::Answered) && rows.len() > 1 {
            grid.notes.push(
                "each row is over the pixels that it answered itself, so nothing is marked as best: look at density"
                    .to_owned(),
            );
        }
        let metrics: Vec<usize> = columns.iter().filter_map(|column| column.metric()).collect();
        let is_partial = |metric: usize| {
            let mut parts = rows.iter().map(|row| row.of(metric));
            parts.any(|row| row.comparable.is_some() && row.over_answers[metric])
        };
        for metric in metrics.iter().copied().filter(|metric| is_partial(*metric)) {
            let name = ablation.metrics[metric].name;
            grid.notes.push(format!(
                "{name} leaves out what was not answered, also over all true pixels, so none is marked as best: look at density, or take `--set filled`"
            ));
        }
        grid.notes.extend(best::note(&shown, &metrics));
        Ok(grid)
    }

    /// The selection, with depths beside disparities that are filled where a score of depths is asked for.
    pub(super) fn with_depths(&self, selection: &Selection) -> Selection {
        let mut named = self.columns.iter().chain(&self.sort).chain(&self.pareto);
        let with_depths = named.any(|name| Family::Depth.metrics().iter().any(|of| of.name == *name));
        Selection { with_depths, ..selection.clone() }
    }

    /// The rows that have to do with the scores that are asked for, and how many others were left out: where those are of depths and of
    /// disparities, a row of both where one was made of the other.
    pub(super) fn rows(&self, ablation: &Ablation<'_>, rows: Vec<Row>) -> Result<(Vec<Row>, usize), AnalysisError> {
        let named = self.columns.iter().chain(&self.sort).chain(&self.pareto);
        let named = named.map(|name| ablation.column(name)).collect::<Result<Vec<Column>, _>>()?;
        let mut metrics: Vec<usize> = named.iter().filter_map(|column| column.metric()).collect();
        if self.columns.is_empty() {
            metrics = (0..ablation.metrics.len()).collect();
        }
        let is_of = |family: Family| metrics.iter().any(|&of| family.metrics().contains(ablation.metrics[of]));
        if is_of(Family::Depth) && is_of(Family::Disparity) || named.iter().any(|column| column.is_of_disparity()) {
            return Ok((joined(ablation, rows), 0));
        }
        let all = rows.len();
        let taken = |row: &Row| {
            let taken = &ablation.estimator(row).metrics;
            metrics.iter().any(|&metric| row.values[metric].is_some() || taken.contains(&ablation.metrics[metric]))
        };
        if metrics.is_empty() || !rows.iter().any(taken) {
            return Ok((rows, 0));
        }
        let rows: Vec<Row> = rows.into_iter().filter(taken).collect();
        let left_out = all - rows.len();
        Ok((rows, left_out))
    }

    /// What rows are sorted by where nobody says: the first score that is shown and that a row has, `abs_rel` before others where all are shown.
    fn sort_of_itself(&self, ablation: &Ablation<'_>, rows: &[Row]) -> Result<Column, AnalysisError> {
        let asked = self.columns.iter().map(|name| ablation.column(name)).collect::<Result<Vec<_>, _>>()?;
        let has_value = |column: &Column| rows.iter().any(|row| ablation.number(row, *column).is_some());
        let first = asked.into_iter().filter(|column| !column.is_axis()).find(has_value);
        Ok(first.unwrap_or_else(|| Column::Metric(ablation.first_error(rows))))
    }

    /// What tells the table from others of the experiment: what was asked for beside the defaults.
    fn label(&self, ablation: &Ablation<'_>, selection: &Selection) -> String {
        let mut parts = vec![ablation.experiment.to_owned(), "variants".to_owned()];
        parts.extend(selection.label());
        let of = |word: &str, names: &[String]| (!names.is_empty()).then(|| format!("{word}-{}", names.join("-")));
        parts.extend(of("pareto", &self.pareto));
        parts.extend(of("of", &self.columns));
        parts.extend(self.sort.as_ref().map(|sort| format!("by-{sort}")));
        parts.extend(self.top.map(|top| format!("top-{top}")));
        parts.extend(self.intervals.map(|_| "ci".to_owned()));
        parts.join("-")
    }

    fn columns(&self, ablation: &Ablation<'_>, rows: &[Row]) -> Result<Vec<Column>, AnalysisError> {
        if !self.columns.is_empty() {
            let columns = self.columns.iter().map(|name| {
                let column = ablation.column(name)?;
                ablation.require(rows, column).map(|()| column)
            });
            // Axes are there already.
            let mut once: Vec<Column> = Vec::new();
            for column in columns.collect::<Result<Vec<_>, _>>()?.into_iter().filter(|of| !of.is_axis()) {
                if !once.contains(&column) {
                    once.push(column);
                }
            }
            return Ok(once);
        }
        let has_value = |column: &Column| rows.iter().any(|row| ablation.number(row, *column).is_some());
        let mut columns: Vec<Column> = (0..ablation.metrics.len()).map(Column::Metric).filter(has_value).collect();
        let is_below_1 = |row: &Row| row.density.is_some_and(|density| density < 1.0);
        if rows.iter().flat_map(Row::parts).any(is_below_1) {
            columns.push(Column::Density(Part::Own));
            let differs = |row: &Row| row.joined.as_ref().is_some_and(|disparity| disparity.density != row.density);
            if rows.iter().any(differs) {
                columns.push(Column::Density(Part::Disparity));
            }
        }
        if rows.iter().any(|row| row.core_ms.is_some()) {
            columns.push(Column::Ms);
        }
        if rows.iter().any(|row| row.frames != rows[0].frames) {
            columns.push(Column::Frames(Part::Own));
        }
        Ok(columns)
    }
}

/// Columns of the intervals of a score.
fn intervals(
    ablation: &Ablation<'_>,
    selection: &Selection,
    metric: usize,
    shown: &[&Row],
    resampling: &Resampling,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<[GridColumn; 3], AnalysisError> {
    let (zone, of) = (ablation.zone(selection)?, ablation.metrics[metric]);
    let number = |row: &&Row| -> (usize, Box<Statistic<'_>>) {
        let part = row.of(metric);
        let frames = ablation.frames(part.estimator, part.set, zone).iter().map(|score| &score.row);
        let settings = ablation.estimator(part).settings.unwrap_or_default();
        match Weighted::of_those_that_have_it(of, part.mean, &settings, frames) {
            Some((frames, weighted)) => (frames, Box::new(move |times: &[f64]| weighted.value(times))),
            None => (0, Box::new(|_: &[f64]| f64::NAN)),
        }
    };
    let found = resampling.intervals_of(&shown.iter().map(number).collect::<Vec<_>>(), stop)?;
    let decimals = of.decimals + 1;
    let ends = found.iter().map(|of| of.as_ref().map(|of| (of.low, of.high))).collect();
    let column = |name: &str, end: fn(&Interval) -> f64| {
        let values: Vec<Option<f64>> = found.iter().map(|of| of.as_ref().map(end)).collect();
        let cells = GridCells::Written { texts: vec![None; values.len()], values };
        let name = format!("{}_{name}", of.name);
        GridColumn { unit: Some(unit_of(of)), only_in_files: true, ..GridColumn::of(name, cells) }
    };
    Ok([
        GridColumn {
            only_in_text: true,
            joins: true,
            ..GridColumn::of(resampling.level(), GridCells::Interval { decimals, ends })
        },
        column("low", |of| of.low),
        column("high", |of| of.high),
    ])
}

/// The columns that say what shown rows are: those that every table begins with. Text shows the axes on which `rows` differ and the estimator's
/// name where there are several; where that does not tell rows apart, stage and variant too.
pub(super) fn keys(
    ablation: &Ablation<'_>,
    selection: &Selection,
    rows: &[Row],
    shown: &[&Row],
) -> Result<Vec<GridColumn>, AnalysisError> {
    let differ = |of: &dyn Fn(&Row) -> Option<String>| rows.iter().any(|row| of(row) != of(&rows[0]));
    let key = |name: &str, of: &dyn Fn(&Row) -> Option<String>, is_shown: bool| {
        let column = GridColumn::key(name, shown.iter().map(|row| of(row)).collect());
        GridColumn { only_in_files: !is_shown, ..column }
    };
    let lead = |row: &Row| &ablation.estimator(row).lead;
    let mut axes = Vec::new();
    let mut of_variants = false;
    for (axis, named) in ablation.axes.iter().enumerate() {
        let level = |row: &Row| ablation.level_name(row, axis).map(str::to_owned);
        let Some(column) = rows.first().and_then(|row| lead(row).level(&named.name)).map(|level| &level.column) else {
            // Variants without a matrix are an axis themselves.
            of_variants |= differ(&level);
            continue;
        };
        let cells = shown.iter().map(|row| level(row)).collect();
        axes.push(GridColumn {
            shown: (*column != named.name).then(|| named.name.clone()),
            only_in_files: !differ(&level),
            ..GridColumn::levels(column, cells, |_| named.is_numeric)
        });
    }
    let name = |row: &Row| Some(ablation.name(row));
    let is_shown = differ(&name) || !of_variants && axes.iter().all(|axis| axis.only_in_files);
    let set = |row: &Row| {
        let mut sets: Vec<&str> = row.parts().map(|part| part.set.name()).collect();
        sets.dedup();
        Some(if selection.common { COMMON.to_owned() } else { sets.join("+") })
    };
    let mut columns = vec![
        key("stage", &|row| Some(lead(row).stage.clone()), false),
        key("variant", &|row| lead(row).variant.clone(), of_variants),
        key("estimator", &name, is_shown),
        key("set", &set, differ(&set)),
    ];
    columns.extend(axes);
    for left in 0..2 {
        if are_told_apart(&columns, shown) {
            break;
        }
        columns[left].only_in_files = false;
    }
    Ok(columns)
}

/// Whether text tells rows of different estimators apart. One may be shown several times, as the best of several zones.
fn are_told_apart(columns: &[GridColumn], shown: &[&Row]) -> bool {
    let mut seen: HashMap<Vec<String>, usize> = HashMap::new();
    let told = |row: usize| columns.iter().filter(|column| !column.only_in_files).map(move |of| of.cells.text(row));
    (0..shown.len()).all(|row| {
        let estimator = shown[row].estimator;
        *seen.entry(told(row).collect()).or_insert(estimator) == estimator
    })
}

impl Ablation<'_> {
    /// The place of the metric that rows are sorted by where nobody says: the first error, `abs_rel` before others.
    pub(crate) fn first_error(&self, rows: &[Row]) -> usize {
        let has_value = |metric: &usize| rows.iter().any(|row| row.value(*metric).is_some());
        let named = ["abs_rel", "d1", "epe"].into_iter().filter_map(|name| self.metric(name).ok()).find(has_value);
        let any = || (0..self.metrics.len()).filter(has_value).find(|metric| !self.metrics[*metric].more_is_better);
        named.or_else(any).or_else(|| (0..self.metrics.len()).find(has_value)).unwrap_or(0)
    }

    /// Sorts rows, best first; those without a value last, equals as they were.
    fn sort(&self, rows: &[Row], order: &mut [usize], column: Column) {
        let better = self.better(column);
        let value = |row: &usize| self.number(&rows[*row], column).filter(|value| !value.is_nan());
        order.sort_by(|a, b| match (value(a), value(b)) {
            (Some(a), Some(b)) if better == Better::More => b.total_cmp(&a),
            (Some(a), Some(b)) => a.total_cmp(&b),
            (a, b) => a.is_none().cmp(&b.is_none()),
        });
    }

    /// The rows on the Pareto front of some columns.
    fn front(&self, rows: &[Row], names: &[String]) -> Result<Vec<usize>, AnalysisError> {
        let columns = names.iter().map(|name| {
            let column = self.measure(name, "a front is")?;
            self.require(rows, column).map(|()| column)
        });
        let columns = columns.collect::<Result<Vec<Column>, _>>()?;
        if columns.len() < 2 {
            return Err(AnalysisError::asked(
                format!("a front of `{}` alone is its best row", names.join(",")),
                "name two columns, e.g. `--pareto abs_rel,ms`".to_owned(),
            ));
        }
        if !rows.iter().any(|row| columns.iter().all(|column| self.number(row, *column).is_some())) {
            return Err(AnalysisError::asked(
                format!("no row has all of {}", listed(names.iter().map(String::as_str))),
                "a row is one estimate, or a depth and the disparity that `depth/from-disparity` made it of where both are scored"
                    .to_owned(),
            ));
        }
        let goal = |column: &Column| Goal {
            better: self.better(*column),
            noise: if *column == Column::Ms { TIMING_NOISE } else { 0.0 },
        };
        let goals: Vec<Goal> = columns.iter().map(goal).collect();
        // What cannot be compared beats nothing: of each kind of rows there is a front.
        let kind = |row: &Row| -> Vec<Option<usize>> {
            columns.iter().filter_map(|column| column.metric()).map(|metric| row.of(metric).comparable).collect()
        };
        let mut kinds: Vec<(Vec<Option<usize>>, Vec<usize>)> = Vec::new();
        for (place, row) in rows.iter().enumerate() {
            let kind = kind(row);
            match kinds.iter_mut().find(|(known, _)| *known == kind) {
                Some((_, members)) => members.push(place),
                None => kinds.push((kind, vec![place])),
            }
        }
        let mut on_fronts: Vec<usize> = Vec::new();
        for (_, members) in kinds {
            let values = |&row: &usize| columns.iter().map(|column| self.number(&rows[row], *column)).collect();
            let values: Vec<Vec<Option<f64>>> = members.iter().map(values).collect();
            on_fronts.extend(front(&values, &goals).into_iter().map(|place| members[place]));
        }
        on_fronts.sort_unstable();
        Ok(on_fronts)
    }

    /// A column of a table, of some rows in their order.
    fn cells(&self, rows: &[Row], order: &[usize], column: Column, best: &Best) -> GridColumn {
        let numbers = || order.iter().map(|&row| self.number(&rows[row], column)).collect::<Vec<_>>();
        let number = |best| GridCells::Number { decimals: self.decimals(column), values: numbers(), best };
        let cells = match column {
            Column::Metric(metric) => number(order.iter().map(|&row| best.is_best(metric, row)).collect()),
            Column::Ms => number(vec![false; order.len()]),
            Column::Density(_) => GridCells::Share(numbers()),
            Column::Frames(_) | Column::Pixels(_) => {
                GridCells::Count(order.iter().map(|&row| column.count(&rows[row])).collect())
            }
            Column::Axis(axis) => {
                GridCells::Text(order.iter().map(|&row| self.level_name(&rows[row], axis).map(str::to_owned)).collect())
            }
        };
        match column {
            Column::Metric(metric) => GridColumn::score(self.metrics[metric], cells),
            Column::Ms | Column::Density(_) => GridColumn {
                unit: Some(if column == Column::Ms { "ms" } else { DIMENSIONLESS }),
                more_is_better: Some(self.better(column) == Better::More),
                ..GridColumn::of(self.column_name(column), cells)
            },
            Column::Frames(_) | Column::Pixels(_) => GridColumn {
                unit: Some(if matches!(column, Column::Frames(_)) { "frames" } else { "pixels" }),
                ..GridColumn::of(self.column_name(column), cells)
            },
            Column::Axis(_) => GridColumn::of(self.column_name(column), cells),
        }
    }
}
