//! Selects the estimates, maps and frames that a page shows, with limits on their numbers.

use std::collections::{BTreeSet, HashMap, HashSet};

use depthloom_figures::page::{Layer, Role, Series, evenly};
use depthloom_graphs::ValueType;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::plan::{FrameIndex, RunId, VariantId};
use depthloom_recording::Recording;
use depthloom_scores::{Align, Metric, PixelSet, Settings};

use crate::ablation::ScoreTable;
use crate::estimates::Estimate;
use crate::page::leading::leading_metric;
use crate::page::limits::{EXTREMES, MOST_CURVES, MOST_DETAILED, MOST_LAYERS, MOST_PICTURED, MOST_POINTS, PageRuns};
use crate::scores::FrameScore;

/// The estimates with curves: all, or those that all variants share and the best others.
pub(super) fn estimates_shown(estimates: &[Estimate], table: Option<&ScoreTable>) -> Vec<usize> {
    let mut shown = best_first(estimates, table, (0..estimates.len()).collect());
    shown.truncate(MOST_CURVES);
    shown.sort_unstable();
    shown
}

/// Those of some estimates that have pictures: of at most [`MOST_PICTURED`] maps, chosen like those with curves.
/// Variants can have a map in common; `map` is the recorded topic of an estimate's map.
fn pictured(
    estimates: &[Estimate],
    table: Option<&ScoreTable>,
    shown: Vec<usize>,
    map: impl Fn(&Estimate) -> Option<String>,
) -> Vec<usize> {
    let mut maps = HashSet::new();
    let mut pictured = best_first(estimates, table, shown);
    pictured.retain(|&index| {
        let map = map(&estimates[index]);
        maps.contains(&map) || (maps.len() < MOST_PICTURED && maps.insert(map))
    });
    pictured.sort_unstable();
    pictured
}

/// Estimates in order: those that all variants share, then the best by the [leading metric](leading_metric).
fn best_first(estimates: &[Estimate], table: Option<&ScoreTable>, mut candidates: Vec<usize>) -> Vec<usize> {
    let leading = table.and_then(|table| Some((table, leading_metric(&table.metrics)?)));
    let means: HashMap<(&str, PixelSet), f64> = leading.map_or_else(HashMap::new, |(table, metric)| {
        let rows = table.rows.iter();
        rows.filter_map(|row| Some(((row.label.as_str(), row.set), (*row.values.get(metric)?)?))).collect()
    });
    let sign = if leading.is_some_and(|(table, metric)| table.metrics[metric].more_is_better) { -1.0 } else { 1.0 };
    let rank = |index: usize| {
        let estimate = &estimates[index];
        let mean = set_of(estimate).and_then(|set| means.get(&(estimate.label.as_str(), set)));
        let mean = mean.filter(|mean| mean.is_finite());
        (estimate.row_key.variant.is_some(), mean.is_none(), mean.map_or(0.0, |mean| sign * mean))
    };
    candidates.sort_by(|&a, &b| rank(a).partial_cmp(&rank(b)).unwrap_or(std::cmp::Ordering::Equal).then(a.cmp(&b)));
    candidates
}

/// The displayed maps and frames of each stage run with recorded maps; `frames` is the number of frames that the user
/// wants.
pub(super) fn series(
    recording: &Recording,
    estimates: &[Estimate],
    shown: &[usize],
    table: Option<&ScoreTable>,
    scores: &[FrameScore],
    frames: Option<usize>,
) -> Vec<Series> {
    let plan = recording.plan();
    let mut all: Vec<Series> =
        RunId::all(plan.runs.len()).filter_map(|run| layers(recording, estimates, shown, table, run)).collect();
    let is_scored = |series: &Series| series.layers.iter().any(|layer| !layer.estimates.is_empty());
    let scored = all.iter().filter(|series| is_scored(series)).count();
    let runs = PageRuns { scored, unscored: all.len() - scored };
    for series in &mut all {
        let extremes = extremes(series, estimates, scores);
        let worst = worst(series, estimates, scores);
        let with_maps: Vec<FrameIndex> = FrameIndex::all(recording.frames(series.run).len())
            .step_by(usize::try_from(plan.every.max(1)).unwrap_or(usize::MAX))
            .collect();
        let shown = runs.frames_shown(with_maps.len(), is_scored(series), frames);
        series.positions = evenly(&with_maps, &extremes, shown);
        // Maps of a stage run without estimates are not intermediate.
        let most = if is_scored(series) { MOST_DETAILED } else { usize::MAX };
        series.detailed = evenly(&series.positions, &worst, most).into_iter().collect();
    }
    all.retain(|series| !series.positions.is_empty());
    all
}

/// The maps of a stage run: images, then ground truth, estimates, and other maps.
fn layers(
    recording: &Recording,
    estimates: &[Estimate],
    shown: &[usize],
    table: Option<&ScoreTable>,
    run: RunId,
) -> Option<Series> {
    let (plan, planned) = (recording.plan(), &recording.plan().runs[run]);
    let own: Vec<usize> = shown.iter().copied().filter(|&index| estimates[index].run == run).collect();
    let topic_of = |topic: &str| plan.find(run, topic).map(|(_, output)| output.topic.clone());
    let pictured = pictured(estimates, table, own, |estimate| topic_of(estimate.estimate_topic.as_ref()?));
    let variants: HashSet<&str> =
        pictured.iter().filter_map(|&index| estimates[index].row_key.variant.as_deref()).collect();
    let own_estimates = || estimates.iter().filter(|estimate| estimate.run == run);
    let truths: HashSet<String> =
        own_estimates().filter_map(|estimate| topic_of(estimate.truth_topic.as_ref()?)).collect();
    let mut by_topic: HashMap<String, Vec<usize>> = HashMap::new();
    for &index in &pictured {
        if let Some(topic) = estimates[index].estimate_topic.as_ref().and_then(|topic| topic_of(topic)) {
            by_topic.entry(topic).or_default().push(index);
        }
    }
    let every_estimate: HashSet<String> =
        own_estimates().filter_map(|estimate| topic_of(estimate.estimate_topic.as_ref()?)).collect();
    let is_map = |value_type| {
        use ValueType::{Depth, Disparity, Image, Mask, TrueDisparity, Weight};
        matches!(value_type, Image | Disparity | TrueDisparity | Depth | Weight | Mask)
    };
    let maps = || {
        plan.outputs(run)
            .filter(|(_, output)| output.recorded && !output.once && output.value_type().is_some_and(is_map))
    };
    let mut found = Vec::new();
    for (slot, output) in maps() {
        let shown_estimates = by_topic.get(&output.topic);
        let role = match (output.value_type(), shown_estimates) {
            (Some(ValueType::Image), _) => Role::Image,
            _ if truths.contains(&output.topic) => Role::Truth,
            (_, Some(_)) => Role::Estimate,
            _ if every_estimate.contains(&output.topic) => continue,
            _ => Role::Other,
        };
        // With many variants, only those whose estimates are shown.
        if let (Role::Other, Slot::Node { node, .. }) = (role, slot) {
            let node_variants = &planned.nodes[node].variants;
            let is_shown =
                |variant: &VariantId| plan.variants.get(variant.0).is_some_and(|name| variants.contains(name.as_str()));
            if node_variants.len() < plan.variants.len() && !node_variants.iter().any(is_shown) && !variants.is_empty()
            {
                continue;
            }
        }
        let name = output.topic.strip_prefix(&planned.prefix).unwrap_or(&output.topic).trim_start_matches('/');
        // A map that is scored with several alignments is shown with each of them.
        let mut by_alignment: Vec<(Option<Settings>, Vec<usize>)> = Vec::new();
        for &index in shown_estimates.into_iter().flatten() {
            let aligned = estimates[index].settings.filter(|settings| settings.align != Align::None);
            match by_alignment.iter_mut().find(|(known, _)| *known == aligned) {
                Some((_, indices)) => indices.push(index),
                None => by_alignment.push((aligned, vec![index])),
            }
        }
        if by_alignment.is_empty() {
            by_alignment.push((None, Vec::new()));
        }
        found.extend(by_alignment.into_iter().map(|(aligned, estimates)| Layer {
            topic: output.topic.clone(),
            name: name.to_owned(),
            role,
            value_type: output.value_type.clone(),
            estimates,
            truth: None,
            aligned,
        }));
    }
    // A stable sort keeps the order of the plan within a role.
    found.sort_by_key(|layer| layer.role as u8);
    found.truncate(MOST_LAYERS);
    for place in 0..found.len() {
        let truth = found[place].estimates.first().and_then(|&index| topic_of(estimates[index].truth_topic.as_ref()?));
        found[place].truth = truth.and_then(|truth| found.iter().position(|layer| layer.topic == truth));
    }
    let recorded = maps().count();
    (!found.is_empty()).then_some(Series {
        run,
        layers: found,
        recorded,
        positions: Vec::new(),
        detailed: BTreeSet::new(),
    })
}

/// The positions of the frames on which the pictured estimates are worst and best by their leading metric: the worst
/// and the best of every estimate, then the second of every estimate, and so on.
fn extremes(series: &Series, estimates: &[Estimate], scores: &[FrameScore]) -> Vec<FrameIndex> {
    let ranked: Vec<_> =
        ranked(series, estimates, scores).map(|(metric, frames)| worst_first(metric, frames)).collect();
    let of_rank = |rank: usize| {
        ranked.iter().flat_map(move |frames| [frames.get(rank), frames.iter().rev().nth(rank)].into_iter().flatten())
    };
    (0..EXTREMES).flat_map(of_rank).copied().collect()
}

/// The positions of the frames on which each pictured estimate is worst by its leading metric.
fn worst(series: &Series, estimates: &[Estimate], scores: &[FrameScore]) -> Vec<FrameIndex> {
    let worst = |(metric, frames)| worst_first(metric, frames).first().copied();
    ranked(series, estimates, scores).filter_map(worst).collect()
}

/// Frames in the order of a metric, from the worst to the best.
fn worst_first(metric: &Metric, mut smallest_first: Vec<FrameIndex>) -> Vec<FrameIndex> {
    if !metric.more_is_better {
        smallest_first.reverse();
    }
    smallest_first
}

/// For each pictured estimate, its leading metric and the frames by its value, the smallest first.
fn ranked<'a>(
    series: &'a Series,
    estimates: &'a [Estimate],
    scores: &'a [FrameScore],
) -> impl Iterator<Item = (&'static Metric, Vec<FrameIndex>)> + 'a {
    series.layers.iter().flat_map(|layer| &layer.estimates).filter_map(move |&index| {
        let metric = estimates[index].metrics[leading_metric(&estimates[index].metrics)?];
        let set = set_of(&estimates[index])?;
        let own =
            scores.iter().filter(|score| score.estimate == index && score.row.set == set && score.row.zone.is_empty());
        let mut values: Vec<(f64, FrameIndex)> = own
            .filter_map(|score| Some((score.row.get(metric).filter(|value| value.is_finite())?, score.position)))
            .collect();
        values.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Some((metric, values.into_iter().map(|(_, position)| position).collect()))
    })
}

/// The pixel set by which an estimate is ranked: all pixels with ground truth, if it was scored on them.
pub(super) fn set_of(estimate: &Estimate) -> Option<PixelSet> {
    estimate.sets.iter().copied().min()
}

/// The positions in the figure of scores by frame.
pub(super) fn points(frames: usize, pictured: &[FrameIndex]) -> Vec<FrameIndex> {
    evenly(&FrameIndex::all(frames).collect::<Vec<_>>(), pictured, MOST_POINTS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shared_and_the_best_of_many_estimates_are_shown() {
        let mut estimates: Vec<Estimate> = (0..40)
            .map(|i| Estimate::of_depths(&format!("v{i}/fused"), Some(&format!("v{i}")), "fused", &[PixelSet::All]))
            .collect();
        estimates.insert(0, Estimate::of_depths("stereo", None, "stereo", &[PixelSet::All]));
        let shown = estimates_shown(&estimates, None);
        assert_eq!(shown, (0..MOST_CURVES).collect::<Vec<_>>());
        assert_eq!(estimates_shown(&estimates[..3], None), [0, 1, 2]);
        // A map that two estimates have counts once.
        let map = |estimate: &Estimate| {
            Some(if estimate.label.starts_with("v0/") { "stereo" } else { &estimate.label }.to_owned())
        };
        let all = (0..estimates.len()).collect();
        assert_eq!(pictured(&estimates, None, all, map), (0..MOST_PICTURED + 1).collect::<Vec<_>>());
    }
}
