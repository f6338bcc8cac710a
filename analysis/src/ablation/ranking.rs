//! The rows of an ablation, sorted, cut and in columns.

use std::collections::HashMap;

use depthloom_graphs::counted;
use depthloom_scores::{Family, PixelSet};

use super::best::{self, Best};
use super::front::{Better, Goal, fronts, sort_best_first};
use super::joined::joined;
use super::measure::{Measure, Part};
use super::score_table::interval_columns;
use super::{Ablation, Row, Selection};
use crate::error::{AnalysisError, listed};
use crate::statistics::Resampling;
use crate::tables::{Column, DIMENSIONLESS, Format, KEY_COLUMNS, Rows, Table};

/// Rows whose costs differ by at most this share count as equally fast, because timings of one run vary by as much.
pub(super) const TIMING_NOISE: f64 = 0.05;

/// A table with one row per estimate, or per depth together with the disparity it was computed from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranking {
    /// The sorting column: a metric or a column of numbers, best first; or an axis, numbers by size, others in the
    /// order of the file. `None`: the first shown error that a row has, `abs_rel` before others.
    pub sort: Option<String>,
    /// The maximum number of rows.
    pub top: Option<usize>,
    /// The columns after the axes. Empty: all metrics, `density` if some pixels are invalid, and `ms` if it is known.
    pub columns: Vec<String>,
    /// Selects the rows on the Pareto front of these columns. Empty: all rows.
    pub pareto: Vec<String>,
    /// The resampling of frames for an interval of each metric; `None`: no intervals.
    pub intervals: Option<Resampling>,
}

impl Ranking {
    /// The table of the selected rows. `stop` is polled while frames are resampled.
    pub(crate) fn table(
        &self,
        ablation: &Ablation<'_>,
        selection: &Selection,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Table, AnalysisError> {
        let selection = &self.with_depths(selection);
        let (rows, excluded) = self.rows(ablation, ablation.rows(selection)?)?;
        let mut about = ablation.about(&rows, selection)?;
        let all = rows.len();
        let sort = match (&self.sort, self.pareto.first()) {
            (Some(name), _) | (None, Some(name)) => ablation.measure(name)?,
            (None, None) => self.default_sort(ablation, &rows)?,
        };
        let by = ablation.measure_name(sort);
        let mut order: Vec<usize> = (0..rows.len()).collect();
        let mut notes = Vec::new();
        if !self.pareto.is_empty() {
            order = ablation.front(&rows, &self.pareto)?;
            let rows = counted(order.len(), "row");
            about.push_str(&format!("; the {rows} on the Pareto front of {}", self.pareto.join(" and ")));
        }
        if self.pareto.iter().any(|name| name == "ms") {
            let percent = 100.0 * TIMING_NOISE;
            notes.push(format!("on the Pareto front, costs that differ by at most {percent} % count as equal"));
        }
        ablation.require(&rows, sort)?;
        sort_best_first(&mut order, ablation.better(sort), |row| ablation.number(&rows[row], sort));
        if let Some(top) = self.top.filter(|&top| top < order.len()) {
            about.push_str(&format!("; the first {top} of {} rows by {by}", order.len()));
            let without = order[top..].iter().filter(|&&row| ablation.number(&rows[row], sort).is_none()).count();
            if without > 0 {
                notes
                    .push(format!("{without} of the rows that are not shown have no value of {by}, so they come last"));
            }
            order.truncate(top);
        } else if self.pareto.is_empty() {
            about.push_str(&format!("; {} by {by}", counted(all, "row")));
        }
        let shown: Vec<&Row> = order.iter().map(|&row| &rows[row]).collect();
        let mut columns = keys(ablation, selection, &rows, &shown);
        let zone = Rows(&shown).key("zone", |_| selection.zone.as_ref());
        columns.insert(KEY_COLUMNS.len(), zone.in_files());
        let measures = self.measures(ablation, &rows)?;
        if measures.contains(&Measure::Ms) {
            notes.push(
                "ms: CPU time of all nodes that an estimate is computed from, core-milliseconds per frame".to_owned(),
            );
        }
        let best = Best::new(ablation, &rows);
        for &measure in &measures {
            let column = ablation.measure_column(measure, &shown);
            let Some(metric) = measure.metric() else {
                columns.push(column);
                continue;
            };
            columns.push(column.marked(order.iter().map(|&row| best.mark(metric, row)).collect()));
            if let Some(resampling) = &self.intervals {
                let zone = ablation.zone(selection)?;
                let statistic = |row: &&Row| ablation.statistic(row.part_with(metric), Some(metric), zone);
                let found = resampling.intervals_of(&shown.iter().map(statistic).collect::<Vec<_>>(), stop)?;
                let metric = ablation.metrics[metric];
                columns.extend(interval_columns(metric, &resampling.level(), found, metric.decimals + 1));
            }
        }
        if let Some(resampling) = &self.intervals {
            notes.push(format!("intervals: {}", ablation.about_intervals(resampling)));
        }
        if measures.contains(&Measure::Density(Part::Disparity)) {
            notes.push(
                "a row combines a depth and the disparity it was computed from: density is that of the depth, disparity_density that of the disparity"
                    .to_owned(),
            );
        }
        if excluded > 0 {
            let rows = counted(excluded, "row");
            notes.push(format!("excluded: {rows} without any of these metrics"));
        }
        if rows.iter().all(|row| row.set == PixelSet::Valid) && rows.len() > 1 {
            notes.push(
                "each row covers its own valid pixels, so none is marked as best: compare density, too".to_owned(),
            );
        }
        let metrics: Vec<usize> = measures.iter().filter_map(|measure| measure.metric()).collect();
        let is_partial = |metric: usize| {
            let mut parts = rows.iter().map(|row| row.part_with(metric));
            parts.any(|row| row.comparable.is_some() && row.only_over_valid[metric])
        };
        for metric in metrics.iter().copied().filter(|metric| is_partial(*metric)) {
            let name = ablation.metrics[metric].name;
            notes.push(format!(
                "{name} excludes invalid pixels, also over all pixels with ground truth, so none is marked as best: compare density, or use `--pixels filled`"
            ));
        }
        notes.extend(best::note(&shown, &metrics));
        Ok(Table { about, label: self.label(ablation, selection), notes, ..Table::new(columns) })
    }

    /// The selection, which includes depths besides filled disparities if a metric of depths is requested.
    pub(super) fn with_depths(&self, selection: &Selection) -> Selection {
        let mut named = self.columns.iter().chain(&self.sort).chain(&self.pareto);
        let with_depths = named.any(|name| Family::Depth.metrics().iter().any(|metric| metric.name == *name));
        Selection { with_depths, ..selection.clone() }
    }

    /// The rows with a requested metric, and the number of excluded rows. If metrics of depths and of disparities are
    /// requested, the row of a depth is joined with the row of its disparity.
    pub(super) fn rows(&self, ablation: &Ablation<'_>, rows: Vec<Row>) -> Result<(Vec<Row>, usize), AnalysisError> {
        let named = self.columns.iter().chain(&self.sort).chain(&self.pareto);
        let named = named.map(|name| ablation.measure(name)).collect::<Result<Vec<Measure>, _>>()?;
        let mut metrics: Vec<usize> = named.iter().filter_map(|column| column.metric()).collect();
        if self.columns.is_empty() {
            metrics = (0..ablation.metrics.len()).collect();
        }
        let has_family =
            |family: Family| metrics.iter().any(|&metric| family.metrics().contains(ablation.metrics[metric]));
        if has_family(Family::Depth) && has_family(Family::Disparity)
            || named.iter().any(|column| column.is_of_disparity())
        {
            return Ok((joined(ablation, rows), 0));
        }
        let all = rows.len();
        let has_metric = |row: &Row| {
            let scored = &ablation.estimate(row).metrics;
            metrics.iter().any(|&metric| row.values[metric].is_some() || scored.contains(&ablation.metrics[metric]))
        };
        if metrics.is_empty() || !rows.iter().any(has_metric) {
            return Ok((rows, 0));
        }
        let rows: Vec<Row> = rows.into_iter().filter(has_metric).collect();
        let excluded = all - rows.len();
        Ok((rows, excluded))
    }

    /// The default sorting column: the first shown metric that a row has. If all are shown, `abs_rel` comes before
    /// others.
    fn default_sort(&self, ablation: &Ablation<'_>, rows: &[Row]) -> Result<Measure, AnalysisError> {
        let requested = self.columns.iter().map(|name| ablation.measure(name)).collect::<Result<Vec<_>, _>>()?;
        let has_value = |column: &Measure| rows.iter().any(|row| ablation.number(row, *column).is_some());
        let first = requested.into_iter().filter(|column| !column.is_axis()).find(has_value);
        Ok(first.unwrap_or_else(|| Measure::Metric(ablation.first_error(rows))))
    }

    /// A label that identifies the table among those of the experiment, built from the options that are not defaults.
    fn label(&self, ablation: &Ablation<'_>, selection: &Selection) -> String {
        let mut parts = vec![ablation.experiment.to_owned(), "variants".to_owned()];
        parts.extend(selection.label());
        let part = |word: &str, names: &[String]| (!names.is_empty()).then(|| format!("{word}-{}", names.join("-")));
        parts.extend(part("pareto", &self.pareto));
        parts.extend(part("of", &self.columns));
        parts.extend(self.sort.as_ref().map(|sort| format!("by-{sort}")));
        parts.extend(self.top.map(|top| format!("top-{top}")));
        parts.extend(self.intervals.map(|_| "ci".to_owned()));
        parts.join("-")
    }

    fn measures(&self, ablation: &Ablation<'_>, rows: &[Row]) -> Result<Vec<Measure>, AnalysisError> {
        if !self.columns.is_empty() {
            let columns = self.columns.iter().map(|name| {
                let column = ablation.measure(name)?;
                ablation.require(rows, column).map(|()| column)
            });
            // The axes have columns already.
            let mut distinct: Vec<Measure> = Vec::new();
            for column in columns.collect::<Result<Vec<_>, _>>()?.into_iter().filter(|column| !column.is_axis()) {
                if !distinct.contains(&column) {
                    distinct.push(column);
                }
            }
            return Ok(distinct);
        }
        let has_value = |column: &Measure| rows.iter().any(|row| ablation.number(row, *column).is_some());
        let mut columns: Vec<Measure> = (0..ablation.metrics.len()).map(Measure::Metric).filter(has_value).collect();
        let is_below_1 = |row: &Row| row.density.is_some_and(|density| density < 1.0);
        if rows.iter().flat_map(Row::parts).any(is_below_1) {
            columns.push(Measure::Density(Part::Own));
            let differs = |row: &Row| row.joined.as_ref().is_some_and(|disparity| disparity.density != row.density);
            if rows.iter().any(differs) {
                columns.push(Measure::Density(Part::Disparity));
            }
        }
        if rows.iter().any(|row| row.core_ms.is_some()) {
            columns.push(Measure::Ms);
        }
        if rows.iter().any(|row| row.frames != rows[0].frames) {
            columns.push(Measure::Frames(Part::Own));
        }
        Ok(columns)
    }
}

/// The columns that identify the shown rows, with which every table begins. Text shows the axes on which `rows` differ,
/// and the name of the estimate if there are several. If these do not identify rows, text also shows stage and variant.
pub(super) fn keys(ablation: &Ablation<'_>, selection: &Selection, rows: &[Row], shown: &[&Row]) -> Vec<Column> {
    let differ = |text: &dyn Fn(&Row) -> Option<String>| rows.iter().any(|row| text(row) != text(&rows[0]));
    let row_key = |row: &Row| &ablation.estimate(row).row_key;
    let cells = Rows(shown);
    let shown_if = |is_shown: bool, column: Column| if is_shown { column } else { column.in_files() };
    let mut axes = Vec::new();
    let mut shows_variant = false;
    for (axis, named) in ablation.axes.iter().enumerate() {
        let level = |row: &Row| ablation.level_name(row, axis).map(str::to_owned);
        let Some(column) = rows.first().and_then(|row| row_key(row).level(&named.name)).map(|level| &level.column)
        else {
            // Variants without a matrix are an axis.
            shows_variant |= differ(&level);
            continue;
        };
        let levels = Column::levels(column, shown.iter().map(|row| level(row)), |_| named.is_numeric).axis();
        let shown_name = (*column != named.name).then(|| named.name.clone());
        axes.push(shown_if(differ(&level), Column { shown: shown_name, ..levels }));
    }
    let is_shown =
        differ(&|row| Some(ablation.name(row))) || !shows_variant && axes.iter().all(|axis| axis.only_in_files);
    let set = |row: &Row| selection.set_name(row);
    let mut columns = vec![
        cells.key("stage", |row| &row_key(row).stage).in_files(),
        shown_if(shows_variant, cells.key("variant", |row| row_key(row).variant.as_ref())),
        shown_if(is_shown, cells.key("estimate", |row| ablation.name(row))),
        shown_if(differ(&|row| Some(set(row))), cells.key("set", |row| set(row))),
    ];
    columns.extend(axes);
    for place in 0..2 {
        if identifies_rows(&columns, shown) {
            break;
        }
        columns[place].only_in_files = false;
    }
    columns
}

/// Whether the text of rows of different estimates differs. An estimate may have several rows, as the best of several
/// zones.
fn identifies_rows(columns: &[Column], shown: &[&Row]) -> bool {
    let mut seen: HashMap<Vec<Option<String>>, usize> = HashMap::new();
    let texts = |row: usize| {
        let visible = columns.iter().filter(|column| !column.only_in_files);
        visible.map(|column| column.cells.text(row)).collect::<Vec<_>>()
    };
    (0..shown.len()).all(|row| {
        let estimate = shown[row].estimate;
        *seen.entry(texts(row)).or_insert(estimate) == estimate
    })
}

impl Ablation<'_> {
    /// The place of the default sorting metric: the first error, `abs_rel` before others.
    pub(crate) fn first_error(&self, rows: &[Row]) -> usize {
        let has_value = |metric: &usize| rows.iter().any(|row| row.value(*metric).is_some());
        let named = ["abs_rel", "d1", "epe"].into_iter().filter_map(|name| self.metric(name).ok()).find(has_value);
        let any = || (0..self.metrics.len()).filter(has_value).find(|metric| !self.metrics[*metric].more_is_better);
        named.or_else(any).or_else(|| (0..self.metrics.len()).find(has_value)).unwrap_or(0)
    }

    /// The rows on the Pareto front of some columns.
    fn front(&self, rows: &[Row], names: &[String]) -> Result<Vec<usize>, AnalysisError> {
        let columns = names.iter().map(|name| {
            let column = self.goal_measure(name, "`--pareto`")?;
            self.require(rows, column).map(|()| column)
        });
        let columns = columns.collect::<Result<Vec<Measure>, _>>()?;
        if columns.len() < 2 {
            return Err(AnalysisError::request(
                format!("`--pareto` needs two or more columns, but got only `{}`", names.join(",")),
                "name two columns, for example `--pareto abs_rel,ms`".to_owned(),
            ));
        }
        if !rows.iter().any(|row| columns.iter().all(|column| self.number(row, *column).is_some())) {
            return Err(AnalysisError::request(
                format!("no row has all of {}", listed(names.iter().map(String::as_str))),
                "only a disparity and the depth that `depth/from-disparity` computes from it share a row, if both are scored"
                    .to_owned(),
            ));
        }
        let goals: Vec<Goal> = columns.iter().map(|column| self.goal(*column)).collect();
        // Each group of comparable rows has its own front.
        let metrics: Vec<usize> = columns.iter().filter_map(|column| column.metric()).collect();
        let group = |row: usize| metrics.iter().map(|metric| rows[row].part_with(*metric).comparable).collect();
        let values = |row: usize| columns.iter().map(|column| self.number(&rows[row], *column)).collect();
        Ok(fronts(rows.len(), group, values, &goals))
    }

    /// The better direction of a measure, and its noise.
    pub(super) fn goal(&self, measure: Measure) -> Goal {
        Goal { better: self.better(measure), noise: if measure == Measure::Ms { TIMING_NOISE } else { 0.0 } }
    }

    /// A column of a measure of these rows.
    pub(super) fn measure_column(&self, measure: Measure, rows: &[&Row]) -> Column {
        let (rows, name) = (Rows(rows), self.measure_name(measure));
        let better = self.better(measure) == Better::More;
        let number = |row: &&Row| self.number(row, measure);
        match measure {
            Measure::Metric(metric) => rows.metric(self.metrics[metric], number),
            Measure::Ms => rows.number(name, number).format(Format::Fixed(2)).unit("ms").better(better),
            Measure::Density(_) => rows.share(name, number).unit(DIMENSIONLESS).better(better),
            Measure::Frames(_) => rows.count(name, |row| measure.count(row)).unit("frames"),
            Measure::Pixels(_) => rows.count(name, |row| measure.count(row)).unit("pixels"),
            Measure::Axis(axis) => rows.text(name, |row| self.level_name(row, axis)),
        }
    }
}
