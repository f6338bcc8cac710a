//! Table I: the mean over frames of every score, by variant and estimator.

pub(crate) mod latex;
pub(crate) mod markdown;
mod means;
mod row;
mod terminal;

use std::collections::{HashMap, HashSet};

use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_graphs::{Key, counted};
use depthloom_recording::Recording;
use depthloom_scores::{Family, Mean, Metric, PixelSet, ScoreRow, Settings};

use self::means::{Means, means};
pub use self::row::TableRow;
use crate::ablation::listed;
use crate::best::{Candidate, best};
use crate::comparison::Comparison;
use crate::error::AnalysisError;
use crate::estimators::Estimator;
use crate::grid::Typesetting;
use crate::leading::{Lead, sheet};
use crate::paper::paper_scores;
use crate::scores::{FrameScore, metrics_of};
use crate::sheet::{Cells, Sheet, unit_of};
use crate::statistics::{Interval, Resampling, Statistic, Weighted};

/// The mean over frames, a column an estimator and pixel set.
///
/// The mean is the unweighted one of the frames' scores (monodepth, the KITTI devkits), or of all pixels alike where that was asked for, over the frames that have scores of all
/// estimators of their stage run. A frame on which a score has no pixel adds nothing to that score's mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The experiment's name.
    pub experiment: String,
    /// The scores, in the order they are shown.
    pub metrics: Vec<&'static Metric>,
    /// The columns, in the order they are shown.
    pub columns: Vec<TableColumn>,
    /// Whether the paper's numbers stand beside ours.
    pub with_paper: bool,
    /// How frames were resampled for intervals; `None`: there are none.
    pub intervals: Option<Resampling>,
    /// The zone that the scores are of; empty: the whole image.
    pub zone: String,
    /// What tells its LaTeX label from others'.
    pub(crate) label: String,
    /// What LaTeX has as its caption; `None`: what the numbers are.
    pub(crate) caption: Option<String>,
    /// How many decimals of scores are shown; `None`: as many as the paper has.
    pub(crate) decimals: Option<usize>,
}

/// An estimator on a pixel set.
#[derive(Clone, Debug, PartialEq)]
pub struct TableColumn {
    /// The variant, or the estimator itself where all variants share it: what the column stands under.
    pub group: String,
    /// Its name under the group.
    pub name: String,
    /// What the estimator is of.
    pub lead: Lead,
    /// Its name under `estimates:`.
    pub estimator: String,
    /// What people call it.
    pub label: String,
    /// The pixels scored over.
    pub set: PixelSet,
    /// How many frames the mean is over.
    pub frames: u64,
    /// Whether it is the mean of the frames' scores, or over all their pixels.
    pub mean: Mean,
    /// The means, in the order of [`Table::metrics`]; `None` if it was not asked for, or no frame had a pixel to score.
    pub means: Vec<Option<f64>>,
    /// Their intervals, where there are any.
    pub intervals: Vec<Option<Interval>>,
    /// The mean share of true pixels that were answered; `None` if the recording does not say.
    pub density: Option<f64>,
    /// Columns of one number may be compared: over all true pixels, as many of the same frames, held against the same truth,
    /// scored in the same way. `None`: over the pixels this estimator answered, which are its own.
    pub comparable: Option<usize>,
    /// The paper's numbers, where it gives them: of the eight scores that a `score/depth` takes by default.
    pub paper: Option<[f64; 8]>,
}

impl TableColumn {
    /// The paper's number of a score, where it gives one.
    #[must_use]
    pub fn paper_of(&self, metric: &Metric) -> Option<f64> {
        let place = Family::Depth.defaults().iter().position(|of| *of == metric)?;
        self.paper.map(|paper| paper[place])
    }
}

impl Table {
    /// Takes the means of the scores per frame; `source(run, position)` is the key of a frame's source values.
    pub(crate) fn new(
        experiment: &str,
        scores: &[FrameScore],
        estimators: &[Estimator],
        with_paper: bool,
        source: &dyn Fn(RunId, FrameIndex) -> Option<Key>,
    ) -> Self {
        let rows = whole_images(scores, estimators);
        let metrics = metrics_of(estimators);
        let means = means(&rows, &metrics, estimators);
        let mut comparisons: Vec<(PixelSet, Comparison<'_>)> = Vec::new();
        let mut columns = Vec::new();
        for (index, estimator) in estimators.iter().enumerate() {
            let mut sets = estimator.sets.clone();
            // "Non-occ only" stands before "Incl Occ".
            sets.sort_by_key(|set| std::cmp::Reverse(*set));
            let several = sets.len() > 1;
            for set in sets {
                let (group, name) = match (&estimator.lead.variant, several || set != PixelSet::All) {
                    (Some(variant), false) => (variant.clone(), estimator.name.clone()),
                    (Some(variant), true) => (variant.clone(), format!("{} {set}", estimator.name)),
                    (None, _) => (estimator.label.clone(), set.to_string()),
                };
                let Means { frames, density, means } =
                    means.get(&(index, set)).cloned().unwrap_or_else(|| Means::none(metrics.len()));
                let paper = if with_paper { paper_scores(estimator, set) } else { None };
                // Over the pixels that each made valid there is nothing to compare: they are its own.
                let comparable = (set != PixelSet::Answered).then(|| {
                    let own = |score: &&&FrameScore| score.estimator == index && score.row.set == set;
                    let comparison =
                        (set, Comparison::of(estimator, estimator.mean, rows.iter().filter(own).copied(), source));
                    comparisons.iter().position(|known| *known == comparison).unwrap_or_else(|| {
                        comparisons.push(comparison);
                        comparisons.len() - 1
                    })
                });
                columns.push(TableColumn {
                    group,
                    name,
                    lead: estimator.lead.clone(),
                    estimator: estimator.name.clone(),
                    label: estimator.label.clone(),
                    set,
                    frames,
                    mean: estimator.mean,
                    intervals: vec![None; means.len()],
                    means,
                    density,
                    comparable,
                    paper,
                });
            }
        }
        Self {
            experiment: experiment.to_owned(),
            metrics,
            columns,
            with_paper,
            intervals: None,
            zone: String::new(),
            label: experiment.to_owned(),
            caption: None,
            decimals: None,
        }
    }

    /// The table of these scores and estimators with an interval beside each number.
    ///
    /// # Errors
    /// [`AnalysisError::Stopped`] once `stop` says so.
    pub(crate) fn with_intervals(
        mut self,
        scores: &[FrameScore],
        estimators: &[Estimator],
        resampling: Resampling,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self, AnalysisError> {
        let rows = whole_images(scores, estimators);
        let mut frames: HashMap<(&str, PixelSet), Vec<&ScoreRow>> = HashMap::new();
        for score in rows {
            frames.entry((&estimators[score.estimator].label, score.row.set)).or_default().push(&score.row);
        }
        let settings: HashMap<&str, Settings> =
            estimators.iter().map(|of| (of.label.as_str(), of.settings.unwrap_or_default())).collect();
        let mut numbers: Vec<(usize, Box<Statistic<'_>>)> = Vec::new();
        for column in &self.columns {
            let rows = frames.get(&(column.label.as_str(), column.set)).map_or(&[][..], Vec::as_slice);
            for metric in &self.metrics {
                let settings = &settings[column.label.as_str()];
                let of = Weighted::of_those_that_have_it(metric, column.mean, settings, rows.iter().copied());
                numbers.push(match of {
                    Some((frames, weighted)) => (frames, Box::new(move |times: &[f64]| weighted.value(times))),
                    None => (0, Box::new(|_: &[f64]| f64::NAN)),
                });
            }
        }
        let mut found = resampling.intervals_of(&numbers, stop)?.into_iter();
        for column in &mut self.columns {
            column.intervals = found.by_ref().take(self.metrics.len()).collect();
        }
        Ok(Self { intervals: Some(resampling), ..self })
    }

    /// Takes a caption, label and decimals that were asked for.
    pub(crate) fn typeset(&mut self, typesetting: &Typesetting) {
        self.caption.clone_from(&typesetting.caption);
        self.decimals = typesetting.decimals;
        if let Some(label) = &typesetting.label {
            self.label.clone_from(label);
        }
    }

    pub(crate) fn terminal(&self, width: usize) -> String {
        terminal::render(self, width)
    }

    pub(crate) fn markdown(&self) -> String {
        markdown::render(self)
    }

    pub(crate) fn latex(&self) -> String {
        latex::render(self)
    }

    /// The long form, a row an estimator and pixel set: what it is of, the scores, `frames`, the paper's as `paper_a1 ...` where asked for,
    /// `density`.
    pub(crate) fn long_form(&self) -> Sheet<'_> {
        let rows = &self.columns;
        let leads: Vec<&Lead> = rows.iter().map(|row| &row.lead).collect();
        let what = [
            ("estimator", Cells::Text(rows.iter().map(|row| row.estimator.as_str()).collect())),
            ("set", Cells::Text(rows.iter().map(|row| row.set.name()).collect())),
        ];
        let mut table = sheet(&leads, what);
        for (i, metric) in self.metrics.iter().enumerate() {
            table = table.with_score(metric, Cells::Number(rows.iter().map(|row| row.means[i]).collect()));
            if self.intervals.is_some() {
                let low = rows.iter().map(|row| row.intervals[i].map(|of| of.low)).collect();
                let high = rows.iter().map(|row| row.intervals[i].map(|of| of.high)).collect();
                let (name, unit) = (metric.name, unit_of(metric));
                table = table.with_unit(format!("{name}_low"), unit, Cells::Number(low));
                table = table.with_unit(format!("{name}_high"), unit, Cells::Number(high));
            }
        }
        table = table.with_unit("frames", "frames", Cells::Count(rows.iter().map(|row| row.frames).collect()));
        let in_the_paper = Family::Depth.defaults();
        for metric in self.metrics.iter().filter(|metric| self.with_paper && in_the_paper.contains(metric)) {
            let paper = Cells::Number(rows.iter().map(|row| row.paper_of(metric)).collect());
            table = table.with_unit(format!("paper_{}", metric.name), unit_of(metric), paper);
        }
        table.with_share("density", rows.iter().map(|row| row.density).collect())
    }

    /// Whether a column is the best of a row among two or more that are comparable, by the [one rule](crate::best).
    pub(crate) fn is_best(&self, line: usize, column: usize) -> bool {
        let a3 = self.metrics.iter().position(|metric| metric.name == "a3");
        // A score of valid pixels alone is of other pixels in every column where some are missing.
        let of_valid = self.metrics[line].pooling == depthloom_scores::Pooling::MeanOfAnswers;
        let candidate = |column: &TableColumn| {
            let is_whole = !of_valid || column.set == PixelSet::Filled || column.density == Some(1.0);
            Candidate {
                class: column.comparable.filter(|_| is_whole),
                value: column.means[line],
                a3: a3.and_then(|a3| column.means[a3]),
                density: column.density,
            }
        };
        let candidates: Vec<Candidate> = self.columns.iter().map(candidate).collect();
        best(&candidates, self.metrics[line].more_is_better)[column]
    }

    /// What the marked cells are; `None` if there are none.
    pub(crate) fn best_of(&self) -> Option<&'static str> {
        let mut marked =
            (0..self.metrics.len()).flat_map(|line| (0..self.columns.len()).map(move |column| (line, column)));
        marked.find(|(line, column)| self.is_best(*line, *column))?;
        let numbers: HashSet<usize> = self.columns.iter().filter_map(|column| column.comparable).collect();
        Some(if numbers.len() == 1 { "best over all true pixels" } else { "best of those over the same true pixels" })
    }

    /// The text of a cell: our number, and what stands beside it: its interval, and the paper's number.
    pub(crate) fn cell(&self, line: usize, column: usize) -> (String, Option<String>) {
        let (column, metric) = (&self.columns[column], self.metrics[line]);
        let decimals = self.decimals.unwrap_or(metric.decimals);
        let ours = column.means[line].map_or_else(|| "-".to_owned(), |mean| format!("{mean:.decimals$}"));
        let text = |of: Interval| format!("[{:.decimals$}, {:.decimals$}]", of.low, of.high);
        let interval = column.intervals[line].map(text);
        let beside: Vec<String> =
            interval.into_iter().chain(column.paper_of(metric).map(|paper| format!("({paper:.2})"))).collect();
        (ours, (!beside.is_empty()).then(|| beside.join(" ")))
    }

    /// The columns in groups, as ranges: neighbours under one heading.
    pub(crate) fn groups(&self) -> Vec<std::ops::Range<usize>> {
        let mut groups: Vec<std::ops::Range<usize>> = Vec::new();
        for (i, column) in self.columns.iter().enumerate() {
            match groups.last_mut().filter(|group| self.columns[group.start].group == column.group) {
                Some(group) => group.end = i + 1,
                None => groups.push(i..i + 1),
            }
        }
        groups
    }

    /// What the numbers are, in one line.
    pub(crate) fn about(&self) -> String {
        if self.zone.is_empty() { self.means() } else { format!("zone {}: {}", self.zone, self.means()) }
    }

    fn means(&self) -> String {
        let counts: HashSet<u64> = self.columns.iter().map(|column| column.frames).collect();
        let most = counts.iter().max().copied().unwrap_or(0);
        let frames = counted(most, "frame");
        let pooled: Vec<&TableColumn> = self.columns.iter().filter(|column| column.mean == Mean::Pixels).collect();
        let frames = match pooled.len() {
            0 => format!("mean over {frames}"),
            all if all == self.columns.len() => format!("over all pixels of {frames}"),
            _ => {
                let mut named: Vec<&str> = pooled.iter().map(|column| column.label.as_str()).collect();
                named.dedup();
                format!("mean over {frames}, over all their pixels alike for {}", named.join(", "))
            }
        };
        let frames = match &self.intervals {
            Some(resampling) => format!("{frames}, in square brackets its interval ({})", resampling.about()),
            None => frames,
        };
        if counts.len() <= 1 {
            return frames;
        }
        let fewer = self.columns.iter().filter(|column| column.frames < most);
        let fewer: Vec<String> =
            fewer.map(|column| format!("{} on {}: {}", column.label, column.set, column.frames)).collect();
        format!("{frames} ({})", fewer.join(", "))
    }
}

/// The scores over the whole image of the frames that have rows of all estimators of their stage run.
fn whole_images<'a>(scores: &'a [FrameScore], estimators: &[Estimator]) -> Vec<&'a FrameScore> {
    common(scores, estimators).into_iter().filter(|score| score.row.zone.is_empty()).collect()
}

/// The scores, of zones too, of the frames that have rows of all estimators of their stage run.
pub(crate) fn common<'a>(scores: &'a [FrameScore], estimators: &[Estimator]) -> Vec<&'a FrameScore> {
    let place = |score: &FrameScore| (estimators[score.estimator].run, score.position);
    let mut rows_of_frame: HashMap<(RunId, FrameIndex), usize> = HashMap::new();
    for score in scores.iter().filter(|score| score.row.zone.is_empty()) {
        *rows_of_frame.entry(place(score)).or_default() += 1;
    }
    let mut rows_of_run: HashMap<RunId, usize> = HashMap::new();
    for estimator in estimators {
        *rows_of_run.entry(estimator.run).or_default() += estimator.sets.len();
    }
    let is_whole = |score: &&FrameScore| rows_of_frame.get(&place(score)) == rows_of_run.get(&place(score).0);
    scores.iter().filter(is_whole).collect()
}

/// What is to be said of frames that not all means are over, although nothing failed on them: an estimate is missing there.
pub(crate) fn incomplete_frames(recording: &Recording, estimators: &[Estimator], scores: &[FrameScore]) -> Vec<String> {
    let mut scored: HashMap<(RunId, FrameIndex), HashSet<usize>> = HashMap::new();
    for score in scores {
        scored.entry((estimators[score.estimator].run, score.position)).or_default().insert(score.estimator);
    }
    let mut notes = Vec::new();
    for (run, planned) in RunId::enumerate(&recording.plan().runs) {
        let own: Vec<usize> = (0..estimators.len()).filter(|place| estimators[*place].run == run).collect();
        let (mut frames, mut unscored, mut labels) = (0, 0, Vec::new());
        for (position, frame) in FrameIndex::enumerate(recording.frames(run)) {
            if !frame.failures.is_empty() {
                continue;
            }
            let Some(there) = scored.get(&(run, position)) else {
                unscored += 1;
                continue;
            };
            let missing: Vec<&str> = own
                .iter()
                .filter(|place| !there.contains(place))
                .map(|place| estimators[*place].label.as_str())
                .collect();
            frames += usize::from(!missing.is_empty());
            for label in missing {
                if !labels.contains(&label) {
                    labels.push(label);
                }
            }
        }
        let all = recording.frames(run).len();
        if !own.is_empty() && 0 < unscored && unscored < all {
            notes.push(format!(
                "stage `{}`: means leave out {unscored} of {all} frames, which have no truth or no value of any estimate",
                planned.name()
            ));
        }
        if frames > 0 {
            notes.push(format!(
                "stage `{}`: means leave out {frames} of {all} frames, on which there is no value of {}",
                planned.name(),
                listed(labels)
            ));
        }
    }
    notes
}

#[cfg(test)]
mod tests;
