//! The rows of an ablation, sorted, cut and in columns.

use std::collections::HashSet;

use super::best::Best;
use super::front::{Better, front};
use super::{Ablation, Row, Selection, listed, unknown};
use crate::error::AnalysisError;
use crate::grid::{Grid, GridCells, GridColumn};

/// The name of the column of core-milliseconds.
const MS: &str = "ms";
/// The columns that are no scores.
const OTHERS: [&str; 4] = ["density", MS, "frames", "pixels"];

/// A table with a row an estimator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranking {
    /// What to sort by: a score or a column of numbers, best first; or an axis, in the file's order. `None`: by the first error that was
    /// shown and that a row has, `abs_rel` before others.
    pub sort: Option<String>,
    /// How many rows are shown at most.
    pub top: Option<usize>,
    /// The columns behind the axes; empty: all scores, `density` where not every pixel was answered, and `ms` where it is known.
    pub columns: Vec<String>,
    /// Columns on whose Pareto front the rows are to be; empty: all rows.
    pub pareto: Vec<String>,
}

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Column {
    Axis(usize),
    Metric(usize),
    Density,
    Ms,
    Frames,
    Pixels,
}

impl Ranking {
    /// The table of the selected rows.
    pub(crate) fn grid(&self, ablation: &Ablation<'_>, selection: &Selection) -> Result<Grid, AnalysisError> {
        let rows = ablation.rows(selection)?;
        let mut about = ablation.about(&rows, selection)?;
        let all = rows.len();
        let sort = match (&self.sort, self.pareto.first()) {
            (Some(name), _) | (None, Some(name)) => ablation.column(name)?,
            (None, None) => self.sort_of_itself(ablation, &rows)?,
        };
        let mut order: Vec<usize> = (0..rows.len()).collect();
        if !self.pareto.is_empty() {
            order = ablation.front(&rows, &self.pareto)?;
            let of = if order.len() == 1 { "row" } else { "rows" };
            about.push_str(&format!("; the {} {of} on the Pareto front of {}", order.len(), self.pareto.join(" and ")));
        }
        ablation.require(&rows, sort)?;
        ablation.sort(&rows, &mut order, sort);
        let cut = self.top.filter(|&top| top < order.len());
        if let Some(top) = cut {
            about.push_str(&format!("; the first {top} of {} rows by {}", order.len(), ablation.column_name(sort)));
            order.truncate(top);
        } else if self.pareto.is_empty() {
            let rows = if all == 1 { "1 row".to_owned() } else { format!("{all} rows") };
            about.push_str(&format!("; {rows} by {}", ablation.column_name(sort)));
        }
        let best = Best::of(ablation, &rows);
        let mut grid = Grid { about, label: format!("{}-variants", ablation.experiment), ..Grid::default() };
        grid.columns = keys(ablation, &rows, &order.iter().map(|&row| &rows[row]).collect::<Vec<_>>());
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
        if ablation.set(selection)? == depthloom_scores::PixelSet::Answered && rows.len() > 1 {
            grid.notes.push(
                "each row is over the pixels that it answered itself, so nothing is marked as best: look at density"
                    .to_owned(),
            );
        }
        let is_partial = |metric: usize| rows.iter().any(|row| row.comparable.is_some() && row.over_answers[metric]);
        for metric in columns.iter().filter_map(|column| column.metric()).filter(|metric| is_partial(*metric)) {
            let name = ablation.metrics[metric].name;
            grid.notes.push(format!(
                "{name} leaves out what was not answered, also over all true pixels, so none is marked as best: look at density, or take `--set filled`"
            ));
        }
        grid.notes.extend(best.note());
        Ok(grid)
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
        let mut columns: Vec<Column> = (0..ablation.metrics.len()).map(Column::Metric).collect();
        if rows.iter().any(|row| row.density.is_some_and(|density| density < 1.0)) {
            columns.push(Column::Density);
        }
        if rows.iter().any(|row| row.core_ms.is_some()) {
            columns.push(Column::Ms);
        }
        if rows.iter().any(|row| row.frames != rows[0].frames) {
            columns.push(Column::Frames);
        }
        Ok(columns)
    }
}

impl Column {
    const fn is_axis(self) -> bool {
        matches!(self, Self::Axis(_))
    }

    const fn metric(self) -> Option<usize> {
        match self {
            Self::Metric(metric) => Some(metric),
            _ => None,
        }
    }
}

/// The columns that say what shown rows are: the axes on which `rows` differ, the estimator's name where there are several, and its label
/// where that does not tell rows apart.
pub(super) fn keys(ablation: &Ablation<'_>, rows: &[Row], shown: &[&Row]) -> Vec<GridColumn> {
    let differ = |of: &dyn Fn(&Row) -> Option<String>| rows.iter().any(|row| of(row) != of(&rows[0]));
    let mut columns: Vec<(&str, Vec<Option<String>>)> = Vec::new();
    for (axis, named) in ablation.axes.iter().enumerate() {
        let level = |row: &Row| ablation.level_name(row, axis).map(str::to_owned);
        if differ(&level) {
            columns.push((&named.name, shown.iter().map(|row| level(row)).collect()));
        }
    }
    let name = |row: &Row| Some(ablation.estimator(row).name.clone());
    if differ(&name) || columns.is_empty() {
        columns.push(("estimate", shown.iter().map(|row| name(row)).collect()));
    }
    let mut seen = HashSet::new();
    let are_told_apart =
        (0..shown.len()).all(|row| seen.insert(columns.iter().map(|(_, cells)| &cells[row]).collect::<Vec<_>>()));
    let mut label =
        GridColumn::key("estimator", shown.iter().map(|row| Some(ablation.estimator(row).label.clone())).collect());
    label.only_in_files = are_told_apart;
    let columns = columns.into_iter().map(|(name, cells)| GridColumn::key(name, cells));
    std::iter::once(label).chain(columns).collect()
}

impl Ablation<'_> {
    /// The place of the metric that rows are sorted by where nobody says: the first error, `abs_rel` before others.
    pub(crate) fn first_error(&self, rows: &[Row]) -> usize {
        let has_value = |metric: &usize| rows.iter().any(|row| row.values[*metric].is_some());
        let named = ["abs_rel", "d1", "epe"].into_iter().filter_map(|name| self.metric(name).ok()).find(has_value);
        let any = || (0..self.metrics.len()).filter(has_value).find(|metric| !self.metrics[*metric].more_is_better);
        named.or_else(any).or_else(|| (0..self.metrics.len()).find(has_value)).unwrap_or(0)
    }

    /// The column of that name.
    fn column(&self, name: &str) -> Result<Column, AnalysisError> {
        match name {
            "density" => return Ok(Column::Density),
            MS => return Ok(Column::Ms),
            "frames" => return Ok(Column::Frames),
            "pixels" => return Ok(Column::Pixels),
            _ => {}
        }
        if let Some(axis) = self.axes.iter().position(|axis| axis.name == name) {
            return Ok(Column::Axis(axis));
        }
        if depthloom_scores::Metric::named(name).is_some() {
            return self.metric(name).map(Column::Metric);
        }
        let mut known: Vec<&str> = self.metric_names().chain(OTHERS).collect();
        known.extend(self.axes.iter().map(|axis| axis.name.as_str()));
        Err(unknown("column", name, known.iter().copied()))
    }

    fn column_name(&self, column: Column) -> &str {
        match column {
            Column::Axis(axis) => &self.axes[axis].name,
            Column::Metric(metric) => self.metrics[metric].name,
            Column::Density => "density",
            Column::Ms => MS,
            Column::Frames => "frames",
            Column::Pixels => "pixels",
        }
    }

    /// A row's number in a column.
    fn number(&self, row: &Row, column: Column) -> Option<f64> {
        match column {
            Column::Axis(axis) => self.level(row, axis).map(|level| level as f64),
            Column::Metric(metric) => row.values[metric],
            Column::Density => row.density,
            Column::Ms => row.core_ms,
            Column::Frames => Some(row.frames as f64),
            Column::Pixels => Some(row.pixels as f64),
        }
    }

    /// Which way a column is better; of an axis, its order in the file.
    fn better(&self, column: Column) -> Better {
        match column {
            Column::Axis(_) | Column::Ms => Better::Less,
            Column::Metric(metric) if !self.metrics[metric].more_is_better => Better::Less,
            Column::Metric(_) | Column::Density | Column::Frames | Column::Pixels => Better::More,
        }
    }

    /// An error where no row has a value in a column that was asked for.
    fn require(&self, rows: &[Row], column: Column) -> Result<(), AnalysisError> {
        if rows.iter().any(|row| self.number(row, column).is_some()) {
            return Ok(());
        }
        let (what, help) = match column {
            Column::Ms => (
                "core-milliseconds of these estimates are not known".to_owned(),
                "they come from `timings.parquet`, which a run leaves beside its recording: name the run's folder, or run again",
            ),
            Column::Density => (
                "how many pixels were answered was not recorded".to_owned(),
                "recordings of earlier versions do not hold it: run again",
            ),
            Column::Metric(_)
                if self.metrics.iter().any(|metric| metric.pooling == depthloom_scores::Pooling::None) =>
            {
                (
                    format!(
                        "`{}` over the pixels of all frames does not follow from the frames' scores",
                        self.column_name(column)
                    ),
                    "take `--mean frames`",
                )
            }
            _ => (
                format!("no row has a value of `{}`", self.column_name(column)),
                "it was not taken of these estimates, or no frame had a pixel to score",
            ),
        };
        Err(AnalysisError::asked(what, help.to_owned()))
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
            let column = self.column(name)?;
            self.require(rows, column)?;
            if column.is_axis() {
                return Err(AnalysisError::asked(
                    format!("`{name}` is an axis: neither way of it is better"),
                    format!("a front is of scores and of {}", listed(OTHERS)),
                ));
            }
            Ok(column)
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
                "a row is one estimate: scores of depths and of disparities stand in rows of their own".to_owned(),
            ));
        }
        let better: Vec<Better> = columns.iter().map(|column| self.better(*column)).collect();
        let values: Vec<Vec<Option<f64>>> =
            rows.iter().map(|row| columns.iter().map(|column| self.number(row, *column)).collect()).collect();
        Ok(front(&values, &better))
    }

    /// A column of a table, of some rows in their order.
    fn cells(&self, rows: &[Row], order: &[usize], column: Column, best: &Best) -> GridColumn {
        let numbers = || order.iter().map(|&row| self.number(&rows[row], column)).collect::<Vec<_>>();
        let counts = |of: fn(&Row) -> u64| GridCells::Count(order.iter().map(|&row| Some(of(&rows[row]))).collect());
        let cells = match column {
            Column::Metric(metric) => GridCells::Number {
                // Variants differ by less than methods do.
                decimals: self.metrics[metric].decimals + 1,
                values: numbers(),
                best: order.iter().map(|&row| best.is_best(metric, row)).collect(),
            },
            Column::Ms => GridCells::Number { decimals: 2, values: numbers(), best: vec![false; order.len()] },
            Column::Density => GridCells::Share(numbers()),
            Column::Frames => counts(|row| row.frames),
            Column::Pixels => counts(|row| row.pixels),
            Column::Axis(axis) => {
                GridCells::Text(order.iter().map(|&row| self.level_name(&rows[row], axis).map(str::to_owned)).collect())
            }
        };
        let more_is_better = match column {
            Column::Metric(_) | Column::Ms | Column::Density => Some(self.better(column) == Better::More),
            _ => None,
        };
        GridColumn { more_is_better, ..GridColumn::of(self.column_name(column), cells) }
    }
}
