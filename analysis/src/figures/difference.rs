//! How much farther off one estimate is than another by distance, with its band, and where one hands over to the other.

use depthloom_figures::{
    Anchor, Axis, BLACK, Colour, Entry, Fill, Item, OTHERS, Panel, Sheet, Stroke, Swatch, colour, colour_of,
};
use depthloom_graphs::counted;

use super::{Figure, FigureRequest, FigureRun};
use crate::ablation::{listed, names_of};
use crate::analyse::is_any;
use crate::compare::{
    CompareOptions, ComparedRun, DistancePair, DistanceRow, Handover, Side, Statistic, compare_by_distance,
};
use crate::error::AnalysisError;
use crate::estimators::{Estimator, estimators};

const LINE_PT: f64 = 1.2;
const BAND_OPACITY: f64 = 0.28;
const FAINT: f64 = 0.45;
const HANDOVER_DASHES: &[f64] = &[3.0, 1.5];
const THIN_DASHES: &[f64] = &[0.8, 1.6];
/// The colour of the difference: that of neither estimate.
const DIFFERENCE: [u8; 3] = [0x44, 0x44, 0x55];
/// An interval of a bin that fewer frames have pixels in says little, unless no frame lacks it.
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
        let what = format!("{} pairs are too many for a figure of a difference", found.pairs.len());
        return Err(AnalysisError::asked(what, "name one with --estimators".to_owned()));
    };
    let few = FEW.min(pair.frames);
    let columns = if request.size.is_wide() { 2 } else { 1 };
    let mut panels = Vec::new();
    for (place, statistic) in Statistic::ALL.into_iter().enumerate() {
        let mut panel = panel(pair, statistic, request, few);
        if columns == 1 && place == 0 {
            panel.x.label = String::new();
        }
        panels.push(panel);
    }
    let [baseline, other] = [0, 1].map(|side| pair.estimates[side].title.as_str());
    let short = told_apart([baseline, other]);
    let level = request.resampling.level();
    let mut legend = vec![
        Entry::new(format!("{} less {}", short[1], short[0]), Swatch::Line(Stroke::new(DIFFERENCE, LINE_PT))),
        Entry::new(format!("{level} interval"), Swatch::Block(Fill::new(DIFFERENCE, BAND_OPACITY))),
    ];
    for (title, tint) in short.iter().zip(tints(pair)) {
        legend.push(Entry::new(format!("{title} is nearer the truth"), Swatch::Block(Fill::new(tint, 0.16))));
    }
    if pair.handovers.iter().any(|(_, handover)| handover.is_some()) {
        let stroke = Stroke::new(BLACK, 0.8).dashed(HANDOVER_DASHES);
        legend.push(Entry::new(format!("handover, {level} interval"), Swatch::Line(stroke)));
    }
    let is_thin = |row: &DistanceRow| is_thin(row, request, few);
    if pair.rows.iter().any(is_thin) {
        let stroke = Stroke::new(DIFFERENCE, 0.85).faint(0.7).dashed(THIN_DASHES);
        let frames =
            if pair.rows.iter().any(|row| row.frames < few) { format!(" or {few} frames") } else { String::new() };
        legend.push(Entry::new(format!("fewer than {} pixels{frames}", request.thin), Swatch::Line(stroke)));
    }
    let drawing = request.sheet(Sheet { columns, panels, legend, ..Sheet::default() })?;
    let handovers: Vec<&str> = found.grid.notes.iter().take(Statistic::ALL.len()).map(String::as_str).collect();
    let about = format!(
        "Absolute error of {other} less that of {baseline} by true distance, over the pixels of {} that both answered; band: {}; {}",
        counted(pair.frames, "frame"),
        request.resampling.about(),
        handovers.join("; ")
    );
    let notes = found.grid.notes.iter().skip(Statistic::ALL.len()).cloned().collect();
    Ok(Figure { drawing, about, data: found.csv(), notes })
}

/// The two estimates: those named, or stereo and mono where there is one of each.
fn sides(runs: &[FigureRun<'_>], request: &FigureRequest) -> Result<Vec<Side>, AnalysisError> {
    let all = runs.iter().map(|run| estimators(run.recording.plan())).collect::<Result<Vec<_>, _>>()?;
    let is_wanted = |of: &&Estimator| {
        let is = |patterns: &Option<String>, text: &str| {
            patterns.as_deref().is_none_or(|patterns| is_any(patterns, &[text]))
        };
        of.settings.is_some()
            && is(&request.stages, &of.lead.stage)
            && of.lead.variant.as_deref().is_none_or(|variant| is(&request.variants, variant))
    };
    let patterns: Vec<&str> = match request.estimators.as_deref() {
        Some(patterns) => patterns.split(',').map(str::trim).collect(),
        None => vec!["stereo", "mono"],
    };
    let one = |run: usize, pattern: &str| -> Result<Side, AnalysisError> {
        let of_run = || all[run].iter().filter(|of| is_wanted(of));
        let labels: Vec<&str> =
            of_run().filter(|of| is_any(pattern, &[&of.label, &of.name])).map(|of| of.label.as_str()).collect();
        match labels[..] {
            [label] => Ok(Side { run, name: Some(label.to_owned()) }),
            [] => {
                let what = format!("no estimator is `{pattern}`");
                let names = listed(names_of(&all[run]));
                Err(AnalysisError::asked(what, format!("name two with --estimators; there are {names}")))
            }
            _ => {
                let what = format!("`{pattern}` are several: {}", listed(labels));
                let help = "name two estimates, e.g. `--estimators stereo,full/mono`, or choose with --variant";
                Err(AnalysisError::asked(what, help.to_owned()))
            }
        }
    };
    match (runs.len(), &patterns[..]) {
        (1, [first, second]) => Ok(vec![one(0, first)?, one(0, second)?]),
        (2, [both]) => Ok(vec![one(0, both)?, one(1, both)?]),
        (2, [first, second]) => Ok(vec![one(0, first)?, one(1, second)?]),
        _ => Err(AnalysisError::asked(
            "a difference is of two estimates".to_owned(),
            "name two of one run (`--estimators stereo,full/mono`), or one of two runs".to_owned(),
        )),
    }
}

/// Whether a bin says little: it is drawn faint, and sets no axis.
fn is_thin(row: &DistanceRow, request: &FigureRequest, few: usize) -> bool {
    row.pixels < request.thin || row.frames < few
}

/// The colours of the baseline and the other, which differ where their names do not.
fn tints(pair: &DistancePair) -> [Colour; 2] {
    let names: Vec<&str> = pair.estimates.iter().map(|of| of.estimator.as_str()).collect();
    let of = |side: usize| colour(colour_of(&names, names[side]));
    [of(0), if names[0] == names[1] { colour(OTHERS[1]) } else { of(1) }]
}

/// What tells two titles apart: of `size=3+weighting=full/fused` and `size=5+weighting=full/fused` the sizes. Titles without a long part in common are left as they are.
fn told_apart(titles: [&str; 2]) -> [String; 2] {
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
    let rows: Vec<&DistanceRow> = pair.rows.iter().filter(|row| row.statistic == statistic).collect();
    let ends =
        |row: &DistanceRow| row.interval.map_or((row.difference_m(), row.difference_m()), |of| (of.low, of.high));
    let is_thin = |row: &DistanceRow| is_thin(row, request, few);
    let thick: Vec<&DistanceRow> = rows.iter().copied().filter(|row| !is_thin(row)).collect();
    let shown = if thick.is_empty() { &rows } else { &thick };
    let low = shown.iter().map(|row| ends(row).0).fold(0.0, f64::min);
    let high = shown.iter().map(|row| ends(row).1).fold(0.0, f64::max);
    let room = 0.06 * (high - low).max(1e-9);
    let (low, high) = match request.most {
        Some(most) => (-most, most),
        None => (low - room, high + room),
    };
    let near = rows.first().map_or(0.0, |row| row.from_m);
    let far = rows.last().map_or(80.0, |row| row.to_m);
    let near = if near < 0.5 * far { 0.0 } else { near };
    let x = Axis::new(near, far, "true distance t, m");
    let y = Axis::new(low, high, format!("difference of {} errors, m", statistic.name()));
    let mut panel = Panel::new(x, y);
    panel.title = Some(statistic.name().to_owned());
    panel.aspect = 0.66;
    let tints = tints(pair);
    // Above zero the other is farther off, so that the baseline is nearer the truth; below it is the other way round.
    for ((from, to), side) in [((0.0, high), 0), ((low, 0.0), 1)] {
        let (fill, words) = (Fill::new(tints[side], 0.1), String::new());
        panel.items.push(Item::Cell { x: (near, far), y: (from, to), fill, words });
    }
    panel.items.push(Item::Level { y: 0.0, stroke: Stroke::new(BLACK, 0.6) });
    let handover = pair.handovers.iter().find(|(of, _)| *of == statistic).and_then(|(_, of)| of.as_ref());
    if let Some(of) = handover {
        if let Some(interval) = of.interval {
            let fill = Fill::new([0x88; 3], 0.22);
            panel.items.push(Item::Stripe { from: interval.low, to: interval.high, fill });
        }
        let stroke = Stroke::new(BLACK, 0.8).dashed(HANDOVER_DASHES);
        panel.items.push(Item::Upright { x: of.distance_m, stroke });
    }
    // Steps from bin to bin, faint where one of the two is thin, none over a gap.
    let middle = |row: &DistanceRow| 0.5 * (row.from_m + row.to_m);
    for step in rows.windows(2).filter(|step| step[1].from_m - step[0].to_m <= 1e-9) {
        let is_faint = step.iter().any(|row| is_thin(row));
        let share = if is_faint { FAINT } else { 1.0 };
        let band = |row: &&DistanceRow| (middle(row), ends(row).0, ends(row).1);
        let fill = Fill::new(DIFFERENCE, BAND_OPACITY * share);
        panel.items.push(Item::Band { points: step.iter().map(band).collect(), fill });
        let points = step.iter().map(|row| (middle(row), row.difference_m())).collect();
        let stroke = match is_faint {
            true => Stroke::new(DIFFERENCE, 0.85).faint(0.7).dashed(THIN_DASHES),
            false => Stroke::new(DIFFERENCE, LINE_PT),
        };
        panel.items.push(Item::Line { points, stroke });
    }
    for (is_faint, opacity) in [(true, FAINT), (false, 1.0)] {
        let points = rows.iter().filter(|row| is_thin(row) == is_faint).map(|row| (middle(row), row.difference_m()));
        panel.items.push(Item::Dots { points: points.collect(), radius: 1.6, fill: Fill::new(DIFFERENCE, opacity) });
    }
    if let Some(of) = handover {
        // Beside the line, on the side that has room.
        let aside = 0.012 * (far - near);
        let (x, anchor) = match of.distance_m < 0.5 * (near + far) {
            true => (of.interval.map_or(of.distance_m, |of| of.high) + aside, Anchor::Start),
            false => (of.interval.map_or(of.distance_m, |of| of.low) - aside, Anchor::End),
        };
        let words = told(of);
        panel.items.push(Item::Words { at: (x, high), up: -9.0, words, anchor, colour: BLACK });
    }
    panel
}

/// `23.1 m [20.0, 26.2]`: which is nearer the truth on which side of it the colours say, for names may be longer than a panel is wide.
fn told(of: &Handover) -> String {
    let interval = of.interval.map(|of| format!(" [{:.1}, {:.1}]", of.low, of.high)).unwrap_or_default();
    format!("{:.1} m{interval}", of.distance_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_are_told_apart_by_what_differs() {
        let long = ["size=3+weighting=full/fused", "size=5+weighting=full/fused"];
        assert_eq!(told_apart(long), ["size=3", "size=5"]);
        assert_eq!(told_apart(["stereo", "full/mono"]), ["stereo", "full/mono"]);
        let other = ["stereo", "a=1+b=2+c=3+d=4+e=5+f=6/fused"];
        assert_eq!(told_apart(other), other);
        assert_eq!(told_apart(["weighting=full/mono_scaled", "weighting=full/fused"]), ["mono_scaled", "fused"]);
    }
}
