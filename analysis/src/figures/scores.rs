//! Scores on every frame, and the common parts of figures of scores.

use depthloom_figures::{Axis, BLACK, Entry, Fill, Item, Panel, Sheet, Stroke, Swatch, distinct, tint};

use super::{Figure, FigureRequest, FigureRun};
use crate::ablation::{Ablation, Row, Selection, scored, source_keys};
use crate::error::{AnalysisError, listed};
use crate::estimates::{Estimate, estimates};
use crate::scores::FrameScore;
use crate::tables::{Column, DIMENSIONLESS, Rows, Table, unit_of};
use crate::titles::Titles;

/// The maximum number of readable strips.
const MAX_ROWS: usize = 60;
/// The height of a strip, points.
const ROW_PT: f64 = 13.0;

/// The displayed scores of a run.
pub(super) struct Scores<'a> {
    estimates: &'a [Estimate],
    pub(super) ablation: Ablation<'a>,
    selection: Selection,
    pub(super) rows: Vec<Row>,
    pub(super) metric: usize,
    pub(super) titles: Titles,
}

/// Calls `draw` with a run's scores.
pub(super) fn with_scores(
    run: &FigureRun<'_>,
    request: &FigureRequest,
    stop: &(dyn Fn() -> bool + Sync),
    draw: impl FnOnce(&Scores<'_>) -> Result<Figure, AnalysisError>,
) -> Result<Figure, AnalysisError> {
    let estimates = estimates(run.recording.plan())?;
    let scores: Vec<FrameScore> = scored(run.recording, &estimates, stop)?;
    let source = source_keys(run.recording);
    let ablation = Ablation::new(run.recording.plan(), &estimates, &scores, &source, None);
    let selection = Selection { set: request.scored_set, ..Selection::default() };
    let mut rows = ablation.rows(&selection)?;
    rows.retain(|row| request.selects(ablation.estimate(row)));
    if rows.is_empty() {
        let what = "no selected estimate was scored on these pixels".to_owned();
        let labels = listed(estimates.iter().map(|estimate| estimate.label.as_str()));
        return Err(AnalysisError::request(what, format!("available: {labels}")));
    }
    let metric = match &request.score {
        Some(score) => ablation.metric(score)?,
        None => ablation.first_error(&rows),
    };
    rows.retain(|row| row.value(metric).is_some());
    if rows.is_empty() {
        let what = format!("`{}` was not scored for the selected estimates", ablation.metrics[metric].name);
        return Err(AnalysisError::request(what, "`depthloom table RUN` shows what was scored".to_owned()));
    }
    let titles = Titles::new([run.recording.plan()]);
    draw(&Scores { estimates: &estimates, ablation, selection, rows, metric, titles })
}

impl Scores<'_> {
    pub(super) fn name(&self) -> &'static str {
        self.ablation.metrics[self.metric].name
    }

    /// The name and unit of the metric, and its better direction.
    pub(super) fn label(&self) -> String {
        let metric = self.ablation.metrics[self.metric];
        let unit = match unit_of(metric) {
            DIMENSIONLESS => String::new(),
            unit => format!(", {unit}"),
        };
        format!("{}{unit} ({})", metric.name, metric.better())
    }

    pub(super) fn estimate(&self, row: &Row) -> &Estimate {
        &self.estimates[row.estimate]
    }

    pub(super) fn names(&self) -> Vec<&str> {
        distinct(self.rows.iter().map(|row| self.estimate(row).name.as_str()))
    }

    /// Describes the pixels and frames of the scores.
    pub(super) fn about(&self) -> Result<String, AnalysisError> {
        self.ablation.about(&self.rows, &self.selection)
    }

    /// The figure with its data as a table, whose last column contains the scores.
    pub(super) fn figure(
        &self,
        request: &FigureRequest,
        sheet: Sheet,
        about: String,
        mut columns: Vec<Column>,
        scores: &[f64],
    ) -> Result<Figure, AnalysisError> {
        columns.push(Rows(scores).number(self.name(), |score| *score));
        request.figure(sheet, about, Table::new(columns).csv())
    }
}

/// One strip of dots per estimate, one dot per frame; the vertical line is the mean.
pub(super) fn frames(scores: &Scores<'_>, request: &FigureRequest) -> Result<Figure, AnalysisError> {
    let (rows, names) = (&scores.rows, scores.names());
    if rows.len() > MAX_ROWS {
        let what = format!("{} estimates are selected, but the maximum is {MAX_ROWS}", rows.len());
        return Err(AnalysisError::request(what, "select some with `--variant` or `--estimates`".to_owned()));
    }
    let (zone, metric) = (scores.ablation.zone(&scores.selection)?, scores.ablation.metrics[scores.metric]);
    let (mut items, mut all) = (Vec::new(), Vec::<(&Row, &FrameScore, f64)>::new());
    for (place, row) in rows.iter().enumerate() {
        // Strips go from top to bottom. The dots of a strip are on three lines, so that equal scores do not hide each
        // other.
        let y = rows.len() as f64 - place as f64 - 0.5;
        let frames = scores.ablation.frames(row.estimate, row.set, zone).iter();
        let start = all.len();
        all.extend(frames.filter_map(|frame| Some((row, *frame, frame.row.get(metric)?))));
        let dot = |(at, (.., value)): (usize, &(_, _, f64))| (*value, y + [0.0, 0.14, -0.14][at % 3]);
        let dots = all[start..].iter().enumerate().map(dot).collect();
        items.push(Item::Dots(dots, 1.5, Fill::new(tint(&names, &scores.estimate(row).name), 0.6)));
        let mean = row.value(scores.metric).unwrap_or(f64::NAN);
        items.push(Item::Line(vec![(mean, y - 0.36), (mean, y + 0.36)], Stroke::new(BLACK, 1.1)));
    }
    let values: Vec<f64> = all.iter().map(|(.., value)| *value).collect();
    let labels: Vec<String> = rows.iter().rev().map(|row| scores.estimate(row).title.clone()).collect();
    let x = Axis::around(values.iter().copied(), 0.04, scores.label());
    let aspect = Some((rows.len() as f64 + 0.5) * ROW_PT / request.size.width_pt() / 0.75);
    let mut panel = Panel::new("", x, Axis::names(&labels, ""));
    (panel.items, panel.aspect) = (items, aspect);
    let legend = vec![
        Entry::new("one frame", Swatch::Dot(Fill::new([0x66; 3], 1.0))),
        Entry::new("the value over all frames", Swatch::Line(Stroke::new(BLACK, 1.1))),
    ];
    let cells = Rows(&all);
    let columns = vec![
        cells.key("stage", |(row, ..)| &scores.estimate(row).row_key.stage),
        cells.key("variant", |(row, ..)| scores.estimate(row).row_key.variant.as_ref()),
        cells.key("estimate", |(row, ..)| &scores.estimate(row).name),
        cells.key("set", |(row, ..)| row.set.name()),
        cells.count("position", |(_, frame, _)| frame.position.0 as u64),
        cells.key("frame", |(_, frame, _)| &*frame.frame),
    ];
    let about = format!("{} on every frame: {}", scores.name(), scores.about()?);
    let sheet = Sheet { columns: 1, panels: vec![panel], legend, ..Sheet::default() };
    scores.figure(request, sheet, about, columns, &values)
}
