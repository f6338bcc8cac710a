//! The results of a query as a table: one row per bin and estimate.

use depthloom_graphs::counted;

use super::job::{BinRow, BinnedErrors, Job, JobBins};
use super::sums::Sums;
use super::{By, Inquiry, SampleSet, Unit};
use crate::samples::DescribedEstimate;
use crate::tables::{Cells, Column, DIMENSIONLESS, Format, Level, Rows, Table};

/// A row.
struct Row<'a> {
    job: &'a Job<'a>,
    result: &'a BinnedErrors,
    row: &'a BinRow,
    /// The index of its estimate among the reported ones.
    reported: usize,
}

impl Row<'_> {
    fn estimate(&self) -> &DescribedEstimate {
        self.job.estimates[self.job.reported[self.reported]]
    }

    fn sums(&self) -> Sums {
        self.row.estimates[self.reported].0
    }

    /// The mean over the valid pixels.
    fn mean(&self, sum: f64) -> Option<f64> {
        let count = self.sums().count;
        (count > 0).then(|| sum / count as f64)
    }
}

/// The results of all jobs as one table.
pub(super) fn grid(jobs: &[Job<'_>], results: &[BinnedErrors], inquiry: &Inquiry, several_runs: bool) -> Table {
    let rows: Vec<Row<'_>> = jobs
        .iter()
        .zip(results)
        .flat_map(|(job, result)| {
            let bin_rows = move |reported| result.rows.iter().map(move |row| Row { job, result, row, reported });
            (0..job.reported.len()).flat_map(bin_rows)
        })
        .collect();

    let cells = Rows(&rows);
    let several_scorings = jobs.iter().any(|job| {
        jobs.iter()
            .any(|other| other.parts[0].stage == job.parts[0].stage && other.parts[0].scoring != job.parts[0].scoring)
    });
    let mut columns = Vec::new();
    if several_runs {
        columns.push(cells.key("run", |row| row.job.run));
    }
    // Text omits columns that are equal in all rows.
    let common = |column: Column| {
        let is_one = matches!(&column.cells, Cells::Text(cells) if cells.windows(2).all(|pair| pair[0] == pair[1]));
        if is_one { column.in_files() } else { column }
    };
    columns.push(common(cells.key("stage", |row| &row.estimate().stage)));
    if several_scorings {
        columns.push(cells.key("scoring", |row| &row.estimate().scoring));
    }
    columns.push(common(cells.key("variant", |row| row.estimate().variant.as_ref())));
    columns.push(cells.key("estimate", |row| &row.estimate().estimate));
    let mut axes: Vec<&Level> = Vec::new();
    for axis in rows.iter().flat_map(|row| &row.estimate().factors) {
        if !axes.iter().any(|known| known.axis == axis.axis) {
            axes.push(axis);
        }
    }
    columns.push(common(cells.key("set", |row| row.job.set.name())));
    for axis in axes {
        let level = |row: &Row<'_>| row.estimate().factors.iter().find(|level| level.axis == axis.axis)?.value.clone();
        let levels = rows.iter().map(level);
        columns.push(Column::levels(&axis.column, levels, |_| axis.is_numeric).axis().in_files());
    }
    columns.extend(bin_columns(&rows, inquiry));
    columns.push(cells.count("pixels", |row| row.row.pixels).unit("pixels"));
    columns.push(cells.count("count", |row| row.sums().count).unit("pixels"));
    let (prefix, suffix) = match inquiry.unit {
        Unit::Metres => ("", "_m"),
        Unit::OfTruth => ("relative_", ""),
    };
    let unit = if inquiry.unit == Unit::Metres { "m" } else { DIMENSIONLESS };
    let metres = if inquiry.unit == Unit::Metres { " (m)" } else { "" };
    for (place, percentile) in inquiry.percentiles.iter().enumerate() {
        let name = format!("{prefix}error_p{percentile}{suffix}");
        columns.push(
            cells
                .number(name, |row| row.row.estimates[row.reported].1.as_ref().map(|percentiles| percentiles[place]))
                .unit(unit)
                .latex(format!("$P_{{{percentile}}}${metres}")),
        );
    }
    columns.extend([
        cells
            .number(format!("{prefix}error_mean{suffix}"), |row| row.mean(row.sums().absolute))
            .unit(unit)
            .latex(format!("mean{metres}")),
        cells
            .number(format!("{prefix}bias{suffix}"), |row| row.mean(row.sums().signed))
            .unit(unit)
            .latex(format!("bias{metres}")),
        cells
            .number(format!("{prefix}rmse{suffix}"), |row| row.mean(row.sums().squared).map(f64::sqrt))
            .unit(unit)
            .latex(format!("RMSE{metres}")),
        cells.share("outlier_share", |row| row.mean(row.sums().outlier as f64)).unit(DIMENSIONLESS).latex("outliers"),
    ]);

    // A gap before each estimate, set or run.
    let begins = |pair: &[Row<'_>]| !std::ptr::eq(pair[0].job, pair[1].job) || pair[0].reported != pair[1].reported;
    let gaps = rows.windows(2).enumerate().filter(|(_, pair)| begins(pair)).map(|(at, _)| at + 1).collect();
    let error = match inquiry.unit {
        Unit::Metres => "absolute error, metres",
        Unit::OfTruth => "absolute error as a share of the ground-truth distance",
    };
    let pixels = match &inquiry.sets[..] {
        [] | [SampleSet::Valid] => ", over the pixels that are valid in each estimate",
        [SampleSet::Common] => ", over the pixels that are valid in all estimates",
        _ => "",
    };
    let frames = match &inquiry.frames {
        Some(_) => format!(
            ", on {} of each run",
            counted(jobs.iter().map(Job::frames).max().unwrap_or(0) as u64, "selected frame")
        ),
        None => String::new(),
    };
    Table {
        about: format!(
            "{error}, by {}{pixels}{frames}; outlier_share: share of errors {}",
            by(inquiry),
            inquiry.outlier.words()
        ),
        label: label(jobs, inquiry),
        gaps,
        ..Table::new(columns)
    }
}

/// The LaTeX label: the experiment, the quantity of the bins, and the pixel sets if they are not the default.
fn label(jobs: &[Job<'_>], inquiry: &Inquiry) -> String {
    let experiment = jobs.first().map_or("", |job| job.file.described.experiment.as_str());
    let sets = inquiry.sets.iter().filter(|_| inquiry.sets != [SampleSet::Valid]).map(|set| format!("-{}", set.name()));
    format!("{experiment}-errors-by-{}{}", by(inquiry), sets.collect::<String>())
}

fn by(inquiry: &Inquiry) -> String {
    match &inquiry.by {
        By::Distance => "ground-truth distance".to_owned(),
        By::Estimate => "estimated distance".to_owned(),
        By::Error if inquiry.unit == Unit::OfTruth => "relative error".to_owned(),
        By::Error => "absolute error".to_owned(),
        By::Weight => "confidence".to_owned(),
        By::Row => "image row".to_owned(),
        By::Column => "image column".to_owned(),
        By::Frame => "frame".to_owned(),
        By::Named(name) => name.clone(),
    }
}

/// The columns of the bin.
fn bin_columns(rows: &[Row<'_>], inquiry: &Inquiry) -> Vec<Column> {
    if inquiry.by == By::Frame {
        let frame = |row: &Row<'_>| match &row.result.bins {
            JobBins::Frames(frames) => frames.get(row.row.bin).cloned(),
            JobBins::Edges(_) => None,
        };
        let cells = Rows(rows);
        let position = cells.count("position", |row| frame(row).map(|(position, _)| u64::from(position)));
        return vec![position.in_files(), cells.key("frame", |row| frame(row).map(|(_, id)| id))];
    }
    let unit = match inquiry.by {
        By::Distance | By::Estimate => Some("m"),
        By::Error if inquiry.unit == Unit::Metres => Some("m"),
        By::Row | By::Column => Some("px"),
        By::Error | By::Weight | By::Frame | By::Named(_) => None,
    };
    let edge = |name: &str, end: &dyn Fn((f64, f64)) -> f64| {
        let cell = |row: &Row<'_>| match &row.result.bins {
            JobBins::Edges(edges) => Some(end(edges.range(row.row.bin))),
            JobBins::Frames(_) => None,
        };
        let plain = name.trim_start_matches("bin_");
        let latex = unit.map_or(plain.to_owned(), |unit| format!("{plain} ({unit})"));
        let name = unit.map_or(name.to_owned(), |unit| format!("{name}_{unit}"));
        let decimals = if rows.iter().filter_map(cell).all(|edge| edge.fract() == 0.0) { 0 } else { 2 };
        Column { unit, ..Rows(rows).number(name, cell).format(Format::Fixed(decimals)).key().latex(latex) }
    };
    vec![edge("bin_from", &|(from, _)| from), edge("bin_to", &|(_, to)| to)]
}
