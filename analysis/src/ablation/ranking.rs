//! The rows of an ablation, sorted, cut and in columns.

use std::collections::HashMap;

use depthloom_scores::Family;

use super::best::{self, Best};
use super::column::{Column, Part};
use super::front::{Better, front};
use super::joined::joined;
use super::{Ablation, Row, Selection, listed};
use crate::error::AnalysisError;
use crate::grid::{Grid, GridCells, GridColumn};

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
}

impl Ranking {
    /// The table of the selected rows.
    pub(crate) fn grid(&self, ablation: &Ablation<'_>, selection: &Selection) -> Result<Grid, AnalysisError> {
        let (rows, left_out) = self.rows(ablation, ablation.rows(selection)?)?;
        let mut about = ablation.about(&rows, selection)?;
        let all = rows.len();
        let sort = match (&self.sort, self.pareto.first()) {
            (Some(name), _) | (None, Some(name)) => ablation.column(name)?,
            (None, None) => self.sort_of_itself(ablation, &rows)?,
        };
        let by = ablation.column_name(sort);
        let mut order: Vec<usize> = (0..rows.len()).collect();
        if !self.pareto.is_empty() {
            order = ablation.front(&rows, &self.pareto)?;
            let of = if order.len() == 1 { "row" } else { "rows" };
            about.push_str(&format!("; the {} {of} on the Pareto front of {}", order.len(), self.pareto.join(" and ")));
        }
        ablation.require(&rows, sort)?;
        ablation.sort(&rows, &mut order, sort);
        let best = Best::of(ablation, &rows);
        let mut grid = Grid { label: format!("{}-variants", ablation.experiment), ..Grid::default() };
        if let Some(top) = self.top.filter(|&top| top < order.len()) {
            about.push_str(&format!("; the first {top} of {} rows by {by}", order.len()));
            let without = order[top..].iter().filter(|&&row| ablation.number(&rows[row], sort).is_none()).count();
            if without > 0 {
                grid.notes.push(format!("{without} of the rows that are not shown have no {by}: they come last"));
            }
            order.truncate(top);
        } else if self.pareto.is_empty() {
            let rows = if all == 1 { "1 row".to_owned() } else { format!("{all} rows") };
            about.push_str(&format!("; {rows} by {by}"));
        }
        grid.about = about;
        let shown: Vec<&Row> = order.iter().map(|&row| &rows[row]).collect();
        grid.columns = keys(ablation, &rows, &shown);
        let columns = self.columns(ablation, &rows)?;
        if columns.contains(&Column::Ms) {
            grid.notes.push(
                "ms: processor time of all nodes that an estimate is computed from, core-milliseconds a frame"
                    .to_owned(),
            );
        }
        for column in &columns {
            grid.columns.push(ablation.cells(&rows, &order, *column, &best));
        }
        if columns.contains(&Column::Density(Part::Disparity)) {
            grid.notes.push(
                "a row is of a depth and of the disparity it was made of: density is the depth's, disparity_density the disparity's"
                    .to_owned(),
            );
        }
        if left_out > 0 {
            let rows = if left_out == 1 { "row" } else { "rows" };
            grid.notes.push(format!("left out: {left_out} {rows} of which none of these scores was taken"));
        }
        if ablation.set(selection)? == depthloom_scores::PixelSet::Answered && rows.len() > 1 {
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

    /// The rows that have to do with the scores that are asked for, and how many others were left out: where those are of depths and of
    /// disparities, a row of both where one was made of the other.
    fn rows(&self, ablation: &Ablation<'_>, rows: Vec<Row>) -> Result<(Vec<Row>, usize), AnalysisError> {
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

/// The columns that say what shown rows are: the axes on which `rows` differ, the estimator's name where there are several, and its label
/// where that does not tell rows apart.
pub(super) fn keys(ablation: &Ablation<'_>, rows: &[Row], shown: &[&Row]) -> Vec<GridColumn> {
    let differ = |of: &dyn Fn(&Row) -> Option<String>| rows.iter().any(|row| of(row) != of(&rows[0]));
    let mut columns: Vec<(&str, bool, Vec<Option<String>>)> = Vec::new();
    for (axis, named) in ablation.axes.iter().enumerate() {
        let level = |row: &Row| ablation.level_name(row, axis).map(str::to_owned);
        if differ(&level) {
            columns.push((&named.name, named.is_numeric, shown.iter().map(|row| level(row)).collect()));
        }
    }
    let name = |row: &Row| Some(ablation.name(row));
    if differ(&name) || columns.is_empty() {
        columns.push(("estimate", false, shown.iter().map(|row| name(row)).collect()));
    }
    let mut seen: HashMap<Vec<&Option<String>>, usize> = HashMap::new();
    // One estimator may be shown several times, as the best of several zones.
    let are_told_apart = (0..shown.len()).all(|row| {
        let estimator = shown[row].estimator;
        *seen.entry(columns.iter().map(|(.., cells)| &cells[row]).collect()).or_insert(estimator) == estimator
    });
    let mut label = GridColumn::key("estimator", shown.iter().map(|row| Some(ablation.label(row))).collect());
    label.only_in_files = are_told_apart;
    let columns = columns.into_iter().map(|(name, is_numeric, cells)| GridColumn::levels(name, cells, |_| is_numeric));
    std::iter::once(label).chain(columns).collect()
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
        let better: Vec<Better> = columns.iter().map(|column| self.better(*column)).collect();
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
            on_fronts.extend(front(&values, &better).into_iter().map(|place| members[place]));
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
                more_is_better: Some(self.better(column) == Better::More),
                ..GridColumn::of(self.column_name(column), cells)
            },
            Column::Axis(_) | Column::Frames(_) | Column::Pixels(_) => GridColumn::of(self.column_name(column), cells),
        }
    }
}
