//! Scores and samples out of a recording.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZero;
use std::sync::Mutex;
use std::thread;

use depthloom_graphs::Value;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::{FrameReader, RecordedPlan, Recording};
use depthloom_scores::{ScoreRow, ScoredPixels};
use depthloom_threads::{Budget, Tiles as _, into_unlocked, locked};

use crate::distance::{DistanceBin, FARTHEST_M, FrameSamples, Samples, bin_columns};
use crate::error::{AnalysisError, caught};
use crate::estimators::{Compared, Estimator};
use crate::files::Output;
use crate::scores::{FrameScore, order_frame};
use crate::tables::{RowKey, RowKeys, Rows, Table, key_columns};

/// All scores that were recorded: stage run by stage run, frame by frame, in the order of `scores.csv`.
pub(crate) fn scores(
    recording: &Recording,
    estimators: &[Estimator],
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<FrameScore>, AnalysisError> {
    let mut scores = Vec::new();
    for run in RunId::all(recording.plan().runs.len()) {
        let scored = |(index, estimator): (usize, &Estimator)| {
            (estimator.run == run).then(|| estimator.score_topic.clone().map(|topic| (index, topic))).flatten()
        };
        let (indices, topics): (Vec<usize>, Vec<String>) = estimators.iter().enumerate().filter_map(scored).unzip();
        if indices.is_empty() {
            continue;
        }
        let mut reader = recording.reader(run, &topics)?;
        for (position, frame) in FrameIndex::enumerate(recording.frames(run)) {
            if stop() {
                return Err(AnalysisError::Stopped);
            }
            let first = scores.len();
            for (&estimator, value) in indices.iter().zip(reader.read(position)?) {
                if let Some(Value::Scores(rows)) = value {
                    let score =
                        |row: &ScoreRow| FrameScore { frame: frame.id.clone(), position, estimator, row: row.clone() };
                    scores.extend(rows.iter().map(score));
                }
            }
            order_frame(&mut scores[first..]);
        }
    }
    Ok(scores)
}

/// Error against distance, and how many true distances lie in each metre.
pub(crate) struct Distances {
    /// Estimator by estimator, nearest bin first.
    pub(crate) bins: Vec<DistanceBin>,
    /// By estimator: how many samples were left out, since they lie beyond [`FARTHEST_M`].
    pub(crate) beyond: Vec<u64>,
    /// Scored true pixels by stage run and metre, over the frames whose values were recorded; each truth counted once.
    pub(crate) truth: BTreeMap<(RunId, u32), u64>,
}

/// Takes the samples of all recorded maps, on all cores; of the estimators whose maps were not recorded there are none.
///
/// At most `samples_in_memory` samples are held at a time, and the maps of one frame a core; what does not fit lies on the disk
/// of the output's folder meanwhile.
///
/// Of what was taken while the recording was made the maps are not read.
pub(crate) fn distances(
    recording: &Recording,
    estimators: &[Estimator],
    samples_in_memory: usize,
    output: Output<'_>,
    taken: Option<Taken<'_>>,
) -> Result<Distances, AnalysisError> {
    let taken = taken.unwrap_or_else(|| Taken::none_yet(Samples::new(estimators.len(), samples_in_memory, output)));
    read_distances(recording, estimators, |_| true, output, taken)
}

/// As [`distances`], of those estimators for whose index `is_wanted` holds: the pixels that these answered are the shared ones.
pub(crate) fn distances_of_some(
    recording: &Recording,
    estimators: &[Estimator],
    is_wanted: impl Fn(usize) -> bool,
    samples_in_memory: usize,
    output: Output<'_>,
) -> Result<Distances, AnalysisError> {
    let samples = Samples::new(estimators.len(), samples_in_memory, output);
    read_distances(recording, estimators, is_wanted, output, Taken::none_yet(samples))
}

fn read_distances(
    recording: &Recording,
    estimators: &[Estimator],
    is_wanted: impl Fn(usize) -> bool,
    output: Output<'_>,
    Taken { samples, mut truth, frames }: Taken<'_>,
) -> Result<Distances, AnalysisError> {
    let samples = Mutex::new(samples);
    for run in RunId::all(recording.plan().runs.len()) {
        let maps = Maps::of_some(run, estimators, &is_wanted);
        if maps.estimators.is_empty() {
            continue;
        }
        let left = FrameIndex::all(recording.frames(run).len());
        let left: Vec<FrameIndex> = left.filter(|position| !frames.contains(&(run, *position))).collect();
        maps.read_all(recording, estimators, output, &left, &samples, &mut truth)?;
    }
    let samples = into_unlocked(samples);
    Ok(Distances { beyond: samples.beyond().to_vec(), bins: samples.percentiles()?, truth })
}

/// The samples of frames whose maps were at hand.
pub(crate) struct Taken<'a> {
    pub(crate) samples: Samples<'a>,
    /// True pixels by stage run and metre.
    pub(crate) truth: BTreeMap<(RunId, u32), u64>,
    /// Which frames: stage run and position.
    pub(crate) frames: BTreeSet<(RunId, FrameIndex)>,
}

impl<'a> Taken<'a> {
    /// Of no frame yet.
    pub(crate) fn none_yet(samples: Samples<'a>) -> Self {
        Self { samples, truth: BTreeMap::new(), frames: BTreeSet::new() }
    }
}

/// What one thread works with.
struct Worker<'a> {
    reader: FrameReader<'a>,
    /// True pixels by stage run and metre, of the frames it has read.
    truth: BTreeMap<(RunId, u32), u64>,
}

/// The maps of a stage run that are compared: its topics, and where among them each estimator's are.
pub(crate) struct Maps {
    run: RunId,
    pub(crate) topics: Vec<String>,
    /// Estimator, place of its truth, place of its estimate.
    estimators: Vec<(usize, usize, usize)>,
}

impl Maps {
    /// The maps of all its estimators.
    pub(crate) fn new(run: RunId, estimators: &[Estimator]) -> Self {
        Self::of_some(run, estimators, |_| true)
    }

    /// The maps of those estimators for whose index `is_wanted` holds.
    fn of_some(run: RunId, estimators: &[Estimator], is_wanted: impl Fn(usize) -> bool) -> Self {
        let mut maps = Self { run, topics: Vec::new(), estimators: Vec::new() };
        let of_run = estimators.iter().enumerate().filter(|(index, of)| of.run == run && is_wanted(*index));
        for (index, estimator) in of_run {
            if let Some(Compared { truth_topic, estimate_topic, .. }) = estimator.compared() {
                let places = (index, maps.place(truth_topic), maps.place(estimate_topic));
                maps.estimators.push(places);
            }
        }
        maps
    }

    fn place(&mut self, topic: &str) -> usize {
        self.topics.iter().position(|known| known == topic).unwrap_or_else(|| {
            self.topics.push(topic.to_owned());
            self.topics.len() - 1
        })
    }

    /// Every core reads the next frame nobody has read; the order in which samples come in changes no percentile.
    fn read_all(
        &self,
        recording: &Recording,
        estimators: &[Estimator],
        output: Output<'_>,
        positions: &[FrameIndex],
        samples: &Mutex<Samples<'_>>,
        truth: &mut BTreeMap<(RunId, u32), u64>,
    ) -> Result<(), AnalysisError> {
        // Workers that read no frame at the moment.
        let idle: Mutex<Vec<Worker<'_>>> = Mutex::new(Vec::new());
        let read = |position| -> Result<(), AnalysisError> {
            output.go_on()?;
            let worker = locked(&idle).pop();
            let mut worker = match worker {
                Some(worker) => worker,
                None => Worker { reader: recording.reader(self.run, &self.topics)?, truth: BTreeMap::new() },
            };
            let frame = self.samples(estimators, &worker.reader.read(position)?, &mut worker.truth)?;
            locked(samples).take(frame)?;
            locked(&idle).push(worker);
            Ok(())
        };
        // Of several frames that fail the first is told; what comes behind it is of no use then.
        let failed: Mutex<Option<(FrameIndex, AnalysisError)>> = Mutex::new(None);
        let goes_before =
            |failed: &Option<(FrameIndex, _)>, position| failed.as_ref().is_none_or(|(at, _)| position < *at);
        let budget = Budget::new(thread::available_parallelism().map_or(1, NonZero::get));
        let _own = budget.permit();
        budget.run(positions.len(), &|tile| {
            let position = positions[tile];
            if !goes_before(&locked(&failed), position) {
                return;
            }
            if let Err(error) = caught(|| read(position)) {
                let mut failed = locked(&failed);
                if goes_before(&failed, position) {
                    *failed = Some((position, error));
                }
            }
        });
        if let Some((_, error)) = into_unlocked(failed) {
            return Err(error);
        }
        for worker in into_unlocked(idle) {
            for (metre, count) in worker.truth {
                *truth.entry(metre).or_default() += count;
            }
        }
        Ok(())
    }

    /// The samples of a frame, by the values of its topics; and its true pixels, added to those by stage run and metre.
    pub(crate) fn samples(
        &self,
        estimators: &[Estimator],
        maps: &[Option<Value>],
        counts: &mut BTreeMap<(RunId, u32), u64>,
    ) -> Result<FrameSamples, AnalysisError> {
        let map = |place: usize| maps[place].as_ref().filter(|value| value.metres().is_some());
        let mut samples = FrameSamples::default();
        let mut left: Vec<(usize, usize, usize)> = self.estimators.clone();
        // By truth that estimates with several settings are scored against, the pixels that were counted.
        let mut counted: BTreeMap<usize, Vec<bool>> = BTreeMap::new();
        // Those with one truth and one way to be scored are compared: nearly always all of them.
        while let Some(&(first, truth_place, _)) = left.first() {
            let Some(settings) = &estimators[first].settings else { break };
            let compared: Vec<(usize, Option<&Value>)> = left
                .extract_if(.., |(index, truth, _)| {
                    *truth == truth_place && estimators[*index].settings.as_ref() == Some(settings)
                })
                .map(|(index, _, estimate)| (index, map(estimate)))
                .collect();
            let Some(truth) = map(truth_place).and_then(Value::metres) else { continue };
            // One of another size than its truth was not scored either: the frame failed there, which the run has said.
            let is_of_size = |value: &&Value| value.metres().is_some_and(|map| map.dimensions() == truth.dimensions());
            let compared: Vec<_> =
                compared.into_iter().map(|(index, estimate)| (index, estimate.filter(is_of_size))).collect();
            let (width, height) = truth.dimensions();
            let pixels = ScoredPixels::new(truth, width as usize, height as usize, settings).by_metre(FARTHEST_M);
            if compared.iter().any(|(_, estimate)| estimate.is_some()) {
                let is_with_others = left.iter().any(|(_, truth, _)| *truth == truth_place);
                if is_with_others {
                    counted.entry(truth_place).or_insert_with(|| vec![false; (width * height) as usize]);
                }
                let mut of_truth = counted.get_mut(&truth_place);
                for (metre, range) in pixels.metres().filter(|(metre, _)| *metre < FARTHEST_M) {
                    let new = match &mut of_truth {
                        None => range.len(),
                        Some(counted) => {
                            let places = pixels.positions()[range].iter();
                            places.filter(|place| !std::mem::replace(&mut counted[**place as usize], true)).count()
                        }
                    };
                    if new > 0 {
                        *counts.entry((self.run, metre)).or_default() += new as u64;
                    }
                }
            }
            let errors: Vec<Option<Vec<f32>>> = compared
                .iter()
                .map(|(_, estimate)| Some(pixels.absolute_errors(estimate.and_then(Value::depth_estimate)?, settings)))
                .collect();
            let mut shared = vec![errors.iter().all(Option::is_some); pixels.len()];
            for errors in errors.iter().flatten() {
                shared.iter_mut().zip(errors).for_each(|(shared, error)| *shared &= !error.is_nan());
            }
            for ((index, _), errors) in compared.iter().zip(&errors) {
                if let Some(errors) = errors {
                    samples.add(*index, &pixels, errors, &shared);
                }
            }
        }
        Ok(samples)
    }
}

impl Distances {
    /// By metre, over all stages.
    pub(crate) fn truth_of_all(&self) -> BTreeMap<u32, u64> {
        let mut all = BTreeMap::new();
        self.truth.iter().for_each(|((_, metre), count)| *all.entry(*metre).or_default() += count);
        all
    }

    /// As written to `true_distances.csv`: the stage, its variant where that has a source of its own, `bin_from_m, bin_to_m, count`.
    pub(crate) fn table_of_truth(&self, plan: &RecordedPlan) -> Table {
        let keys = RowKeys::new(plan);
        let key = |run: RunId| keys.of_those(&plan.runs[run].stage, &plan.runs[run].variants);
        let rows: Vec<(RowKey, u64)> = self.truth.iter().map(|((run, _), count)| (key(*run), *count)).collect();
        let mut columns = key_columns(&rows, |(key, _)| key, Vec::new());
        columns.extend(bin_columns(self.truth.keys().map(|(_, metre)| *metre)));
        columns.push(Rows(&rows).count("count", |(_, count)| *count).unit("pixels"));
        Table::new(columns)
    }
}
