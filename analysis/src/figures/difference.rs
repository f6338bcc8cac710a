//! The difference of the errors of two estimates by distance, with its band, and the handover distance.

use depthloom_figures::{
    Anchor, Axis, BLACK, Colour, Entry, Fill, Item, LINE_PT, OTHERS, Panel, Scale, Sheet, Step, Stroke, Swatch, bands,
    colour, lines, thin_entry, tint,
};
use depthloom_graphs::counted;

use super::{Figure, FigureRequest, FigureRun};
use crate::compare::{CompareOptions, ComparedRun, DistancePair, DistanceRow, Side, Statistic, compare_by_distance};
use crate::error::{AnalysisError, listed};
use crate::estimates::{Estimate, estimate_names, estimates};
use crate::query::is_any;
use crate::titles::Titles;

const BAND_OPACITY: f64 = 0.28;
const HANDOVER: Stroke = Stroke::new(BLACK, 0.8).dashed(&[3.0, 1.5]);
/// The colour of the difference, distinct from those of both estimates.
const DIFFERENCE: Colour = [0x44, 0x44, 0x55];
/// Bins with pixels from fewer frames are drawn faint, unless every frame has pixels there.
const FEW: usize = 5;

pub(super) fn difference(
    runs: &[FigureRun<'_>],
    request: &FigureRequest,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Figure, AnalysisError> {
    let sides = sides(runs, request)?;
    let compared: Vec<ComparedRun<'_>> =
        runs.iter().map(|run| ComparedRun { called: run.called, recording: run.recording }).collect();
    let samples: Vec<_> = runs.iter().filter_map(|run| run.samples.clone()).collect();
    let options = CompareOptions { resampling: request.resampling, ..CompareOptions::default() };
    let found = compare_by_distance(&compared, &samples, &sides, &options, request.bins.as_ref(), stop)?;
    let [pair] = &found.pairs[..] else {
        let what = format!("`difference` shows one pair of estimates, but {} match", found.pairs.len());
        return Err(AnalysisError::request(what, "name two estimates with `--estimates`".to_owned()));
    };
    let few = FEW.min(pair.frames);
    let labels = Titles::new(runs.iter().map(|run| run.recording.plan()));
    let titles = [0, 1].map(|side| {
        let own = &pair.estimates[side];
        labels.full(&own.title, own.variant.as_deref(), &own.estimate)
    });
    let titles = titles.each_ref().map(String::as_str);
    let ([baseline, other], level) = (distinguished(titles), request.resampling.level());
    let mut legend = vec![
        Entry::new(format!("{other} minus {baseline}"), Swatch::Line(Stroke::new(DIFFERENCE, LINE_PT))),
        Entry::new(format!("{level} interval"), Swatch::Block(Fill::new(DIFFERENCE, BAND_OPACITY))),
    ];
    for (title, tint) in [baseline, other].iter().zip(tints(pair)) {
        legend.push(Entry::new(format!("{title} has the smaller error"), Swatch::Block(Fill::new(tint, 0.16))));
    }
    if pair.handovers.iter().any(|(_, handover)| handover.is_some()) {
        legend.push(Entry::new(format!("handover, {level} interval"), Swatch::Line(HANDOVER)));
    }
    if pair.rows.iter().any(|row| is_thin(row, request, few)) {
        let too_few_frames = pair.rows.iter().any(|row| row.frames < few);
        let frames = if too_few_frames { format!(" or {few} frames") } else { String::new() };
        legend.push(thin_entry(format!("fewer than {} pixels{frames}", request.min_count), DIFFERENCE));
    }
    let panels = Statistic::ALL.map(|statistic| panel(pair, statistic, request, few)).into();
    let (handovers, notes) = found.table.notes.split_at(Statistic::ALL.len().min(found.table.notes.len()));
    let about = format!(
        "Absolute error of {} minus that of {} by ground-truth distance, over the pixels of {} that are valid in both; band: {}; {}",
        titles[1],
        titles[0],
        counted(pair.frames, "frame"),
        request.resampling.about(),
        handovers.join("; ")
    );
    let figure = request.figure(Sheet { columns: 2, panels, legend, ..Sheet::default() }, about, found.table.csv())?;
    Ok(Figure { notes: notes.to_vec(), ..figure })
}

/// The two estimates: those named, or by default stereo and mono, if there is one of each.
fn sides(runs: &[FigureRun<'_>], request: &FigureRequest) -> Result<Vec<Side>, AnalysisError> {
    let all = runs.iter().map(|run| estimates(run.recording.plan())).collect::<Result<Vec<_>, _>>()?;
    let patterns: Vec<&str> = request.estimates.as_deref().unwrap_or("stereo,mono").split(',').map(str::trim).collect();
    let any_estimate = FigureRequest { estimates: None, ..request.clone() };
    let one = |run: usize, pattern: &str| -> Result<Side, AnalysisError> {
        let is_one = |own: &&Estimate| {
            own.settings.is_some() && any_estimate.selects(own) && is_any(pattern, &[&own.label, &own.name])
        };
        let labels: Vec<&str> = all[run].iter().filter(is_one).map(|estimate| estimate.label.as_str()).collect();
        match labels[..] {
            [label] => Ok(Side { run, name: Some(label.to_owned()) }),
            [] => {
                let help = format!("name two with `--estimates`; available: {}", listed(estimate_names(&all[run])));
                Err(AnalysisError::request(format!("no depth estimate matches `{pattern}`"), help))
            }
            _ => {
                let help = "name two estimates, for example `--estimates stereo,full/mono`, or select with `--variant`";
                Err(AnalysisError::request(
                    format!("`{pattern}` matches several estimates: {}", listed(labels)),
                    help.to_owned(),
                ))
            }
        }
    };
    match (runs.len(), &patterns[..]) {
        (1, [first, second]) => Ok(vec![one(0, first)?, one(0, second)?]),
        (2, [first] | [first, _]) => Ok(vec![one(0, first)?, one(1, patterns[patterns.len() - 1])?]),
        _ => {
            let help = "name two estimates of one run (`--estimates stereo,full/mono`), or one estimate of two runs";
            Err(AnalysisError::request("`difference` needs two estimates".to_owned(), help.to_owned()))
        }
    }
}

/// Whether a bin has few pixels or frames: it is drawn faint and does not set the range of axes.
fn is_thin(row: &DistanceRow, request: &FigureRequest, few: usize) -> bool {
    row.pixels < request.min_count || row.frames < few
}

/// The colours of the baseline and the other, which differ even if their names are equal.
fn tints(pair: &DistancePair) -> [Colour; 2] {
    let names: Vec<&str> = pair.estimates.iter().map(|estimate| estimate.estimate.as_str()).collect();
    [tint(&names, names[0]), if names[0] == names[1] { colour(OTHERS[1]) } else { tint(&names, names[1]) }]
}

/// The parts in which two titles differ: of `size=3+weighting=full/fused` and `size=5+weighting=full/fused` the sizes.
/// Titles without a long common part are unchanged.
fn distinguished(titles: [&str; 2]) -> [String; 2] {
    const LONG: usize = 24;
    let parts = titles.map(|title| title.split_inclusive(['/', '+', ':']).collect::<Vec<&str>>());
    let is_long = titles.iter().any(|title| title.chars().count() > LONG);
    if !is_long || parts[0].len() != parts[1].len() || titles[0] == titles[1] {
        return titles.map(str::to_owned);
    }
    [0, 1].map(|side| {
        let own = parts[side].iter().zip(&parts[1 - side]).filter(|(one, other)| one != other).map(|(one, _)| *one);
        own.collect::<String>().trim_end_matches(['/', '+', ':']).to_owned()
    })
}

fn panel(pair: &DistancePair, statistic: Statistic, request: &FigureRequest, few: usize) -> Panel {
    let step = |row: &DistanceRow| Step {
        edges: (row.from_m, row.to_m),
        y: row.difference_m(),
        band: row.interval.map_or((row.difference_m(), row.difference_m()), |interval| (interval.low, interval.high)),
        is_thin: is_thin(row, request, few),
    };
    let steps: Vec<Step> = pair.rows.iter().filter(|row| row.statistic == statistic).map(step).collect();
    let all_thin = steps.iter().all(|step| step.is_thin);
    let shown = || steps.iter().filter(|step| all_thin || !step.is_thin).map(|step| step.band);
    let (low, high) =
        (shown().fold(0.0, |low, band| band.0.min(low)), shown().fold(0.0, |high, band| band.1.max(high)));
    let room = 0.06 * (high - low).max(1e-9);
    let (low, high) = request.y_max.map_or((low - room, high + room), |y_max| (-y_max, y_max));
    let (near, far) = (steps.first().map_or(0.0, |step| step.edges.0), steps.last().map_or(80.0, |step| step.edges.1));
    let near = if near < 0.5 * far { 0.0 } else { near };
    let y = Axis::new(low, high, format!("difference of {} errors, m", statistic.name()));
    let mut panel = Panel::new(statistic.name(), Axis::new(near, far, "ground-truth distance t, m"), y);
    panel.aspect = Some(0.66);
    // Above zero the other has larger errors, so that the baseline is better; below zero the other is better.
    for (y, tint) in [(0.0, high), (low, 0.0)].into_iter().zip(tints(pair)) {
        panel.items.push(Item::block((near, far), y, Fill::new(tint, 0.1)));
    }
    panel.items.push(Item::horizontal(0.0, Stroke::new(BLACK, 0.6)));
    let handover = pair.handovers.iter().find(|(by, _)| *by == statistic).and_then(|(_, handover)| handover.as_ref());
    let mut words = None;
    if let Some(handover) = handover {
        let middle = handover.distance_m;
        let ends = handover.interval.map_or((middle, middle), |interval| (interval.low, interval.high));
        let mut text = format!("{middle:.1} m");
        if handover.interval.is_some() {
            text += &format!(" [{:.1}, {:.1}]", ends.0, ends.1);
            let edge = (f64::NEG_INFINITY, f64::INFINITY);
            panel.items.push(Item::block(ends, edge, Fill::new([0x88; 3], 0.22)));
        }
        panel.items.push(Item::vertical(middle, HANDOVER));
        // The label is next to the line, on the side with more room.
        let (aside, on_left) = (0.012 * (far - near), middle < 0.5 * (near + far));
        let (x, anchor) = if on_left { (ends.1 + aside, Anchor::Start) } else { (ends.0 - aside, Anchor::End) };
        words = Some(Item::Words((x, high), -9.0, text, anchor, BLACK));
    }
    panel.items.extend(bands(&steps, Scale::Linear, Fill::new(DIFFERENCE, BAND_OPACITY)));
    panel.items.extend(lines(&steps, Scale::Linear, Stroke::new(DIFFERENCE, LINE_PT)));
    let dots = steps.iter().map(|step| (0.5 * (step.edges.0 + step.edges.1), step.y)).collect();
    panel.items.push(Item::Dots(dots, 1.6, Fill::new(DIFFERENCE, 0.8)));
    panel.items.extend(words);
    panel
}

#[cfg(test)]
mod tests;
