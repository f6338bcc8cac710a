//! Scores of many variants in one table: one row per estimate, its factors in columns. Rows can be sorted and ranked,
//! and the effect of each axis computed.

mod adjusted;
mod answer;
mod best;
mod best_value;
mod comparability;
mod cost;
mod effects;
mod factor;
mod frame_groups;
mod front;
mod joined;
mod leaderboard;
mod measure;
mod ranking;
mod score_table;
mod shared;
mod variance;
mod zones;

use std::collections::{BTreeSet, HashMap};

use depthloom_graphs::Key;
use depthloom_graphs::plan::{FrameIndex, Labels, RunId, VariantId};
use depthloom_recording::RecordedPlan;
use depthloom_scores::{Family, Mean, Metric, PixelSet, ScoreRow};

pub(crate) use adjusted::{LevelMeans, level_means};
pub(crate) use answer::{FrameSet, scored, select_frames, selected_frames, source_keys};
pub use answer::{Question, answer};
pub use best_value::{BestValue, best_value};
use comparability::Classes;
pub use cost::Costs;
pub(crate) use effects::table as effects_table;
pub(crate) use factor::Factor;
use frame_groups::FrameGroups;
pub(crate) use joined::estimate_by_label;
pub use leaderboard::{BoardRun, leaderboard};
pub use ranking::Ranking;
pub use score_table::TableRow;
pub(crate) use score_table::{ScoreTable, paper_number};
pub(crate) use shared::shared_scores;
pub(crate) use zones::table as zones_table;

use crate::compare::few_frames;
use crate::error::{AnalysisError, listed, unknown};
use crate::estimates::{Estimate, check_patterns, estimate_names, matches_estimate, pattern_matches};
use crate::input::frame_choice::FrameChoice;
use crate::scores::{FrameScore, averaged};
use crate::statistics::{Grouping, Resampling, Statistic, Weighted};
use crate::tables::COMMON;

/// Selects the scores of a recording that a table shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Whether scores are computed again from recorded maps, only over the pixels with ground truth that are valid in
    /// all selected estimates.
    pub common: bool,
    /// The pixel set. `None`: every pixel with ground truth, or for an estimate that was not scored on those, the set
    /// it was scored on.
    pub set: Option<PixelSet>,
    /// Whether depths are included where only disparities have the pixel set.
    pub with_depths: bool,
    /// The zone; `None`: the whole image.
    pub zone: Option<String>,
    /// The frames; `None`: all.
    pub frames: Option<FrameChoice>,
    /// How the value of a data set is averaged. `None`: as the experiment declares it.
    pub mean: Option<Mean>,
    /// Patterns of labels or names of estimates, separated by commas; `*` matches any characters. `None`: all.
    pub estimates: Option<String>,
    /// The groups of frames that intervals resample. `None`: each frame alone.
    pub grouping: Option<Grouping>,
}

impl Selection {
    /// The pixel set of a row in tables.
    pub(crate) fn set_name(&self, row: &Row) -> String {
        let mut sets: Vec<&str> = row.parts().map(|part| part.set.name()).collect();
        sets.dedup();
        if self.common { COMMON.to_owned() } else { sets.join("+") }
    }

    /// The parts of a LaTeX label that identify the selection.
    pub(crate) fn label(&self) -> Vec<String> {
        let parts = [
            self.common.then(|| "common".to_owned()),
            self.set.map(|set| set.name().to_owned()),
            self.zone.as_ref().map(|zone| format!("zone-{zone}")),
            self.mean.map(|mean| format!("mean-{}", mean.name())),
            self.estimates.clone(),
            self.frames.as_ref().map(|_| "frames".to_owned()),
        ];
        parts.into_iter().flatten().collect()
    }
}

/// An axis of the experiment and its levels: numbers by size, others in the order of the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Axis {
    pub(crate) name: String,
    pub(crate) levels: Vec<String>,
    /// Whether all levels are numbers.
    pub(crate) is_numeric: bool,
}

/// A recording's scores by estimate.
pub(crate) struct Ablation<'a> {
    pub(crate) experiment: &'a str,
    estimates: &'a [Estimate],
    pub(crate) axes: Vec<Axis>,
    /// The level of each estimate on each axis; `None` if the estimate has no level there.
    levels: Vec<Vec<Option<usize>>>,
    /// Whether a pixel was scored on any frame, complete or not.
    has_pixels: bool,
    /// The metrics that any estimate has, in the order of the catalogue.
    pub(crate) metrics: Vec<&'static Metric>,
    scores: HashMap<(usize, PixelSet, &'a str), Vec<&'a FrameScore>>,
    /// The zones, in the order of the recording, the whole image first.
    zones: Vec<&'a str>,
    core_ms: Vec<Option<f64>>,
    has_timings: bool,
    /// For each estimate, the topic of its disparity: the estimate itself, or the disparity it was computed from.
    disparities: Vec<Option<&'a str>>,
    source: &'a dyn Fn(RunId, FrameIndex) -> Option<Key>,
    /// The groups of frames that intervals resample; `None`: each frame alone.
    groups: Option<FrameGroups>,
}

/// An estimate's scores on the selected pixels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Row {
    pub(crate) estimate: usize,
    /// The pixel set of the scores.
    pub(crate) set: PixelSet,
    /// How many frames had a pixel to score.
    pub(crate) frames: u64,
    /// The number of scored pixels in all frames.
    pub(crate) pixels: u64,
    /// The share of pixels with ground truth that are valid, averaged like the scores: over frames or over pixels.
    pub(crate) density: Option<f64>,
    /// One value per metric of the ablation.
    pub(crate) values: Vec<Option<f64>>,
    pub(crate) core_ms: Option<f64>,
    /// Rows with the same number are comparable: same frames, same pixels, same scoring. Metrics that are
    /// [over valid pixels only](Self::only_over_valid) are not comparable.
    pub(crate) comparable: Option<usize>,
    /// For each metric of the ablation, whether it excludes invalid pixels of the row.
    pub(crate) only_over_valid: Vec<bool>,
    /// How its values are averaged.
    pub(crate) mean: Mean,
    /// The scores of the disparity that this depth was computed from, if both share one row.
    pub(crate) joined: Option<Box<Row>>,
}

impl Row {
    /// The row and the row that is joined to it.
    pub(crate) fn parts(&self) -> impl Iterator<Item = &Self> {
        std::iter::once(self).chain(self.joined.as_deref())
    }

    /// The part of the row that has a value of this metric.
    pub(crate) fn part_with(&self, metric: usize) -> &Self {
        self.joined.as_deref().filter(|joined| joined.values[metric].is_some()).unwrap_or(self)
    }

    pub(crate) fn value(&self, metric: usize) -> Option<f64> {
        self.part_with(metric).values[metric]
    }

    /// Rows with the same number are comparable by this metric.
    pub(crate) fn comparable_by(&self, metric: usize) -> Option<usize> {
        let part = self.part_with(metric);
        part.comparable.filter(|_| !part.only_over_valid[metric])
    }
}

impl<'a> Ablation<'a> {
    /// Collects the scores of complete frames: frames that have scores of all estimates of their stage.
    /// `source(run, position)` is the key of the source values of a frame.
    pub(crate) fn new(
        plan: &'a RecordedPlan,
        estimates: &'a [Estimate],
        scores: &'a [FrameScore],
        source: &'a dyn Fn(RunId, FrameIndex) -> Option<Key>,
        costs: Option<&Costs>,
    ) -> Self {
        let (axes, levels) = axes(plan, estimates);
        let mut by_row: HashMap<(usize, PixelSet, &str), Vec<&FrameScore>> = HashMap::new();
        let mut zones = vec![""];
        let mut metrics: Vec<&'static Metric> = Vec::new();
        for score in crate::scores::scores_of_complete_frames(scores, estimates) {
            let zone = score.row.zone.as_str();
            if !zones.contains(&zone) {
                zones.push(zone);
            }
            for (metric, _) in &score.row.scores {
                if !metrics.iter().any(|known| known.name == metric.name) {
                    metrics.push(metric);
                }
            }
            by_row.entry((score.estimate, score.row.set, zone)).or_default().push(score);
        }
        metrics.sort_by_key(|metric| metric.place());
        Self {
            experiment: &plan.experiment,
            estimates,
            axes,
            levels,
            has_pixels: scores.iter().any(|score| score.row.pixels > 0),
            metrics,
            scores: by_row,
            zones,
            core_ms: costs.map_or_else(|| vec![None; estimates.len()], |costs| costs.core_ms(plan, estimates)),
            has_timings: costs.is_some(),
            disparities: joined::disparities(plan, estimates),
            source,
            groups: None,
        }
    }

    /// Resamples groups of frames instead of frames.
    pub(crate) fn with_groups(self, groups: Option<FrameGroups>) -> Self {
        Self { groups, ..self }
    }

    /// A note if few groups of frames are resampled.
    pub(crate) fn few_groups(&self) -> Option<String> {
        let groups = self.groups.as_ref()?;
        let distinct: BTreeSet<(RunId, usize)> =
            groups.by_frame.iter().map(|((run, _), group)| (*run, *group)).collect();
        let of_run = |run: &RunId| distinct.iter().filter(|(known, _)| known == run).count();
        let runs: BTreeSet<RunId> = distinct.iter().map(|(run, _)| *run).collect();
        few_frames(runs.iter().map(of_run).min()?, "group")
    }

    /// Describes the intervals.
    pub(crate) fn about_intervals(&self, resampling: &Resampling) -> String {
        resampling.about_units(self.groups.as_ref().map_or("frames", |groups| &groups.unit))
    }

    /// The selected rows, in the order of estimates.
    ///
    /// # Errors
    /// If nothing is selected; the error names the selection and the available values.
    pub(crate) fn rows(&self, selection: &Selection) -> Result<Vec<Row>, AnalysisError> {
        self.any_score()?;
        if let Some(patterns) = &selection.estimates {
            check_patterns(patterns, self.estimates)?;
        }
        let zone = self.zone(selection)?;
        self.check_set(selection)?;
        let mut rows = self.rows_on_sets(selection, zone, |estimate| set_of(estimate, selection).into_iter().collect());
        rows.retain(|row| self.scores.contains_key(&(row.estimate, row.set, zone)));
        if rows.is_empty() {
            return Err(self.nothing_selected(selection, zone));
        }
        Ok(rows)
    }

    /// The selected rows, one per pixel set (`valid` before `all`), including rows without a score.
    pub(crate) fn rows_on_all_sets(&self, selection: &Selection) -> Result<Vec<Row>, AnalysisError> {
        let zone = self.zone(selection)?;
        Ok(self.rows_on_sets(selection, zone, |estimate| {
            let is_selected = |set: &PixelSet| selection.set.is_none_or(|selected| selected == *set);
            let mut sets: Vec<PixelSet> = estimate.sets.iter().copied().filter(is_selected).collect();
            sets.sort_by_key(|set| std::cmp::Reverse(*set));
            sets
        }))
    }

    fn rows_on_sets(
        &self,
        selection: &Selection,
        zone: &'a str,
        sets: impl Fn(&Estimate) -> Vec<PixelSet>,
    ) -> Vec<Row> {
        let mut classes = Classes::default();
        let mut rows = Vec::new();
        for (index, estimate) in self.estimates.iter().enumerate() {
            if selection.estimates.as_deref().is_some_and(|pattern| !matches_estimate(estimate, pattern)) {
                continue;
            }
            let mean = selection.mean.unwrap_or(estimate.mean);
            for set in sets(estimate) {
                let scores = self.frames(index, set, zone);
                let comparable = classes.class(estimate, (set, mean), scores, self.source);
                rows.push(self.row(index, set, scores, mean, comparable));
            }
        }
        rows
    }

    fn row(&self, index: usize, set: PixelSet, scores: &[&FrameScore], mean: Mean, comparable: Option<usize>) -> Row {
        let settings = self.estimates[index].settings.unwrap_or_default();
        let rows = || scores.iter().map(|score| &score.row);
        let value = |metric: &&'static Metric| match mean {
            Mean::Frames => average(rows().filter_map(|row| row.get(metric))),
            Mean::Pixels => metric.pooled(rows(), &settings),
        };
        let (valid, truth) = (rows().map(|row| row.valid).sum::<u64>(), rows().map(|row| row.truth).sum::<u64>());
        Row {
            estimate: index,
            set,
            frames: rows().filter(|row| row.pixels > 0).count() as u64,
            pixels: rows().map(|row| row.pixels).sum(),
            density: match mean {
                Mean::Frames => average(rows().filter_map(ScoreRow::density)),
                Mean::Pixels => (truth > 0).then(|| valid as f64 / truth as f64),
            },
            values: self.metrics.iter().map(value).collect(),
            only_over_valid: self
                .metrics
                .iter()
                .map(|metric| rows().any(|row| metric.pixels(row) < row.pixels))
                .collect(),
            core_ms: self.core_ms[index],
            comparable,
            mean,
            joined: None,
        }
    }

    /// A metric of a row as a function of the weight of each frame or group of frames that has it, and their number.
    /// Without a metric the function returns NaN.
    fn statistic(&self, row: &Row, metric: Option<usize>, zone: &'a str) -> (usize, Box<Statistic<'_>>) {
        let none = || -> (usize, Box<Statistic<'_>>) { (0, Box::new(|_: &[f64]| f64::NAN)) };
        let Some(metric) = metric.map(|metric| self.metrics[metric]) else { return none() };
        let estimate = self.estimate(row);
        let settings = estimate.settings.unwrap_or_default();
        let scores = self.frames(row.estimate, row.set, zone);
        let rows = scores.iter().map(|score| &score.row);
        let Some((frames, weighted)) = Weighted::of_scored_frames(metric, row.mean, &settings, rows) else {
            return none();
        };
        let Some(groups) = &self.groups else { return (frames, Box::new(move |times: &[f64]| weighted.value(times))) };
        let scored = scores.iter().filter(|score| score.row.get(metric).is_some());
        let of_frames: Vec<Option<&usize>> =
            scored.map(|score| groups.by_frame.get(&(estimate.run, score.position))).collect();
        // Numbered without gaps: a group may have no frame with this metric.
        let present: BTreeSet<Option<&usize>> = of_frames.iter().copied().collect();
        let numbers: HashMap<Option<&usize>, usize> = present.into_iter().zip(0..).collect();
        let weighted = weighted.grouped(&of_frames.iter().map(|group| numbers[group]).collect::<Vec<_>>());
        (numbers.len(), Box::new(move |times: &[f64]| weighted.value(times)))
    }

    pub(crate) fn estimate(&self, row: &Row) -> &Estimate {
        &self.estimates[row.estimate]
    }

    /// The names of a row's estimates under `estimates:`.
    pub(crate) fn name(&self, row: &Row) -> String {
        let names: Vec<&str> = row.parts().map(|part| self.estimate(part).name.as_str()).collect();
        names.join("+")
    }

    /// The level of a row on an axis.
    pub(crate) fn level(&self, row: &Row, axis: usize) -> Option<usize> {
        self.levels[row.estimate][axis]
    }

    /// A level's name.
    pub(crate) fn level_name(&self, row: &Row, axis: usize) -> Option<&str> {
        self.level(row, axis).map(|level| self.axes[axis].levels[level].as_str())
    }

    /// The scores of an estimate, frame by frame.
    pub(crate) fn frames(&self, estimate: usize, set: PixelSet, zone: &'a str) -> &[&'a FrameScore] {
        self.scores.get(&(estimate, set, zone)).map_or(&[], Vec::as_slice)
    }

    /// The zones that were scored, the whole image first, as an empty name.
    pub(crate) fn zones(&self) -> &[&'a str] {
        &self.zones
    }

    /// The selected zone; the whole image is an empty name.
    pub(crate) fn zone(&self, selection: &Selection) -> Result<&'a str, AnalysisError> {
        let Some(name) = &selection.zone else { return Ok("") };
        let known = &self.zones[1..];
        known.iter().find(|zone| **zone == name).copied().ok_or_else(|| {
            if known.is_empty() {
                return AnalysisError::request(
                    format!("there is no zone `{name}`: this recording has scores only for the whole image"),
                    "declare `zones` in the score of the experiment, and run it again".to_owned(),
                );
            }
            unknown("zone", name, known.iter().copied())
        })
    }

    /// Checks that something was scored on the selected pixel set.
    pub(crate) fn check_set(&self, selection: &Selection) -> Result<(), AnalysisError> {
        let mut scored: Vec<PixelSet> = self.estimates.iter().flat_map(|estimate| estimate.sets.clone()).collect();
        scored.sort_unstable();
        scored.dedup();
        match selection.set {
            None => Ok(()),
            Some(set) if scored.contains(&set) => Ok(()),
            Some(set) => {
                let scored: Vec<String> = scored.iter().map(|set| format!("`{set}`")).collect();
                Err(AnalysisError::request(
                    format!("nothing was scored on `{set}`"),
                    format!("scored pixel sets: {}; add `{set}` to `sets` and run again", scored.join(" and ")),
                ))
            }
        }
    }

    /// Checks that there is a score: a frame without pixels has no score.
    fn any_score(&self) -> Result<(), AnalysisError> {
        if self.metrics.is_empty() {
            let what = match self.has_pixels {
                true => "no frame has scores of all estimates of its stage",
                false => "not one pixel was scored",
            };
            let help = "`depthloom report` prints the reason";
            return Err(AnalysisError::request(what.to_owned(), help.to_owned()));
        }
        Ok(())
    }

    /// The place of a metric by name.
    pub(crate) fn metric(&self, name: &str) -> Result<usize, AnalysisError> {
        self.any_score()?;
        self.metrics.iter().position(|metric| metric.name == name).ok_or_else(|| {
            let scored = listed(self.metric_names());
            let has_metric = |family: Family| family.metrics().iter().any(|metric| metric.name == name);
            let help = match (has_metric(Family::Depth), has_metric(Family::Disparity)) {
                (true, _) => format!("add it to `metrics` of a depth score, and run again; scored metrics: {scored}"),
                (_, true) => {
                    format!("it is a metric of disparities, which `score/disparity` computes; scored metrics: {scored}")
                }
                _ => return unknown("metric", name, self.metric_names()),
            };
            AnalysisError::request(format!("`{name}` was not scored"), help)
        })
    }

    pub(crate) fn metric_names(&self) -> impl Iterator<Item = &'static str> + Clone {
        self.metrics.iter().map(|metric| metric.name)
    }

    /// Describes the numbers of rows: pixels, preset, frames.
    pub(crate) fn about(&self, rows: &[Row], selection: &Selection) -> Result<String, AnalysisError> {
        let zone = self.zone(selection)?;
        let parts = || rows.iter().flat_map(Row::parts);
        let mut sets: Vec<PixelSet> = parts().map(|row| row.set).collect();
        sets.sort_unstable();
        sets.dedup();
        let descriptions: Vec<&str> = sets.into_iter().map(pixels_in_words).collect();
        let pixels = match (descriptions.join(" or "), zone) {
            _ if selection.common => "the pixels with ground truth that are valid in all rows".to_owned(),
            (pixels, "") => pixels,
            (pixels, zone) => format!("{pixels} of zone {zone}"),
        };
        let mut presets: Vec<String> = Vec::new();
        for preset in parts().map(|row| self.estimate(row).preset.clone()) {
            if !presets.contains(&preset) {
                presets.push(preset);
            }
        }
        let most = parts().map(|row| row.frames).max().unwrap_or(0);
        let least = parts().map(|row| row.frames).min().unwrap_or(0);
        let mean = averaged(least..=most, |mean| parts().all(|row| row.mean == mean));
        Ok(format!("{pixels}, {}, {mean}", presets.join(" and ")))
    }

    /// The error for a selection without rows.
    fn nothing_selected(&self, selection: &Selection, zone: &str) -> AnalysisError {
        let set = selection.set.unwrap_or(PixelSet::All);
        let Some(pattern) = &selection.estimates else {
            let place = if zone.is_empty() { String::new() } else { format!(" in zone `{zone}`") };
            return AnalysisError::request(
                format!("no frame has scores of all estimates of its stage on `{set}`{place}"),
                "`depthloom report` lists the frames that failed".to_owned(),
            );
        };
        let names = || estimate_names(self.estimates).into_iter();
        if names().any(|name| pattern_matches(pattern, name)) {
            return AnalysisError::request(
                format!("no estimate that matches `{pattern}` was scored on `{set}`"),
                "choose another `--pixels`".to_owned(),
            );
        }
        unknown("estimate", pattern, names())
    }
}

/// The pixel set of an estimate's scores: the selected one, or every pixel with ground truth if that was scored. A
/// depth is never filled: if `filled` is selected together with depths, depths use their default set.
fn set_of(estimate: &Estimate, selection: &Selection) -> Option<PixelSet> {
    let is_other_kind = selection.set == Some(PixelSet::Filled) && estimate.family == Family::Depth;
    match selection.set {
        Some(set) if !(is_other_kind && selection.with_depths) => estimate.sets.contains(&set).then_some(set),
        _ => [PixelSet::All, PixelSet::Filled, PixelSet::Valid].into_iter().find(|set| estimate.sets.contains(set)),
    }
}

/// The axes of an experiment, and the levels of each estimate. If variants have no factors, they are one axis.
fn axes(plan: &RecordedPlan, estimates: &[Estimate]) -> (Vec<Axis>, Vec<Vec<Option<usize>>>) {
    let mut axes: Vec<Axis> = Vec::new();
    let mut level = |axis: &str, value: &str| {
        let place = axes.iter().position(|known| known.name == axis).unwrap_or_else(|| {
            axes.push(Axis { name: axis.to_owned(), levels: Vec::new(), is_numeric: false });
            axes.len() - 1
        });
        let levels = &mut axes[place].levels;
        let level = levels.iter().position(|known| known == value).unwrap_or_else(|| {
            levels.push(value.to_owned());
            levels.len() - 1
        });
        (place, level)
    };
    let by_variant: Vec<Vec<(usize, usize)>> = VariantId::all(plan.variants.len())
        .map(|variant| match (plan.factors_of(variant), plan.variants[variant].as_str()) {
            ([], "") => Vec::new(),
            ([], name) => vec![level("variant", name)],
            (factors, _) => factors.iter().map(|factor| level(&factor.axis, &factor.value)).collect(),
        })
        .collect();
    // For each axis, the new place of each level once they are sorted.
    let places: Vec<Vec<usize>> = axes.iter_mut().map(|axis| in_order(axis, &plan.labels)).collect();
    let place: HashMap<&str, usize> = plan.variants.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect();
    let levels_of_estimate = |estimate: &Estimate| {
        let mut levels = vec![None; axes.len()];
        let variant = estimate.row_key.variant.as_deref().and_then(|name| place.get(name));
        for &(axis, level) in variant.map_or(&[][..], |&variant| &by_variant[variant]) {
            levels[axis] = Some(places[axis][level]);
        }
        levels
    };
    let levels = estimates.iter().map(levels_of_estimate).collect();
    (axes, levels)
}

/// Sorts the levels of an axis, numbers by size, others in the order of their labels. Returns the new place of each
/// level.
fn in_order(axis: &mut Axis, labels: &Labels) -> Vec<usize> {
    let number = |level: &String| level.parse().ok().filter(|number: &f64| number.is_finite());
    let mut order: Vec<usize> = (0..axis.levels.len()).collect();
    if let Some(numbers) = axis.levels.iter().map(number).collect::<Option<Vec<f64>>>() {
        axis.is_numeric = true;
        order.sort_by(|&a, &b| numbers[a].total_cmp(&numbers[b]));
    } else {
        order.sort_by_key(|&level| labels.value_place(&axis.name, &axis.levels[level]));
    }
    let mut places = vec![0; order.len()];
    order.iter().enumerate().for_each(|(place, &level)| places[level] = place);
    axis.levels = order.into_iter().map(|level| std::mem::take(&mut axis.levels[level])).collect();
    places
}

/// Describes the pixels of a pixel set.
pub(crate) const fn pixels_in_words(set: PixelSet) -> &'static str {
    match set {
        PixelSet::All => "all pixels with ground truth",
        PixelSet::Valid => "the pixels with ground truth that are valid in each",
        PixelSet::Filled => "all pixels with ground truth, invalid ones filled as the devkit does",
    }
}

/// The unweighted mean; `None` without values.
pub(crate) fn average(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.fold((0_u64, 0.0), |(count, sum), value| (count + 1, sum + value));
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests;
