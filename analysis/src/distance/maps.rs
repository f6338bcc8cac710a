//! The samples of recorded maps.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;

use depthloom_graphs::Value;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::Recording;
use depthloom_scores::ScoredPixels;
use depthloom_threads::{into_unlocked, locked};

use super::samples::{FrameSamples, Samples};
use super::{Distances, FARTHEST_M};
use crate::error::AnalysisError;
use crate::estimates::{Compared, Estimate};
use crate::files::Output;
use crate::query::scan;

/// The error against distance of those estimates for whose index `is_wanted` returns true. All cores read maps, one
/// frame each, except those of frames that are in `taken`.
pub(super) fn distances(
    recording: &Recording,
    estimates: &[Estimate],
    is_wanted: impl Fn(usize) -> bool,
    output: Output<'_>,
    Taken { samples, mut truth, frames }: Taken<'_>,
) -> Result<Distances, AnalysisError> {
    let samples = Mutex::new(samples);
    for run in RunId::all(recording.plan().runs.len()) {
        let maps = Maps::new(run, estimates, &is_wanted);
        if maps.estimates.is_empty() {
            continue;
        }
        let left = FrameIndex::all(recording.frames(run).len());
        let left: Vec<FrameIndex> = left.filter(|position| !frames.contains(&(run, *position))).collect();
        // The order of samples changes no percentile.
        let new_worker = || (None, BTreeMap::new());
        let workers = scan(left.len(), output.stop, new_worker, |(reader, truth), frame| {
            let mut own = match reader.take() {
                Some(own) => own,
                None => recording.reader(run, &maps.topics)?,
            };
            let frame = maps.samples(estimates, &own.read(left[frame])?, truth)?;
            *reader = Some(own);
            locked(&samples).take(frame)
        })?;
        for (metre, count) in workers.into_iter().flat_map(|(_, truth)| truth) {
            *truth.entry(metre).or_default() += count;
        }
    }
    let samples = into_unlocked(samples);
    Ok(Distances { beyond: samples.beyond().to_vec(), bins: samples.percentiles()?, truth })
}

/// The samples of frames whose maps were at hand.
pub(super) struct Taken<'a> {
    pub(super) samples: Samples<'a>,
    /// Pixels with ground truth by stage run and metre.
    pub(super) truth: BTreeMap<(RunId, u32), u64>,
    /// Which frames: stage run and position.
    pub(super) frames: BTreeSet<(RunId, FrameIndex)>,
}

impl<'a> Taken<'a> {
    /// Of no frame yet.
    pub(super) fn none_yet(samples: Samples<'a>) -> Self {
        Self { samples, truth: BTreeMap::new(), frames: BTreeSet::new() }
    }
}

/// The maps of a stage run that are compared: its topics, and where among them each estimate's are.
pub(super) struct Maps {
    run: RunId,
    pub(super) topics: Vec<String>,
    /// Estimate, place of its truth, place of its estimate.
    estimates: Vec<(usize, usize, usize)>,
}

impl Maps {
    /// The maps of those estimates for whose index `is_wanted` holds.
    pub(super) fn new(run: RunId, estimates: &[Estimate], is_wanted: impl Fn(usize) -> bool) -> Self {
        let mut maps = Self { run, topics: Vec::new(), estimates: Vec::new() };
        let of_run = estimates.iter().enumerate().filter(|(index, of)| of.run == run && is_wanted(*index));
        for (index, estimate) in of_run {
            if let Some(Compared { truth_topic, estimate_topic, .. }) = estimate.compared() {
                let places = (index, maps.place(truth_topic), maps.place(estimate_topic));
                maps.estimates.push(places);
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

    /// The samples of a frame, by the values of its topics; and its pixels with ground truth, added to those by stage
    /// run and metre.
    pub(super) fn samples(
        &self,
        estimates: &[Estimate],
        maps: &[Option<Value>],
        counts: &mut BTreeMap<(RunId, u32), u64>,
    ) -> Result<FrameSamples, AnalysisError> {
        let map = |place: usize| maps[place].as_ref().filter(|value| value.metres().is_some());
        let mut samples = FrameSamples::default();
        let mut left: Vec<(usize, usize, usize)> = self.estimates.clone();
        // By truth that estimates with several settings are scored against, the pixels that were counted.
        let mut counted: BTreeMap<usize, Vec<bool>> = BTreeMap::new();
        // Those with one truth and one way to be scored are compared: nearly always all of them.
        while let Some(&(first, truth_place, _)) = left.first() {
            let Some(settings) = &estimates[first].settings else { break };
            let compared: Vec<(usize, Option<&Value>)> = left
                .extract_if(.., |(index, truth, _)| {
                    *truth == truth_place && estimates[*index].settings.as_ref() == Some(settings)
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
