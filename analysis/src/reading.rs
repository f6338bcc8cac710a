//! Scores and samples out of a recording.

use std::collections::BTreeMap;
use std::num::NonZero;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;

use depthloom_graphs::Value;
use depthloom_graphs::values::Depth;
use depthloom_recording::Recording;
use depthloom_scores::ScoredPixels;
use polars::frame::DataFrame;
use polars::prelude::{Column, NamedFrom, Series};

use crate::distance::{DistanceBin, FrameSamples, Samples};
use crate::error::AnalysisError;
use crate::estimators::Estimator;
use crate::scores::{FrameScore, order_frame};

/// All scores that were recorded: stage run by stage run, frame by frame, in the order of `scores.csv`.
pub(crate) fn scores(recording: &Recording, estimators: &[Estimator]) -> Result<Vec<FrameScore>, AnalysisError> {
    let mut scores = Vec::new();
    for run in 0..recording.plan().runs.len() {
        let scored = |(index, estimator): (usize, &Estimator)| {
            (estimator.run == run).then(|| estimator.score_topic.clone().map(|topic| (index, topic))).flatten()
        };
        let (indices, topics): (Vec<usize>, Vec<String>) = estimators.iter().enumerate().filter_map(scored).unzip();
        if indices.is_empty() {
            continue;
        }
        let mut reader = recording.reader(run, &topics)?;
        for (position, frame) in recording.frames(run).iter().enumerate() {
            let first = scores.len();
            for (&estimator, value) in indices.iter().zip(reader.read(position)?) {
                if let Some(Value::Scores(rows)) = value {
                    scores.extend(rows.iter().map(|&row| FrameScore { frame: frame.id.clone(), estimator, row }));
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
    /// Scored true pixels by metre, over the frames whose values were recorded; each truth counted once.
    pub(crate) truth: BTreeMap<u32, u64>,
}

/// Takes the samples of all recorded maps, on all cores; of the estimators whose maps were not recorded there are none.
///
/// At most `samples_in_memory` samples are held at a time, and the maps of one frame a core; what does not fit lies in `folder`
/// meanwhile.
pub(crate) fn distances(
    recording: &Recording,
    estimators: &[Estimator],
    samples_in_memory: usize,
    folder: &Path,
) -> Result<Distances, AnalysisError> {
    let samples = Mutex::new(Samples::new(estimators.len(), samples_in_memory, folder));
    let truth = Mutex::new(BTreeMap::new());
    for run in 0..recording.plan().runs.len() {
        let maps = Maps::new(run, estimators);
        if maps.estimators.is_empty() {
            continue;
        }
        maps.read_all(recording, estimators, &samples, &truth)?;
    }
    let samples = samples.into_inner().unwrap_or_else(PoisonError::into_inner);
    let truth = truth.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Distances { bins: samples.percentiles()?, truth })
}

/// The maps of a stage run that are compared: its topics, and where among them each estimator's are.
struct Maps {
    run: usize,
    topics: Vec<String>,
    /// Estimator, place of its truth, place of its estimate.
    estimators: Vec<(usize, usize, usize)>,
}

impl Maps {
    fn new(run: usize, estimators: &[Estimator]) -> Self {
        let mut maps = Self { run, topics: Vec::new(), estimators: Vec::new() };
        for (index, estimator) in estimators.iter().enumerate().filter(|(_, estimator)| estimator.run == run) {
            if let (Some(truth), Some(estimate)) = (&estimator.truth_topic, &estimator.estimate_topic) {
                let places = (index, maps.place(truth), maps.place(estimate));
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
        samples: &Mutex<Samples>,
        truth: &Mutex<BTreeMap<u32, u64>>,
    ) -> Result<(), AnalysisError> {
        let frames = recording.frames(self.run).len();
        let next = AtomicUsize::new(0);
        let work = || -> Result<(), AnalysisError> {
            let mut reader = recording.reader(self.run, &self.topics)?;
            let mut counts = BTreeMap::new();
            loop {
                let position = next.fetch_add(1, Ordering::Relaxed);
                if position >= frames {
                    break;
                }
                let frame = self.samples(estimators, &reader.read(position)?, &mut counts)?;
                let taken = samples.lock().unwrap_or_else(PoisonError::into_inner).take(frame);
                // The others stop too: what they would read is of no use any more.
                taken.inspect_err(|_| next.store(frames, Ordering::Relaxed))?;
            }
            let mut truth = truth.lock().unwrap_or_else(PoisonError::into_inner);
            for (metre, count) in counts {
                *truth.entry(metre).or_default() += count;
            }
            Ok(())
        };
        let cores = thread::available_parallelism().map_or(1, NonZero::get).min(frames.max(1));
        thread::scope(|scope| {
            let others: Vec<_> = (1..cores).map(|_| scope.spawn(work)).collect();
            let mut result = work();
            for other in others {
                let theirs = other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
                result = result.and(theirs);
            }
            result
        })
    }

    fn samples(
        &self,
        estimators: &[Estimator],
        maps: &[Option<Value>],
        counts: &mut BTreeMap<u32, u64>,
    ) -> Result<FrameSamples, AnalysisError> {
        let map = |place: usize| match &maps[place] {
            Some(Value::Depth(depth)) => Some(&**depth),
            _ => None,
        };
        let mut samples = FrameSamples::default();
        // Scored pixels by place of the truth and settings: estimators nearly always share them.
        let mut scored: Vec<(usize, &Estimator, ScoredPixels)> = Vec::new();
        for &(index, truth_place, estimate_place) in &self.estimators {
            let (Some(truth), Some(estimate)) = (map(truth_place), map(estimate_place)) else { continue };
            let estimator = &estimators[index];
            if truth.metres.dimensions() != estimate.metres.dimensions() {
                let what = format!("the estimate `{}` is of another size than its truth", estimator.label);
                return Err(AnalysisError::content(what));
            }
            let known =
                scored.iter().position(|(place, of, _)| *place == truth_place && of.settings == estimator.settings);
            let place = known.unwrap_or_else(|| {
                let pixels = scored_pixels(truth, estimator);
                if scored.iter().all(|(place, ..)| *place != truth_place) {
                    pixels.truth_m().iter().for_each(|&t| *counts.entry(t as u32).or_default() += 1);
                }
                scored.push((truth_place, estimator, pixels));
                scored.len() - 1
            });
            samples.add(index, &scored[place].2, &estimate.metres, &estimator.settings);
        }
        Ok(samples)
    }
}

fn scored_pixels(truth: &Depth, estimator: &Estimator) -> ScoredPixels {
    let (width, height) = truth.metres.dimensions();
    ScoredPixels::new(&truth.metres, width as usize, height as usize, &estimator.settings)
}

impl Distances {
    /// `bin_m, count`, as written to `true_distances.csv`.
    pub(crate) fn table_of_truth(&self) -> Result<DataFrame, AnalysisError> {
        let columns = vec![
            Column::from(Series::new("bin_m".into(), self.truth.keys().copied().collect::<Vec<_>>())),
            Column::from(Series::new("count".into(), self.truth.values().copied().collect::<Vec<_>>())),
        ];
        DataFrame::new(self.truth.len(), columns).map_err(AnalysisError::compute("the histogram of true distances"))
    }
}
