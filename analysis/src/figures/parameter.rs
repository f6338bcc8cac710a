//! A metric against the parameters of a matrix: a line for one, a heat map for two.

use depthloom_figures::{
    Anchor, Axis, Bar, Entry, Fill, Item, LINE_PT, Panel, SEQUENTIAL, Sheet, Stroke, Swatch, distinct, readable_on,
    tint,
};

use super::scores::Scores;
use super::{Figure, FigureRequest};
use crate::ablation::{Factor, LevelMeans, Row, level_means};
use crate::error::{AnalysisError, listed, unknown};
use crate::tables::{Column, Rows};

/// The mean of a metric over the rows of one estimate name with equal levels.
struct Point<'a> {
    name: &'a str,
    /// The level on each axis; `None` if the parameter does not affect the estimate.
    levels: Vec<Option<usize>>,
    label: String,
    /// The label as readers see it.
    title: String,
    rows: usize,
    mean: f64,
    /// Whether the mean is adjusted for the settings of the other parameters, because they differ between points.
    is_adjusted: bool,
    /// Whether points of the same name cannot be compared.
    is_confounded: bool,
}

/// A line against one parameter, or a heat map over two.
pub(super) fn parameter(scores: &Scores<'_>, request: &FigureRequest) -> Result<Figure, AnalysisError> {
    let axes = &scores.ablation.axes;
    let names = || axes.iter().map(|axis| axis.name.as_str());
    let varies = |axis: &usize| {
        let levels = scores.rows.iter().filter_map(|row| scores.ablation.level(row, *axis));
        distinct(levels).len() > 1
    };
    let place = |name: &String| names().position(|axis| axis == name).ok_or_else(|| unknown("axis", name, names()));
    let chosen: Vec<usize> = match request.axes.as_slice() {
        [] => (0..axes.len()).filter(varies).collect(),
        some => some.iter().map(place).collect::<Result<_, _>>()?,
    };
    let mut points = points(scores, &chosen);
    let sheet = match chosen[..] {
        [] => {
            let what = "no parameter differs between the selected variants".to_owned();
            let help = format!("axes of the experiment: {}", listed(names()));
            let help = if axes.is_empty() { "add a `matrix:` to the experiment".to_owned() } else { help };
            return Err(AnalysisError::request(what, help));
        }
        [axis] => line(scores, axis, &points),
        [across, up] => {
            points.retain(|point| point.levels.iter().all(Option::is_some));
            heat_maps(scores, [across, up], &points)
        }
        _ => {
            let what = format!("`parameter` shows one or two parameters, but {} are selected", chosen.len());
            let help = format!("name one or two of {} with `--axes`; the others are averaged over", listed(names()));
            return Err(AnalysisError::request(what, help));
        }
    };
    let rows = Rows(&points);
    let mut columns = vec![rows.key("estimate", |point| &point.label)];
    for (place, axis) in chosen.iter().map(|&axis| &axes[axis]).enumerate() {
        let level = |point: &Point<'_>| Some(axis.levels[point.levels[place]?].clone());
        columns.push(Column::levels(&axis.name, points.iter().map(level), |_| axis.is_numeric));
    }
    columns.push(rows.count("rows", |point| point.rows as u64));
    let over = match points.iter().filter(|point| point.levels[0].is_some()).map(|point| point.rows).max() {
        Some(rows) if rows > 1 => format!("; means over up to {rows} settings of the other parameters"),
        _ => String::new(),
    };
    let any = |is: fn(&Point<'_>) -> bool, words| if points.iter().any(is) { words } else { "" };
    let about = format!(
        "{} against {}: {}{over}{}{}",
        scores.name(),
        chosen.iter().map(|&axis| axes[axis].name.as_str()).collect::<Vec<_>>().join(" and "),
        scores.about()?,
        any(|point| point.is_adjusted, ", adjusted by least squares for settings that differ between points"),
        any(|point| point.is_confounded, ", which differ between points, so points cannot be compared"),
    );
    let means: Vec<f64> = points.iter().map(|point| point.mean).collect();
    scores.figure(request, sheet, about, columns, &means)
}

/// The points of each estimate name, adjusted for the settings of the other parameters.
fn points<'a>(scores: &'a Scores<'_>, axes: &[usize]) -> Vec<Point<'a>> {
    let mut points = Vec::new();
    for name in scores.names() {
        let rows: Vec<&Row> = scores.rows.iter().filter(|row| scores.estimate(row).name == name).collect();
        let levels = |row: &Row| axes.iter().map(|axis| scores.ablation.level(row, *axis)).collect::<Vec<_>>();
        let value = |row: &Row| row.value(scores.metric).unwrap_or(f64::NAN);
        let all = distinct(rows.iter().map(|row| levels(row)));
        let place =
            |row: &&Row| all.iter().position(|point| *point == levels(row) && point.iter().all(Option::is_some));
        let focus = Factor { levels: all.len(), of_row: rows.iter().map(place).collect() };
        let other = |axis: usize| Factor {
            levels: scores.ablation.axes[axis].levels.len(),
            of_row: rows.iter().map(|row| scores.ablation.level(row, axis)).collect(),
        };
        let others: Vec<Factor> =
            (0..scores.ablation.axes.len()).filter(|axis| !axes.contains(axis)).map(other).collect();
        let values: Vec<f64> = rows.iter().map(|row| value(row)).collect();
        let means = level_means(&values, &focus, &others.iter().collect::<Vec<_>>());
        for (place, point_levels) in all.iter().enumerate() {
            let own: Vec<&&Row> = rows.iter().filter(|row| levels(row) == *point_levels).collect();
            let without = point_levels.iter().zip(axes).find(|(level, _)| level.is_none()).map(|(_, axis)| *axis);
            let shown = scores.titles.estimate(name);
            let (label, title) = match (without, &own[..]) {
                (None, _) => (name.to_owned(), shown.to_owned()),
                (Some(_), [only]) => {
                    let only = scores.estimate(only);
                    (only.label.clone(), only.title.clone())
                }
                (Some(axis), _) => {
                    let axis = &scores.ablation.axes[axis].name;
                    (format!("{name} without {axis}"), format!("{shown} without {}", scores.titles.axis(axis)))
                }
            };
            let adjusted = match &means {
                LevelMeans::Adjusted(means) if without.is_none() => means[place],
                _ => None,
            };
            let plain = own.iter().map(|row| value(row)).sum::<f64>() / own.len() as f64;
            points.push(Point {
                name,
                levels: point_levels.clone(),
                label,
                title,
                rows: own.len(),
                mean: adjusted.unwrap_or(plain),
                is_adjusted: adjusted.is_some(),
                is_confounded: means == LevelMeans::Confounded,
            });
        }
    }
    points
}

fn line(scores: &Scores<'_>, axis: usize, points: &[Point<'_>]) -> Sheet {
    let axis = &scores.ablation.axes[axis];
    let numbers: Option<Vec<f64>> = axis.levels.iter().map(|level| level.parse().ok()).collect();
    let (x, place): (Axis, Box<dyn Fn(usize) -> f64>) = match numbers.filter(|_| axis.is_numeric) {
        Some(numbers) => {
            let used = points.iter().filter_map(|point| Some(numbers[point.levels[0]?]));
            let x = Axis::around(used.clone(), 0.04, scores.titles.axis(&axis.name).to_owned());
            let mut used: Vec<f64> = distinct(used);
            used.sort_by(f64::total_cmp);
            // Few values are used as ticks of the axis.
            (if used.len() <= 10 { x.with_ticks(used) } else { x }, Box::new(move |level| numbers[level]))
        }
        None => {
            let x = Axis::names(&shown_levels(scores, axis), scores.titles.axis(&axis.name).to_owned());
            (x, Box::new(|level| level as f64 + 0.5))
        }
    };
    let mut panel = Panel::new("", x, Axis::around(points.iter().map(|point| point.mean), 0.04, scores.label()));
    panel.aspect = Some(0.45);
    let (names, mut legend) = (distinct(points.iter().map(|point| point.name)), Vec::new());
    // Estimates that the parameter does not affect are horizontal lines.
    for point in points.iter().filter(|point| point.levels[0].is_none()) {
        let stroke = Stroke::new(tint(&names, point.name), LINE_PT).dashed(&[4.0, 2.5]);
        panel.items.push(Item::horizontal(point.mean, stroke));
        let words = match point.rows {
            1 => format!("{}, the same for all", point.title),
            rows => format!("{} (mean of {rows})", point.title),
        };
        legend.push(Entry::new(words, Swatch::Line(stroke)));
    }
    for name in &names {
        let own = points.iter().filter(|point| point.name == *name);
        let mut curve: Vec<(f64, f64)> = own.filter_map(|point| Some((place(point.levels[0]?), point.mean))).collect();
        if curve.is_empty() {
            continue;
        }
        curve.sort_by(|one, two| one.0.total_cmp(&two.0));
        let tint = tint(&names, name);
        panel.items.push(Item::Line(curve.clone(), Stroke::new(tint, LINE_PT)));
        panel.items.push(Item::Dots(curve, 2.0, Fill::new(tint, 1.0)));
        legend.push(Entry::new(scores.titles.estimate(name), Swatch::Line(Stroke::new(tint, LINE_PT))));
    }
    Sheet { columns: 1, panels: vec![panel], legend, ..Sheet::default() }
}

/// The levels of an axis as readers see them.
fn shown_levels(scores: &Scores<'_>, axis: &crate::ablation::Axis) -> Vec<String> {
    axis.levels.iter().map(|level| scores.titles.value(&axis.name, level).to_owned()).collect()
}

fn heat_maps(scores: &Scores<'_>, [across, up]: [usize; 2], points: &[Point<'_>]) -> Sheet {
    let [across, up] = [across, up].map(|axis| &scores.ablation.axes[axis]);
    let bar = Bar { ramp: SEQUENTIAL, axis: Axis::around(points.iter().map(|point| point.mean), 0.0, scores.label()) };
    let more_is_better = scores.ablation.metrics[scores.metric].more_is_better;
    let panel = |name: &str| {
        let own = || points.iter().filter(|point| point.name == name);
        let best = own().map(|point| point.mean).reduce(if more_is_better { f64::max } else { f64::min });
        let names = |axis| Axis::names(&shown_levels(scores, axis), scores.titles.axis(&axis.name));
        let mut panel = Panel::new(scores.titles.estimate(name), names(across), names(up));
        for point in own() {
            let [x, y] = [0, 1].map(|axis| point.levels[axis].unwrap_or(0) as f64);
            let colour = bar.colour(point.mean);
            let words = written(point.mean);
            panel.items.push(Item::Cell((x, x + 1.0), (y, y + 1.0), Fill::new(colour, 1.0), words));
            // The best is marked, because similar colours are hard to distinguish.
            if Some(point.mean) == best && !point.is_confounded {
                let (at, tint) = ((x + 0.5, y + 0.94), readable_on(colour));
                panel.items.push(Item::Words(at, -5.5, "best".to_owned(), Anchor::Middle, tint));
            }
        }
        panel.aspect = Some((up.levels.len() as f64 / across.levels.len() as f64).clamp(0.4, 1.2));
        panel
    };
    let names = distinct(points.iter().map(|point| point.name));
    let mut panels: Vec<Panel> = names.into_iter().map(panel).collect();
    if let [only] = &mut panels[..] {
        only.aspect = Some(0.4);
    }
    Sheet { columns: 3, panels, bars: vec![bar], ..Sheet::default() }
}

/// A number with three significant digits.
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
