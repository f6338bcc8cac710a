//! Variants side by side: a row an estimate, its factors in columns, so that many can be sorted, ranked and asked what
//! did it.

mod adjusted;
mod answer;
mod best;
mod best_value;
mod comparability;
mod cost;
mod effects;
mod factor;
mod front;
mod joined;
mod leaderboard;
mod measure;
mod ranking;
mod score_table;
mod shared;
mod variance;
mod zones;

use std::collections::HashMap;

use depthloom_graphs::Key;
use depthloom_graphs::contracts::FrameSelection;
use depthloom_graphs::plan::{FrameIndex, RunId, VariantId};
use depthloom_recording::RecordedPlan;
use depthloom_scores::{Family, Mean, Metric, PixelSet, ScoreRow};

pub(crate) use adjusted::{LevelMeans, level_means};
pub use answer::{Question, answer};
pub(crate) use answer::{of_frames, scored, source_of};
pub use best_value::{BestValue, best_value};
use comparability::Classes;
pub use cost::Costs;
pub(crate) use effects::table as effects_table;
pub(crate) use factor::Factor;
pub(crate) use joined::of_label;
pub use leaderboard::{BoardRun, leaderboard};
pub use ranking::Ranking;
pub use score_table::TableRow;
pub(crate) use score_table::{ScoreTable, paper_number};
pub(crate) use shared::shared_scores;
pub(crate) use zones::table as zones_table;

use crate::error::{AnalysisError, listed, unknown};
use crate::estimates::{Estimate, each_names_one, is_of, is_pattern_of, names_of};
use crate::scores::{FrameScore, averaged};
use crate::statistics::{Statistic, Weighted};
use crate::tables::COMMON;

/// What of a recording's scores a table is of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Whether scores are taken again from recorded maps, of those pixels with ground truth alone that all selected
    /// estimates valid.
    pub common: bool,
    /// The pixel set; `None`: of each estimate every pixel with ground truth, or where it was not scored on those, what
    /// it was scored on.
    pub set: Option<PixelSet>,
    /// Whether depths are there besides where disparities alone have the pixel set.
    pub with_depths: bool,
    /// The zone; `None`: the whole image.
    pub zone: Option<String>,
    /// The frames; `None`: all.
    pub frames: Option<FrameSelection>,
    /// What a data set's value is taken over; `None`: what the experiment says.
    pub mean: Option<Mean>,
    /// A pattern of estimates' labels or names, in which `*` stands for any run of characters, or several with commas
    /// between; `None`: all.
    pub estimates: Option<String>,
}

impl Selection {
    /// The pixel set of a row in tables.
    pub(crate) fn set_name(&self, row: &Row) -> String {
        let mut sets: Vec<&str> = row.parts().map(|part| part.set.name()).collect();
        sets.dedup();
        if self.common { COMMON.to_owned() } else { sets.join("+") }
    }

    /// What tells tables of it from others, for a LaTeX label.
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

/// An axis of the experiment, and its levels: numbers by size, others in the file's order.
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
    /// By estimate, by axis: the level; `None` where it has none.
    levels: Vec<Vec<Option<usize>>>,
    /// The scores that were taken anywhere, in the catalogue's order.
    pub(crate) metrics: Vec<&'static Metric>,
    scores: HashMap<(usize, PixelSet, &'a str), Vec<&'a FrameScore>>,
    /// The zones, in the order of the recording, the whole image first.
    zones: Vec<&'a str>,
    core_ms: Vec<Option<f64>>,
    has_timings: bool,
    /// By estimate: the topic of the disparity that it is, or that it was computed from.
    disparities: Vec<Option<&'a str>>,
    source: &'a dyn Fn(RunId, FrameIndex) -> Option<Key>,
}

/// An estimate's scores on the selected pixels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Row {
    pub(crate) estimate: usize,
    /// The pixels that it is over.
    pub(crate) set: PixelSet,
    /// How many frames had a pixel to score.
    pub(crate) frames: u64,
    /// How many pixels counted in all.
    pub(crate) pixels: u64,
    /// The share of pixels with ground truth that are valid, as the scores are taken: mean over frames or over pixels.
    pub(crate) density: Option<f64>,
    /// By metric of the ablation.
    pub(crate) values: Vec<Option<f64>>,
    pub(crate) core_ms: Option<f64>,
    /// Rows of one number may be compared: they are over the same pixels of the same frames, scored in the same way.
    /// But for scores that are [`over answers alone`](Self::over_answers).
    pub(crate) comparable: Option<usize>,
    /// By metric of the ablation: whether it leaves out invalid pixels of the row.
    pub(crate) over_answers: Vec<bool>,
    /// What its values are taken over.
    pub(crate) mean: Mean,
    /// Of a depth: the scores of the disparity that it was computed from, where they stand in one row.
    pub(crate) joined: Option<Box<Row>>,
}

impl Row {
    /// The row, and the one that is joined to it.
    pub(crate) fn parts(&self) -> impl Iterator<Item = &Self> {
        std::iter::once(self).chain(self.joined.as_deref())
    }

    /// That of the two which has a value of a metric.
    pub(crate) fn of(&self, metric: usize) -> &Self {
        self.joined.as_deref().filter(|joined| joined.values[metric].is_some()).unwrap_or(self)
    }

    pub(crate) fn value(&self, metric: usize) -> Option<f64> {
        self.of(metric).values[metric]
    }

    /// Rows of one number may be compared by this metric.
    pub(crate) fn comparable_by(&self, metric: usize) -> Option<usize> {
        let part = self.of(metric);
        part.comparable.filter(|_| !part.over_answers[metric])
    }
}

impl<'a> Ablation<'a> {
    /// What was scored on the frames that all estimates of their stage have; `source(run, position)` is the key of a
    /// frame's source values.
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
        for score in crate::scores::of_complete_frames(scores, estimates) {
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
            metrics,
            scores: by_row,
            zones,
            core_ms: costs.map_or_else(|| vec![None; estimates.len()], |costs| costs.core_ms(plan, estimates)),
            has_timings: costs.is_some(),
            disparities: joined::disparities(plan, estimates),
            source,
        }
    }

    /// The selected rows, in the order of estimates.
    ///
    /// # Errors
    /// If nothing is selected: what was asked for, and what there is.
    pub(crate) fn rows(&self, selection: &Selection) -> Result<Vec<Row>, AnalysisError> {
        self.any_score()?;
        if let Some(patterns) = &selection.estimates {
            each_names_one(patterns, self.estimates)?;
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

    /// The selected rows, one on each pixel set, "valid" before "all"; also those without a score.
    pub(crate) fn rows_on_all_sets(&self, selection: &Selection) -> Result<Vec<Row>, AnalysisError> {
        let zone = self.zone(selection)?;
        Ok(self.rows_on_sets(selection, zone, |estimate| {
            let is_wanted = |set: &PixelSet| selection.set.is_none_or(|wanted| wanted == *set);
            let mut sets: Vec<PixelSet> = estimate.sets.iter().copied().filter(is_wanted).collect();
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
            if selection.estimates.as_deref().is_some_and(|pattern| !is_of(estimate, pattern)) {
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
            over_answers: self.metrics.iter().map(|metric| rows().any(|row| metric.pixels(row) < row.pixels)).collect(),
            core_ms: self.core_ms[index],
            comparable,
            mean,
            joined: None,
        }
    }

    /// A metric of a row as a function of how often each frame counts, with the number of frames that have it; of no
    /// metric, NaN.
    fn statistic(&self, row: &Row, metric: Option<usize>, zone: &'a str) -> (usize, Box<Statistic<'_>>) {
        let settings = self.estimate(row).settings.unwrap_or_default();
        let frames = self.frames(row.estimate, row.set, zone).iter().map(|score| &score.row);
        let weighted = metric
            .and_then(|metric| Weighted::of_those_that_have_it(self.metrics[metric], row.mean, &settings, frames));
        match weighted {
            Some((frames, weighted)) => (frames, Box::new(move |times: &[f64]| weighted.value(times))),
            None => (0, Box::new(|_: &[f64]| f64::NAN)),
        }
    }

    pub(crate) fn estimate(&self, row: &Row) -> &Estimate {
        &self.estimates[row.estimate]
    }

    /// What a row's estimates are called under `estimates:`.
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

    /// The frames' scores of a row.
    pub(crate) fn frames(&self, estimate: usize, set: PixelSet, zone: &'a str) -> &[&'a FrameScore] {
        self.scores.get(&(estimate, set, zone)).map_or(&[], Vec::as_slice)
    }

    /// The zones that were scored, the whole image first, as an empty name.
    pub(crate) fn zones(&self) -> &[&'a str] {
        &self.zones
    }

    /// The zone that is asked for.
    pub(crate) fn zone(&self, selection: &Selection) -> Result<&'a str, AnalysisError> {
        let Some(wanted) = &selection.zone else { return Ok("") };
        let known = &self.zones[1..];
        known.iter().find(|zone| **zone == wanted).copied().ok_or_else(|| {
            if known.is_empty() {
                return AnalysisError::asked(
                    format!("there is no zone `{wanted}`: this recording has scores of the whole image alone"),
                    "declare `zones` where the experiment scores, and run it again".to_owned(),
                );
            }
            unknown("zone", wanted, known.iter().copied())
        })
    }

    /// That something was scored on the pixel set that is asked for.
    pub(crate) fn check_set(&self, selection: &Selection) -> Result<(), AnalysisError> {
        let mut scored: Vec<PixelSet> = self.estimates.iter().flat_map(|estimate| estimate.sets.clone()).collect();
        scored.sort_unstable();
        scored.dedup();
        match selection.set {
            None => Ok(()),
            Some(set) if scored.contains(&set) => Ok(()),
            Some(set) => {
                let scored: Vec<String> = scored.iter().map(|set| format!("`{set}`")).collect();
                Err(AnalysisError::asked(
                    format!("nothing was scored on `{set}`"),
                    format!("what was scored is {}: name `{set}` in `sets` and run again", scored.join(" and ")),
                ))
            }
        }
    }

    /// That there is a score at all: a frame without one pixel to score has none.
    fn any_score(&self) -> Result<(), AnalysisError> {
        if self.metrics.is_empty() {
            let help = "`depthloom report` says why";
            return Err(AnalysisError::asked("not one pixel was scored".to_owned(), help.to_owned()));
        }
        Ok(())
    }

    /// The place of a metric by name.
    pub(crate) fn metric(&self, name: &str) -> Result<usize, AnalysisError> {
        self.any_score()?;
        self.metrics.iter().position(|metric| metric.name == name).ok_or_else(|| {
            let scored = listed(self.metric_names());
            let is_of = |family: Family| family.metrics().iter().any(|metric| metric.name == name);
            let help = match (is_of(Family::Depth), is_of(Family::Disparity)) {
                (true, _) => format!("name it in `metrics` of a score of depths, and run again; scored were {scored}"),
                (_, true) => format!("it is a score of disparities: `score/disparity` takes it; scored were {scored}"),
                _ => return unknown("score", name, self.metric_names()),
            };
            AnalysisError::asked(format!("`{name}` was not scored"), help)
        })
    }

    pub(crate) fn metric_names(&self) -> impl Iterator<Item = &'static str> + Clone {
        self.metrics.iter().map(|metric| metric.name)
    }

    /// What the numbers of rows are: pixels, preset, frames.
    pub(crate) fn about(&self, rows: &[Row], selection: &Selection) -> Result<String, AnalysisError> {
        let zone = self.zone(selection)?;
        let parts = || rows.iter().flat_map(Row::parts);
        let mut sets: Vec<PixelSet> = parts().map(|row| row.set).collect();
        sets.sort_unstable();
        sets.dedup();
        let of_sets: Vec<&str> = sets.into_iter().map(pixels_of).collect();
        let pixels = match (of_sets.join(" or "), zone) {
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

    /// Why no row was selected.
    fn nothing_selected(&self, selection: &Selection, zone: &str) -> AnalysisError {
        let set = selection.set.unwrap_or(PixelSet::All);
        let Some(pattern) = &selection.estimates else {
            let place = if zone.is_empty() { String::new() } else { format!(" in zone `{zone}`") };
            return AnalysisError::asked(
                format!("no frame has a score on `{set}`{place} of all estimates of its stage"),
                "`depthloom report` says which frames failed".to_owned(),
            );
        };
        let names = || names_of(self.estimates).into_iter();
        if names().any(|name| is_pattern_of(pattern, name)) {
            return AnalysisError::asked(
                format!("no estimate that `{pattern}` names was scored on `{set}`"),
                "choose another --set".to_owned(),
            );
        }
        unknown("estimate", pattern, names())
    }
}

/// The pixels that an estimate's scores are taken over: those that are asked for, or every pixel with ground truth
/// where that was scored. A depth is never filled: where that is asked for, and depths too, theirs are as if nothing
/// was.
fn set_of(estimate: &Estimate, selection: &Selection) -> Option<PixelSet> {
    let is_other_kind = selection.set == Some(PixelSet::Filled) && estimate.family == Family::Depth;
    match selection.set {
        Some(set) if !(is_other_kind && selection.with_depths) => estimate.sets.contains(&set).then_some(set),
        _ => [PixelSet::All, PixelSet::Filled, PixelSet::Valid].into_iter().find(|set| estimate.sets.contains(set)),
    }
}

/// The axes of an experiment, and by estimate its levels. Where variants have no factors, they are one axis
/// themselves.
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
    // By axis: the place of each level once numbers stand by size.
    let places: Vec<Vec<usize>> = axes.iter_mut().map(in_order).collect();
    let place: HashMap<&str, usize> = plan.variants.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect();
    let of = |estimate: &Estimate| {
        let mut levels = vec![None; axes.len()];
        let variant = estimate.lead.variant.as_deref().and_then(|name| place.get(name));
        for &(axis, level) in variant.map_or(&[][..], |&variant| &by_variant[variant]) {
            levels[axis] = Some(places[axis][level]);
        }
        levels
    };
    let levels = estimates.iter().map(of).collect();
    (axes, levels)
}

/// Puts the levels of an axis of numbers in order; gives the new place of each.
fn in_order(axis: &mut Axis) -> Vec<usize> {
    let number = |level: &String| level.parse().ok().filter(|number: &f64| number.is_finite());
    let Some(numbers) = axis.levels.iter().map(number).collect::<Option<Vec<f64>>>() else {
        return (0..axis.levels.len()).collect();
    };
    axis.is_numeric = true;
    let mut order: Vec<usize> = (0..numbers.len()).collect();
    order.sort_by(|&a, &b| numbers[a].total_cmp(&numbers[b]));
    let mut places = vec![0; order.len()];
    order.iter().enumerate().for_each(|(place, &level)| places[level] = place);
    axis.levels = order.into_iter().map(|level| std::mem::take(&mut axis.levels[level])).collect();
    places
}

/// The pixels of a set, in words.
pub(crate) const fn pixels_of(set: PixelSet) -> &'static str {
    match set {
        PixelSet::All => "all pixels with ground truth",
        PixelSet::Valid => "the pixels with ground truth that are valid in each",
        PixelSet::Filled => "all pixels with ground truth, invalid ones filled as the devkit does",
    }
}

/// The unweighted mean; `None` of nothing.
pub(crate) fn average(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.fold((0_u64, 0.0), |(count, sum), value| (count + 1, sum + value));
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests;
