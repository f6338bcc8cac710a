//! The layout of Table I: the value of every metric over all frames, by variant and estimate.

use std::collections::HashSet;

use depthloom_graphs::counted;
use depthloom_scores::{Family, Mean, Metric, PixelSet};
use schemars::JsonSchema;
use serde::Serialize;

use super::best::Best;
use super::{Ablation, Row, Selection};
use crate::error::AnalysisError;
use crate::input::paper::paper_scores;
use crate::scores::metrics_of;
use crate::statistics::{Interval, Resampling};
use crate::tables::best::Mark;
use crate::tables::{
    Cells, Column, DIMENSIONLESS, JsonRow, KEY_COLUMNS, Orientation, RowKey, Rows, Table, key_columns, unit_of,
};

/// The value of every metric over the frames that have scores of all estimates of their stage run, one row per estimate
/// and pixel set.
///
/// A frame without pixels for a metric does not count in the mean of that metric.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ScoreTable {
    /// The metrics, in display order.
    pub(crate) metrics: Vec<&'static Metric>,
    pub(crate) rows: Vec<ScoreTableRow>,
    /// Describes the intervals; `None`: no intervals.
    intervals: Option<String>,
    with_paper: bool,
    /// The zone; the whole image is an empty name.
    zone: String,
    /// Its LaTeX label.
    label: String,
}

/// An estimate on a pixel set.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ScoreTableRow {
    /// The heading: the variant, or the estimate if all variants share it.
    group: String,
    /// Its name below the heading.
    name: String,
    pub(crate) key: RowKey,
    /// Its name under `estimates:`.
    pub(crate) estimate: String,
    pub(crate) label: String,
    pub(crate) set: PixelSet,
    /// The number of frames that the values are averaged over.
    pub(crate) frames: u64,
    mean: Mean,
    class: Option<usize>,
    /// One value per metric of the table.
    pub(crate) values: Vec<Option<f64>>,
    pub(crate) intervals: Vec<Option<Interval>>,
    /// Whether a value is the best, or second best, among comparable ones.
    pub(crate) marks: Vec<Mark>,
    /// The share of pixels with ground truth that are valid; `None` if it was not recorded.
    pub(crate) density: Option<f64>,
    /// The published numbers, if any, of the eight default metrics of `score/depth`.
    paper: Option<[f64; 8]>,
}

/// A row of `table.csv`: beside these its scores, `density` and the axes of `matrix:`, as docs/tables.md explains.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct TableRow {
    stage: String,
    /// Null if all variants share the row.
    variant: Option<String>,
    estimate: String,
    /// The pixels: `all`, `valid` or `filled`.
    set: &'static str,
    // Keys are in the order of the columns of the file: scores, `frames`, published numbers.
    #[serde(flatten)]
    axes_and_scores: JsonRow,
    frames: u64,
    #[serde(flatten)]
    paper_and_density: JsonRow,
}

/// The published number of a metric.
pub(crate) fn paper_number(paper: Option<[f64; 8]>, metric: &Metric) -> Option<f64> {
    let place = Family::Depth.defaults().iter().position(|known| *known == metric)?;
    paper.map(|paper| paper[place])
}

impl ScoreTable {
    pub(crate) fn new(
        ablation: &Ablation<'_>,
        rows: &[Row],
        selection: &Selection,
        with_paper: bool,
        intervals: Option<Resampling>,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self, AnalysisError> {
        let zone = ablation.zone(selection)?;
        let best = Best::new(ablation, rows);
        let metrics = metrics_of(rows.iter().map(|row| ablation.estimate(row)));
        let places: Vec<Option<usize>> =
            metrics.iter().map(|metric| ablation.metrics.iter().position(|known| known == metric)).collect();
        let mut all_intervals = match intervals {
            None => Vec::new(),
            Some(resampling) => {
                let numbers = rows.iter().flat_map(|row| places.iter().map(move |place| (row, *place)));
                let numbers = numbers.map(|(row, place)| ablation.statistic(row, place, zone));
                resampling.intervals_of(&numbers.collect::<Vec<_>>(), stop)?
            }
        }
        .into_iter();
        let rows = rows.iter().enumerate().map(|(at, row)| {
            let estimate = ablation.estimate(row);
            let has_several_sets = rows.iter().filter(|other| other.estimate == row.estimate).count() > 1;
            let (group, name) = match (&estimate.variant_title, has_several_sets || row.set != PixelSet::All) {
                (Some(variant), false) => (variant.clone(), estimate.name_title.clone()),
                (Some(variant), true) => (variant.clone(), format!("{} {}", estimate.name_title, row.set)),
                (None, _) => (estimate.title.clone(), row.set.to_string()),
            };
            ScoreTableRow {
                group,
                name,
                key: estimate.row_key.clone(),
                estimate: estimate.name.clone(),
                label: estimate.label.clone(),
                set: row.set,
                frames: row.frames,
                mean: row.mean,
                class: row.comparable,
                values: places.iter().map(|place| row.values[(*place)?]).collect(),
                intervals: metrics.iter().map(|_| all_intervals.next().flatten()).collect(),
                marks: places.iter().map(|place| place.map_or(Mark::None, |place| best.mark(place, at))).collect(),
                density: row.density,
                paper: if with_paper { paper_scores(estimate, row.set) } else { None },
            }
        });
        let label = [vec![format!("{}-scores", ablation.experiment)], selection.label()].concat().join("-");
        let rows = rows.collect();
        let intervals = intervals.map(|resampling| ablation.about_intervals(&resampling));
        Ok(Self { rows, metrics, intervals, with_paper, zone: zone.to_owned(), label })
    }

    /// The table in any format. Its files have one row per estimate and pixel set: the key columns, the metrics,
    /// `frames`, the published numbers as `paper_a1 ...` if requested, `density`.
    pub(crate) fn table(&self) -> Table {
        let rows = Rows(&self.rows);
        let own = vec![rows.key("estimate", |row| &row.estimate), rows.key("set", |row| row.set.name())];
        let mut columns: Vec<Column> =
            key_columns(&self.rows, |row| &row.key, own).into_iter().map(Column::in_files).collect();
        columns.extend([rows.key("group", |row| &row.group).in_text(), rows.key("name", |row| &row.name).in_text()]);
        let mut paper = Vec::new();
        for (at, &metric) in self.metrics.iter().enumerate() {
            let marks = self.rows.iter().map(|row| row.marks[at]).collect();
            let column = rows.metric(metric, |row| row.values[at]).decimals(metric.decimals).marked(marks);
            columns.push(Column { shown: Some(metric.plain.to_owned()), latex: Some(metric.latex.into()), ..column });
            if self.intervals.is_some() {
                let intervals = self.rows.iter().map(|row| row.intervals[at]).collect();
                columns.extend(interval_columns(metric, "interval", intervals, metric.decimals));
            }
            if self.with_paper && Family::Depth.defaults().contains(&metric) {
                let number = |row: &ScoreTableRow| paper_number(row.paper, metric);
                columns
                    .push(rows.text("paper", |row| number(row).map(|paper| format!("({paper:.2})"))).in_text().joins());
                paper.push(rows.number(format!("paper_{}", metric.name), number).unit(unit_of(metric)).in_files());
            }
        }
        columns.push(rows.count("frames", |row| row.frames).unit("frames").in_files());
        columns.extend(paper);
        columns.push(rows.number("density", |row| row.density).unit(DIMENSIONLESS).in_files());
        let notes = self.with_paper.then(|| "in brackets: Martins et al. 2018, Table I".to_owned());
        Table {
            about: self.about(),
            label: self.label.clone(),
            orientation: Orientation::Metrics,
            marks: self.marks(),
            notes: notes.into_iter().collect(),
            ..Table::new(columns)
        }
    }

    /// The rows of `table.csv`.
    pub(crate) fn json_rows(&self) -> Vec<TableRow> {
        let table = self.table();
        let row = |(place, row): (usize, &ScoreTableRow)| {
            let mut cells = table.json_row(place).skip(KEY_COLUMNS.len());
            TableRow {
                stage: row.key.stage.clone(),
                variant: row.key.variant.clone(),
                estimate: row.estimate.clone(),
                set: row.set.name(),
                axes_and_scores: cells.by_ref().take_while(|(name, _)| name != "frames").collect(),
                frames: row.frames,
                paper_and_density: cells.collect(),
            }
        };
        self.rows.iter().enumerate().map(row).collect()
    }

    /// Describes the marked values; `None` if no value is marked.
    pub(crate) fn marks(&self) -> Option<&'static str> {
        let has_marks = self.rows.iter().any(|row| row.marks.contains(&Mark::Best));
        let classes: HashSet<usize> = self.rows.iter().filter_map(|row| row.class).collect();
        has_marks.then_some(match classes.len() {
            1 => "best over all pixels with ground truth",
            _ => "best among rows over the same pixels with ground truth",
        })
    }

    pub(crate) const fn has_intervals(&self) -> bool {
        self.intervals.is_some()
    }

    /// Describes the numbers in one line.
    pub(crate) fn about(&self) -> String {
        let zone = if self.zone.is_empty() { String::new() } else { format!("zone {}: ", self.zone) };
        let counts: HashSet<u64> = self.rows.iter().map(|row| row.frames).collect();
        let most = counts.iter().max().copied().unwrap_or(0);
        let frames = counted(most, "frame");
        let mut pooled: Vec<&str> =
            self.rows.iter().filter(|row| row.mean == Mean::Pixels).map(|row| row.label.as_str()).collect();
        let frames = match pooled.len() {
            0 => format!("mean over {frames}"),
            all if all == self.rows.len() => format!("over all pixels of {frames}"),
            _ => {
                pooled.dedup();
                format!("mean over {frames}, but over all pixels of these frames for {}", pooled.join(", "))
            }
        };
        let intervals = self
            .intervals
            .as_ref()
            .map_or_else(String::new, |about| format!(", intervals in square brackets ({about})"));
        let fewer = self.rows.iter().filter(|row| row.frames < most);
        let fewer: Vec<String> = fewer.map(|row| format!("{} on {}: {}", row.label, row.set, row.frames)).collect();
        let fewer = if fewer.is_empty() { String::new() } else { format!(" ({})", fewer.join(", ")) };
        format!("{zone}{frames}{intervals}{fewer}")
    }
}

/// The columns of the intervals of a metric: one for text, and both ends for files.
pub(super) fn interval_columns(
    metric: &Metric,
    name: &str,
    intervals: Vec<Option<Interval>>,
    decimals: usize,
) -> [Column; 3] {
    let rows = Rows(&intervals);
    let low = rows.number(format!("{}_low", metric.name), |interval| interval.map(|interval| interval.low));
    let high = rows.number(format!("{}_high", metric.name), |interval| interval.map(|interval| interval.high));
    let [low, high] = [low, high].map(|column| column.unit(unit_of(metric)).in_files());
    [Column::new(name, Cells::Interval(intervals, decimals)).in_text().joins(), low, high]
}

#[cfg(test)]
mod tests;
