//! Scores on every frame, and what figures of scores have in common.

use super::{Figure, FigureRequest, FigureRun};
use crate::ablation::{Ablation, Row, Selection, listed, scored, source_of};
use crate::analyse::is_any;
use crate::error::AnalysisError;
use crate::estimators::{Estimator, estimators};
use crate::grid::{Grid, GridCells, GridColumn};
use crate::scores::FrameScore;
use depthloom_figures::{Axis, BLACK, Entry, Fill, Item, Panel, Sheet, Stroke, Swatch, colour, colour_of};

/// More rows of dots than this are not read any more.
const MOST_ROWS: usize = 60;
/// The height of such a row, points.
const ROW_PT: f64 = 13.0;
pub(super) const LINE_PT: f64 = 1.2;
/// Values that differ by more than this have an axis of ratios.
pub(super) const FAR: f64 = 20.0;

/// A run's scores, as far as they are asked for.
pub(super) struct Scores<'a> {
    estimators: &'a [Estimator],
    pub(super) ablation: Ablation<'a>,
    pub(super) selection: Selection,
    pub(super) rows: Vec<Row>,
    pub(super) metric: usize,
}

/// Calls `f` with a run's scores.
pub(super) fn with_scores<T>(
    run: &FigureRun<'_>,
    request: &FigureRequest,
    stop: &(dyn Fn() -> bool + Sync),
    f: impl FnOnce(&Scores<'_>) -> Result<T, AnalysisError>,
) -> Result<T, AnalysisError> {
    let estimators = estimators(run.recording.plan())?;
    let scores: Vec<FrameScore> = scored(run.recording, &estimators, stop)?;
    let source = source_of(run.recording);
    let ablation = Ablation::new(run.recording.plan(), &estimators, &scores, &source, None);
    let selection = Selection { set: request.scored_set, ..Selection::default() };
    let mut rows = ablation.rows(&selection)?;
    rows.retain(|row| {
        let of = ablation.estimator(row);
        let is = |patterns: &Option<String>, texts: &[&str]| {
            patterns.as_deref().is_none_or(|patterns| is_any(patterns, texts))
        };
        is(&request.stages, &[&of.lead.stage])
            && of.lead.variant.as_deref().is_none_or(|variant| is(&request.variants, &[variant]))
            && is(&request.estimators, &[&of.label, &of.name])
    });
    if rows.is_empty() {
        let labels: Vec<&str> = estimators.iter().map(|of| of.label.as_str()).collect();
        let what = "no estimator that was scored so is among those that are asked for".to_owned();
        return Err(AnalysisError::asked(what, format!("there are {}", listed(labels))));
    }
    let metric = match &request.score {
        Some(score) => ablation.metric(score)?,
        None => ablation.first_error(&rows),
    };
    rows.retain(|row| row.value(metric).is_some());
    if rows.is_empty() {
        let what = format!("`{}` was not taken of them", ablation.metrics[metric].name);
        return Err(AnalysisError::asked(what, "`depthloom table RUN` says what was scored".to_owned()));
    }
    f(&Scores { estimators: &estimators, ablation, selection, rows, metric })
}

impl Scores<'_> {
    pub(super) fn name(&self) -> &'static str {
        self.ablation.metrics[self.metric].name
    }

    /// The score's name and unit, and which way is better.
    pub(super) fn label(&self) -> String {
        let metric = self.ablation.metrics[self.metric];
        let unit = match crate::sheet::unit_of(metric) {
            crate::sheet::DIMENSIONLESS => String::new(),
            unit => format!(", {unit}"),
        };
        format!("{}{unit} ({} is better)", metric.name, if metric.more_is_better { "more" } else { "less" })
    }

    pub(super) fn of(&self, row: &Row) -> &Estimator {
        &self.estimators[row.estimator]
    }

    pub(super) fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for row in &self.rows {
            let name = self.of(row).name.as_str();
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    /// Position, id and score of the frames of a row.
    fn frames(&self, row: &Row) -> Result<Vec<(u64, String, f64)>, AnalysisError> {
        let (set, zone) = (row.set, self.ablation.zone(&self.selection)?);
        let metric = self.ablation.metrics[self.metric];
        let frames = self.ablation.frames(row.estimator, set, zone).iter();
        let of_frame =
            |score: &&FrameScore| Some((score.position.0 as u64, score.frame.to_string(), score.row.get(metric)?));
        Ok(frames.filter_map(of_frame).collect())
    }
}

/// The columns that say what rows are of.
fn keys(of: &[&Estimator]) -> Vec<GridColumn> {
    let key = |name: &str, cell: &dyn Fn(&Estimator) -> Option<String>| {
        GridColumn::key(name, of.iter().map(|of| cell(of)).collect())
    };
    vec![
        key("stage", &|of| Some(of.lead.stage.clone())),
        key("variant", &|of| of.lead.variant.clone()),
        key("estimator", &|of| Some(of.name.clone())),
    ]
}

pub(super) fn numbers(name: &str, values: Vec<Option<f64>>) -> GridColumn {
    GridColumn::of(name, GridCells::Number { decimals: 4, best: vec![false; values.len()], values })
}

/// From where to where numbers go, and how they lie best along an axis.
pub(super) fn axis_of(values: &[f64], label: String) -> Axis {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if low > 0.0 && high > FAR * low {
        let room = libm::pow(high / low, 0.04);
        return Axis::log(low / room, high * room, label);
    }
    let room = if high > low { 0.04 * (high - low) } else { 0.05 * high.abs().max(1e-9) };
    let below = if low >= 0.0 && low < 0.3 * high { 0.0 } else { low - room };
    Axis::new(below, high + room, label)
}

/// A strip of dots an estimator, a dot a frame; the upright line is the mean.
pub(super) fn frames(
    run: &FigureRun<'_>,
    request: &FigureRequest,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Figure, AnalysisError> {
    with_scores(run, request, stop, |scores| {
        let rows = &scores.rows;
        if rows.len() > MOST_ROWS {
            let what = format!("{} estimators are more than {MOST_ROWS} strips", rows.len());
            return Err(AnalysisError::asked(what, "choose some with --variant or --estimators".to_owned()));
        }
        let names = scores.names();
        let count = rows.len() as f64;
        // From top to bottom.
        let labels: Vec<String> = rows.iter().rev().map(|row| scores.of(row).label.clone()).collect();
        let mut items = Vec::new();
        let (mut all, mut of, mut positions, mut ids) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut sets = Vec::new();
        let mut fewest = u64::MAX;
        for (place, row) in rows.iter().enumerate() {
            let frames = scores.frames(row)?;
            fewest = fewest.min(frames.len() as u64);
            let y = count - place as f64 - 0.5;
            let tint = colour(colour_of(&names, &scores.of(row).name));
            // Dots of one strip lie on a few lines, so that equal scores do not hide each other.
            let dot = |(at, (.., value)): (usize, &(u64, String, f64))| (*value, y + [0.0, 0.14, -0.14][at % 3]);
            let points = frames.iter().enumerate().map(dot).collect();
            items.push(Item::Dots { points, radius: 1.5, fill: Fill::new(tint, 0.6) });
            if let Some(mean) = row.value(scores.metric) {
                let points = vec![(mean, y - 0.36), (mean, y + 0.36)];
                items.push(Item::Line { points, stroke: Stroke::new(BLACK, 1.1) });
            }
            for (position, id, value) in frames {
                all.push(value);
                of.push(scores.of(row));
                sets.push(Some(row.set.to_string()));
                positions.push(Some(position));
                ids.push(Some(id));
            }
        }
        let mut panel = Panel::new(axis_of(&all, scores.label()), Axis::names(&labels, ""));
        panel.items = items;
        panel.aspect = (count + 0.5) * ROW_PT / request.size.width_pt() / 0.75;
        let legend = vec![
            Entry::new("a frame", Swatch::Dot([0x66; 3])),
            Entry::new("the value of all frames", Swatch::Line(Stroke::new(BLACK, 1.1))),
        ];
        let drawing = request.sheet(Sheet { columns: 1, panels: vec![panel], legend, ..Sheet::default() })?;
        let mut columns = keys(&of);
        columns.push(GridColumn::key("set", sets));
        columns.push(GridColumn::of("position", GridCells::Count(positions)));
        columns.push(GridColumn::key("frame", ids));
        columns.push(numbers(scores.name(), all.into_iter().map(Some).collect()));
        let about = format!("{} on every frame: {}", scores.name(), scores.ablation.about(rows, &scores.selection)?);
        Ok(Figure { drawing, about, data: Grid { columns, ..Grid::default() }.sheet().csv(), notes: Vec::new() })
    })
}
