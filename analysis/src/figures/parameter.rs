//! A score against the parameters of a matrix: a line for one, a heat map for two.

use super::scores::{FAR, LINE_PT, Scores, axis_of, numbers, with_scores};
use super::{Figure, FigureRequest, FigureRun};
use crate::ablation::{Factor, LevelMeans, Row, level_means, listed, unknown};
use crate::error::AnalysisError;
use crate::grid::{Grid, GridCells, GridColumn};
use depthloom_figures::{
    Anchor, Axis, Bar, Entry, Fill, Item, Panel, SEQUENTIAL, Scale, Sheet, Stroke, Swatch, colour, colour_of,
    readable_on, ticks_at,
};

/// A line against one parameter, or a heat map over two.
pub(super) fn parameter(
    run: &FigureRun<'_>,
    request: &FigureRequest,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Figure, AnalysisError> {
    with_scores(run, request, stop, |scores| {
        let axes = &scores.ablation.axes;
        let names = || axes.iter().map(|axis| axis.name.as_str());
        let varies = |axis: &usize| {
            let first = scores.rows.iter().find_map(|row| scores.ablation.level(row, *axis));
            scores.rows.iter().filter_map(|row| scores.ablation.level(row, *axis)).any(|level| Some(level) != first)
        };
        let chosen: Vec<usize> = match request.axes.as_slice() {
            [] => (0..axes.len()).filter(varies).collect(),
            some => {
                let place = |name: &String| {
                    let found = axes.iter().position(|axis| axis.name == *name);
                    found.ok_or_else(|| unknown("axis", name, names()))
                };
                some.iter().map(place).collect::<Result<_, _>>()?
            }
        };
        let help = || format!("its axes are {}", listed(names()));
        match chosen[..] {
            [] => Err(AnalysisError::asked(
                "no parameter differs between the variants that are asked for".to_owned(),
                if axes.is_empty() { "give the experiment a `matrix:`".to_owned() } else { help() },
            )),
            [one] => line(scores, request, one),
            [one, two] => heat_map(scores, request, (one, two)),
            _ => Err(AnalysisError::asked(
                format!("{} parameters are too many for a figure", chosen.len()),
                format!("name one or two of {} with --axes; others are averaged over", listed(names())),
            )),
        }
    })
}

/// The mean of a score over all rows with these levels, and how many these are.
struct Point<'a> {
    name: &'a str,
    levels: Vec<usize>,
    sum: f64,
    rows: u64,
    /// The mean adjusted for the settings of the other parameters, where those are not the same at each point.
    adjusted: Option<f64>,
    /// Whether points of the same name can be compared at all.
    is_confounded: bool,
}

/// The rows of one name that have no level on an axis: what no value of the parameter changes.
struct Shared<'a> {
    name: &'a str,
    label: String,
    mean: f64,
    rows: u64,
}

fn shared_of<'a>(scores: &'a Scores<'_>, axis: usize) -> Vec<Shared<'a>> {
    let without = || scores.rows.iter().filter(|row| scores.ablation.level(row, axis).is_none());
    let mut found: Vec<Shared<'a>> = Vec::new();
    for row in without() {
        let (name, Some(value)) = (scores.of(row).name.as_str(), row.value(scores.metric)) else { continue };
        match found.iter_mut().find(|known| known.name == name) {
            Some(known) => {
                known.label = format!("{name} without {}", scores.ablation.axes[axis].name);
                known.rows += 1;
                known.mean += (value - known.mean) / known.rows as f64;
            }
            None => found.push(Shared { name, label: scores.of(row).label.clone(), mean: value, rows: 1 }),
        }
    }
    found
}

fn points<'a>(scores: &'a Scores<'_>, axes: &[usize]) -> Vec<Point<'a>> {
    let mut points: Vec<Point<'a>> = Vec::new();
    for row in &scores.rows {
        let levels: Option<Vec<usize>> = axes.iter().map(|axis| scores.ablation.level(row, *axis)).collect();
        let (Some(levels), Some(value)) = (levels, row.value(scores.metric)) else { continue };
        let name = scores.of(row).name.as_str();
        match points.iter_mut().find(|known| known.name == name && known.levels == levels) {
            Some(known) => {
                known.sum += value;
                known.rows += 1;
            }
            None => points.push(Point { name, levels, sum: value, rows: 1, adjusted: None, is_confounded: false }),
        }
    }
    adjust(scores, axes, &mut points);
    points
}

/// Adjusts the means of points for the settings of the other parameters, name by name.
fn adjust(scores: &Scores<'_>, axes: &[usize], points: &mut [Point<'_>]) {
    let mut names: Vec<&str> = points.iter().map(|of| of.name).collect();
    names.sort_unstable();
    names.dedup();
    for name in names {
        let own = |row: &&Row| scores.of(row).name == name && row.value(scores.metric).is_some();
        let rows: Vec<&Row> = scores.rows.iter().filter(own).collect();
        let values: Vec<f64> = rows.iter().filter_map(|row| row.value(scores.metric)).collect();
        let place = |row: &&Row| {
            let levels: Vec<usize> =
                axes.iter().map(|axis| scores.ablation.level(row, *axis)).collect::<Option<_>>()?;
            points.iter().position(|of| of.name == name && of.levels == levels)
        };
        let focus = Factor { levels: points.len(), of_row: rows.iter().map(place).collect() };
        let others: Vec<Factor> = (0..scores.ablation.axes.len())
            .filter(|axis| !axes.contains(axis))
            .map(|axis| Factor {
                levels: scores.ablation.axes[axis].levels.len(),
                of_row: rows.iter().map(|row| scores.ablation.level(row, axis)).collect(),
            })
            .collect();
        match level_means(&values, &focus, &others.iter().collect::<Vec<_>>()) {
            LevelMeans::Plain => {}
            LevelMeans::Confounded => {
                points.iter_mut().filter(|of| of.name == name).for_each(|of| of.is_confounded = true);
            }
            LevelMeans::Adjusted(means) => {
                let found = points.iter_mut().zip(means).filter(|(_, mean)| mean.is_some());
                found.for_each(|(point, mean)| point.adjusted = mean);
            }
        }
    }
}

impl Point<'_> {
    fn value(&self) -> f64 {
        self.adjusted.unwrap_or(self.sum / self.rows as f64)
    }
}

/// The table of a figure's points, and of what is the same at each of them, which has no level.
fn table(scores: &Scores<'_>, axes: &[usize], points: &[Point<'_>], shared: &[Shared<'_>]) -> Vec<u8> {
    let names = points.iter().map(|of| of.name).chain(shared.iter().map(|of| of.label.as_str()));
    let mut columns = vec![GridColumn::key("estimator", names.map(|name| Some(name.to_owned())).collect())];
    for (place, axis) in axes.iter().enumerate() {
        let axis = &scores.ablation.axes[*axis];
        let levels = points.iter().map(|of| Some(axis.levels[of.levels[place]].clone()));
        let cells = levels.chain(shared.iter().map(|_| None)).collect();
        columns.push(GridColumn::levels(&axis.name, cells, |_| axis.is_numeric));
    }
    let rows = points.iter().map(|of| of.rows).chain(shared.iter().map(|of| of.rows));
    columns.push(GridColumn::of("rows", GridCells::Count(rows.map(Some).collect())));
    let values = points.iter().map(|of| Some(of.value())).chain(shared.iter().map(|of| Some(of.mean)));
    columns.push(numbers(scores.name(), values.collect()));
    Grid { columns, ..Grid::default() }.sheet().csv()
}

fn about(scores: &Scores<'_>, axes: &[usize], points: &[Point<'_>]) -> Result<String, AnalysisError> {
    let names: Vec<&str> = axes.iter().map(|axis| scores.ablation.axes[*axis].name.as_str()).collect();
    let over = match points.iter().map(|of| of.rows).max() {
        Some(rows) if rows > 1 => format!("; means over up to {rows} settings of the other parameters"),
        _ => String::new(),
    };
    let pixels = scores.ablation.about(&scores.rows, &scores.selection)?;
    let adjusted = match points.iter().any(|of| of.adjusted.is_some()) {
        true => ", adjusted by least squares for those that not every point has",
        false => "",
    };
    let confounded = match points.iter().any(|of| of.is_confounded) {
        true => ", which differ from point to point: points cannot be compared",
        false => "",
    };
    Ok(format!("{} against {}: {pixels}{over}{adjusted}{confounded}", scores.name(), names.join(" and ")))
}

fn line(scores: &Scores<'_>, request: &FigureRequest, axis: usize) -> Result<Figure, AnalysisError> {
    let points = points(scores, &[axis]);
    let of_axis = &scores.ablation.axes[axis];
    let mut names: Vec<&str> = points.iter().map(|of| of.name).collect();
    names.dedup();
    // What no value of the parameter changes is a level line.
    let shared = shared_of(scores, axis);
    let shared_names = shared.iter().map(|of| of.name);
    let all_names: Vec<&str> = scores
        .names()
        .into_iter()
        .filter(|name| names.contains(name) || shared_names.clone().any(|of| of == *name))
        .collect();
    let tint = |name: &str| colour(colour_of(&all_names, name));
    let numbers: Option<Vec<f64>> = of_axis
        .levels
        .iter()
        .map(|level| level.parse().ok())
        .collect::<Option<Vec<f64>>>()
        .filter(|_| of_axis.is_numeric);
    let used: Vec<f64> = numbers.iter().flat_map(|of| points.iter().map(|point| of[point.levels[0]])).collect();
    let (mut x, place): (Axis, Box<dyn Fn(usize) -> f64>) = match numbers {
        Some(of) => (axis_of(&used, of_axis.name.clone()), Box::new(move |level| of[level])),
        None => (Axis::names(&of_axis.levels, of_axis.name.clone()), Box::new(|level| level as f64 + 0.5)),
    };
    if x.named.is_none() {
        let mut values = used.clone();
        values.sort_by(f64::total_cmp);
        values.dedup();
        if x.scale == Scale::Linear && x.low == 0.0 && values.first().is_some_and(|first| *first > 0.0) {
            x.low = values[0] - 0.04 * (x.high - values[0]);
        }
        // Few values stand at the axis themselves.
        if values.len() <= 10 {
            x.named = Some(ticks_at(values));
        }
    }
    let mut values: Vec<f64> = points.iter().map(Point::value).collect();
    values.extend(shared.iter().map(|of| of.mean));
    let mut panel = Panel::new(x, axis_of(&values, scores.label()));
    let mut legend = Vec::new();
    for of in &shared {
        let stroke = Stroke::new(tint(of.name), LINE_PT).dashed(&[4.0, 2.5]);
        panel.items.push(Item::Level { y: of.mean, stroke: stroke.clone() });
        let words = match of.rows {
            1 => format!("{}, the same for all", of.label),
            rows => format!("{} (mean of {rows})", of.label),
        };
        legend.push(Entry::new(words, Swatch::Line(stroke)));
    }
    let mut known: Vec<&str> = Vec::new();
    for name in points.iter().map(|of| of.name) {
        if known.contains(&name) {
            continue;
        }
        known.push(name);
        let mut curve: Vec<(f64, f64)> =
            points.iter().filter(|of| of.name == name).map(|of| (place(of.levels[0]), of.value())).collect();
        curve.sort_by(|one, two| one.0.total_cmp(&two.0));
        let stroke = Stroke::new(tint(name), LINE_PT);
        panel.items.push(Item::Line { points: curve.clone(), stroke: stroke.clone() });
        panel.items.push(Item::Dots { points: curve, radius: 2.0, fill: Fill::new(tint(name), 1.0) });
        legend.push(Entry::new(name, Swatch::Line(stroke)));
    }
    if request.size.is_wide() {
        panel.aspect = 0.45;
    }
    let drawing = request.sheet(Sheet { columns: 1, panels: vec![panel], legend, ..Sheet::default() })?;
    let data = table(scores, &[axis], &points, &shared);
    Ok(Figure { drawing, about: about(scores, &[axis], &points)?, data, notes: Vec::new() })
}

fn heat_map(
    scores: &Scores<'_>,
    request: &FigureRequest,
    (across, up): (usize, usize),
) -> Result<Figure, AnalysisError> {
    let points = points(scores, &[across, up]);
    let axes = &scores.ablation.axes;
    let values: Vec<f64> = points.iter().map(Point::value).collect();
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let axis = match low > 0.0 && high > FAR * low {
        true => Axis::log(low, high, scores.label()),
        false => Axis::new(low, high, scores.label()),
    };
    let bar = Bar { ramp: SEQUENTIAL, axis };
    let mut names: Vec<&str> = Vec::new();
    for name in points.iter().map(|of| of.name) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    request.few_panels(names.len())?;
    let columns = if request.size.is_wide() { names.len().clamp(1, 3) } else { 1 };
    let better =
        |one: f64, two: f64| if scores.ablation.metrics[scores.metric].more_is_better { one > two } else { one < two };
    let mut panels = Vec::new();
    for (place, name) in names.iter().enumerate() {
        let of_name = || points.iter().filter(|of| of.name == *name);
        let best = of_name().map(Point::value).reduce(|best, value| if better(value, best) { value } else { best });
        let label = |is_shown: bool, axis: usize| if is_shown { axes[axis].name.clone() } else { String::new() };
        let x = Axis::names(&axes[across].levels, label(place + columns >= names.len(), across));
        let y = Axis::names(&axes[up].levels, label(place % columns == 0, up));
        let mut panel = Panel::new(x, y);
        panel.title = Some((*name).to_owned());
        for point in of_name() {
            let (x, y, value) = (point.levels[0] as f64, point.levels[1] as f64, point.value());
            let fill = Fill::new(bar.colour(value), 1.0);
            panel.items.push(Item::Cell { x: (x, x + 1.0), y: (y, y + 1.0), fill, words: written(value) });
        }
        // The best is marked: colours alone do not say which of two alike it is.
        for point in of_name().filter(|of| Some(of.value()) == best && !of.is_confounded) {
            let at = (point.levels[0] as f64 + 0.5, point.levels[1] as f64 + 0.94);
            let tint = readable_on(bar.colour(point.value()));
            let (words, anchor) = ("best".to_owned(), Anchor::Middle);
            panel.items.push(Item::Words { at, up: -5.5, words, anchor, colour: tint });
        }
        panel.aspect = match columns {
            1 if request.size.is_wide() => 0.4,
            _ => (axes[up].levels.len() as f64 / axes[across].levels.len() as f64).clamp(0.4, 1.2),
        };
        panels.push(panel);
    }
    let drawing = request.sheet(Sheet { columns, panels, bars: vec![bar], ..Sheet::default() })?;
    let chosen = [across, up];
    let data = table(scores, &chosen, &points, &[]);
    Ok(Figure { drawing, about: about(scores, &chosen, &points)?, data, notes: Vec::new() })
}

/// A number with three digits that count.
fn written(value: f64) -> String {
    let decimals = match value.abs() {
        ..0.0005 => 5,
        ..1.0 => 3,
        ..10.0 => 2,
        ..100.0 => 1,
        _ => 0,
    };
    format!("{value:.decimals$}")
}
