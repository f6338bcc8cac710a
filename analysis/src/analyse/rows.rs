//! What was found, as a table: a row a bin and estimator.

use super::job::{Found, FoundBins, FoundRow, Job};
use super::{By, Inquiry, SampleSet, Unit};
use crate::analyse::sums::Sums;
use crate::grid::{Grid, GridCells, GridColumn};
use crate::leading::Level;
use crate::samples::DescribedEstimator;
use crate::sheet::DIMENSIONLESS;

/// A row.
struct Row<'a> {
    job: &'a Job<'a>,
    found: &'a Found,
    of: &'a FoundRow,
    /// Its place among those told of.
    told: usize,
}

impl Row<'_> {
    fn estimator(&self) -> &DescribedEstimator {
        self.job.estimators[self.job.told[self.told]]
    }

    fn sums(&self) -> Sums {
        self.of.of[self.told].0
    }

    /// A mean over the answered pixels.
    fn mean(&self, sum: f64) -> Option<f64> {
        let count = self.sums().count;
        (count > 0).then(|| sum / count as f64)
    }
}

/// The answers to an inquiry as one table.
pub(super) fn grid(jobs: &[Job<'_>], found: &[Found], inquiry: &Inquiry, several_runs: bool) -> Grid {
    let rows: Vec<Row<'_>> = jobs
        .iter()
        .zip(found)
        .flat_map(|(job, found)| {
            let of_bins = move |told| found.rows.iter().map(move |of| Row { job, found, of, told });
            (0..job.told.len()).flat_map(of_bins)
        })
        .collect();

    let key =
        |name: &str, of: &dyn Fn(&Row<'_>) -> Option<String>| GridColumn::key(name, rows.iter().map(of).collect());
    let several_scorings = jobs.iter().any(|job| {
        jobs.iter()
            .any(|other| other.parts[0].stage == job.parts[0].stage && other.parts[0].scoring != job.parts[0].scoring)
    });
    let mut columns = Vec::new();
    if several_runs {
        columns.push(key("run", &|row| Some(row.job.run.to_owned())));
    }
    // What all rows have in common text leaves out.
    let common = |column: GridColumn| {
        let is_one = matches!(&column.cells, GridCells::Text(cells) if cells.windows(2).all(|pair| pair[0] == pair[1]));
        GridColumn { only_in_files: is_one, ..column }
    };
    columns.push(common(key("stage", &|row| Some(row.estimator().stage.clone()))));
    if several_scorings {
        columns.push(key("scoring", &|row| Some(row.estimator().scoring.clone())));
    }
    columns.push(common(key("variant", &|row| row.estimator().variant.clone())));
    columns.push(key("estimator", &|row| Some(row.estimator().estimator.clone())));
    let mut axes: Vec<&Level> = Vec::new();
    for axis in rows.iter().flat_map(|row| &row.estimator().factors) {
        if !axes.iter().any(|known| known.axis == axis.axis) {
            axes.push(axis);
        }
    }
    let set = common(key("set", &|row| Some(row.job.set.name().to_owned())));
    columns.push(set);
    for axis in axes {
        let of_row = |row: &Row<'_>| row.estimator().factors.iter().find(|of| of.axis == axis.axis)?.value.clone();
        let levels = rows.iter().map(of_row).collect();
        let column = GridColumn::levels(&axis.column, levels, |_| axis.is_numeric);
        columns.push(GridColumn { only_in_files: true, ..column });
    }
    columns.extend(of_bins(&rows, inquiry));
    let count = |name: &str, of: &dyn Fn(&Row<'_>) -> u64| {
        let cells = GridCells::Count(rows.iter().map(|row| Some(of(row))).collect());
        GridColumn { unit: Some("pixels"), ..GridColumn::of(name, cells) }
    };
    columns.push(count("pixels", &|row| row.of.pixels));
    columns.push(count("count", &|row| row.sums().count));
    let (prefix, suffix) = match inquiry.unit {
        Unit::Metres => ("", "_m"),
        Unit::OfTruth => ("relative_", ""),
    };
    let number = |name: String, of: &dyn Fn(&Row<'_>) -> Option<f64>| {
        let values: Vec<Option<f64>> = rows.iter().map(of).collect();
        let cells = GridCells::Number { decimals: 3, best: vec![false; values.len()], values };
        let unit = if inquiry.unit == Unit::Metres { "m" } else { DIMENSIONLESS };
        GridColumn { unit: Some(unit), ..GridColumn::of(name, cells) }
    };
    for (place, percentile) in inquiry.percentiles.iter().enumerate() {
        let name = format!("{prefix}error_p{percentile}{suffix}");
        columns.push(number(name, &|row| row.of.of[row.told].1.as_ref().map(|percentiles| percentiles[place])));
    }
    columns.push(number(format!("{prefix}error_mean{suffix}"), &|row| row.mean(row.sums().absolute)));
    columns.push(number(format!("{prefix}bias{suffix}"), &|row| row.mean(row.sums().signed)));
    columns.push(number(format!("{prefix}rmse{suffix}"), &|row| row.mean(row.sums().squared).map(f64::sqrt)));
    let gross = rows.iter().map(|row| row.mean(row.sums().gross as f64));
    let gross = GridColumn::of("gross_share", GridCells::Share(gross.collect()));
    columns.push(GridColumn { unit: Some(DIMENSIONLESS), ..gross });

    // A gap where another estimator, set or run begins.
    let begins = |pair: &[Row<'_>]| !std::ptr::eq(pair[0].job, pair[1].job) || pair[0].told != pair[1].told;
    let gaps = rows.windows(2).enumerate().filter(|(_, pair)| begins(pair)).map(|(at, _)| at + 1).collect();
    let error = match inquiry.unit {
        Unit::Metres => "absolute error, metres",
        Unit::OfTruth => "absolute error as a share of the true distance",
    };
    let pixels = match &inquiry.sets[..] {
        [] | [SampleSet::Answered] => ", over the pixels that each estimate answered",
        [SampleSet::Common] => ", over the pixels that all estimates answered",
        _ => "",
    };
    Grid {
        about: format!("{error}, by {}{pixels}; gross: {}", by(&inquiry.by), inquiry.gross.told()),
        caption: None,
        label: "errors".to_owned(),
        columns,
        gaps,
        starts: Vec::new(),
        notes: Vec::new(),
    }
}

fn by(by: &By) -> String {
    match by {
        By::Distance => "true distance".to_owned(),
        By::Estimate => "estimated distance".to_owned(),
        By::Error => "absolute error".to_owned(),
        By::Weight => "weight".to_owned(),
        By::Row => "image row".to_owned(),
        By::Column => "image column".to_owned(),
        By::Frame => "frame".to_owned(),
        By::Named(name) => name.clone(),
    }
}

/// The columns that say which bin a row is.
fn of_bins(rows: &[Row<'_>], inquiry: &Inquiry) -> Vec<GridColumn> {
    if inquiry.by == By::Frame {
        let frame = |row: &Row<'_>| match &row.found.bins {
            FoundBins::Frames(frames) => frames.get(row.of.bin).cloned(),
            FoundBins::Edges(_) => None,
        };
        let position = rows.iter().map(|row| frame(row).map(|(position, _)| u64::from(position))).collect();
        let ids = rows.iter().map(|row| frame(row).map(|(_, id)| id)).collect();
        let position = GridColumn { only_in_files: true, ..GridColumn::of("position", GridCells::Count(position)) };
        return vec![position, GridColumn::key("frame", ids)];
    }
    let unit = match inquiry.by {
        By::Distance | By::Estimate => Some("m"),
        By::Error if inquiry.unit == Unit::Metres => Some("m"),
        By::Row | By::Column => Some("px"),
        By::Error | By::Weight | By::Frame | By::Named(_) => None,
    };
    let edge = |name: &str, of: &dyn Fn((f64, f64)) -> f64| {
        let of_row = |row: &Row<'_>| match &row.found.bins {
            FoundBins::Edges(edges) => Some(of(edges.of(row.of.bin))),
            FoundBins::Frames(_) => None,
        };
        let values: Vec<Option<f64>> = rows.iter().map(of_row).collect();
        let decimals = if values.iter().flatten().all(|edge| edge.fract() == 0.0) { 0 } else { 2 };
        let cells = GridCells::Number { decimals, best: vec![false; values.len()], values };
        let name = unit.map_or(name.to_owned(), |unit| format!("{name}_{unit}"));
        GridColumn { is_key: true, unit, ..GridColumn::of(name, cells) }
    };
    vec![edge("bin_from", &|(from, _)| from), edge("bin_to", &|(_, to)| to)]
}
