//! The samples of recorded maps.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;

use depthloom_graphs::Value;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::Recording;
use depthloom_scores::ScoredPixels;
use depthloom_threads::{into_unlocked, locked};

use super::metres::Metres;
use super::samples::{FrameSamples, Samples};
use super::{DistanceBin, Distances};
use crate::error::AnalysisError;
use crate::estimates::{Compared, Estimate};
use crate::files::Output;
use crate::query::scan;

/// The error against distance of the estimates for whose index `is_selected` returns true. All cores read maps, one
/// frame each, except the maps of frames that were already collected.
pub(super) fn distances(
    recording: &Recording,
    estimates: &[Estimate],
    is_selected: impl Fn(usize) -> bool,
    output: Output<'_>,
    CollectedSamples { samples, mut truth, frames }: CollectedSamples<'_>,
) -> Result<Distances, AnalysisError> {
    let samples = Mutex::new(samples);
    let mut repeated = Vec::new();
    for run in RunId::all(recording.plan().runs.len()) {
        let maps = Maps::new(run, estimates, &is_selected);
        if maps.estimates.is_empty() {
            continue;
        }
        let all = FrameIndex::all(recording.frames(run).len());
        let pending: Vec<FrameIndex> = all.filter(|position| !frames.contains(&(run, *position))).collect();
        // Percentiles do not depend on the order of samples.
        let new_worker = || (None, BTreeMap::new());
        let workers = scan(pending.len(), output.stop, new_worker, |(reader, truth), frame| {
            let mut own = match reader.take() {
                Some(own) => own,
                None => recording.reader(run, &maps.topics)?,
            };
            let frame = maps.samples(estimates, &own.read(pending[frame])?, truth)?;
            *reader = Some(own);
            locked(&samples).take(frame)
        })?;
        for (metre, count) in workers.into_iter().flat_map(|(_, truth)| truth) {
            *truth.entry(metre).or_default() += count;
        }
        repeated.extend(maps.repeated);
    }
    let samples = into_unlocked(samples);
    let mut beyond = samples.beyond().to_vec();
    let mut bins = samples.percentiles()?;
    for (estimate, first) in repeated {
        beyond[estimate] = beyond[first];
        let equal = bins.iter().filter(|bin| bin.estimate == first).map(|bin| DistanceBin { estimate, ..*bin });
        let equal: Vec<DistanceBin> = equal.collect();
        bins.extend(equal);
    }
    bins.sort_unstable_by_key(|bin| (bin.estimate, bin.bin_m));
    Ok(Distances { beyond, bins, truth })
}

/// Samples that were collected while their maps were in memory.
pub(super) struct CollectedSamples<'a> {
    pub(super) samples: Samples<'a>,
    /// Pixels with ground truth by stage run and metre.
    pub(super) truth: BTreeMap<(RunId, u32), u64>,
    /// The frames: stage run and position.
    pub(super) frames: BTreeSet<(RunId, FrameIndex)>,
}

impl<'a> CollectedSamples<'a> {
    /// Without frames.
    pub(super) fn empty(samples: Samples<'a>) -> Self {
        Self { samples, truth: BTreeMap::new(), frames: BTreeSet::new() }
    }
}

/// The compared maps of a stage run: their topics, and the places of the maps of each estimate among them.
pub(super) struct Maps {
    run: RunId,
    pub(super) topics: Vec<String>,
    /// Index of the estimate, place of its ground truth, place of its depth.
    estimates: Vec<(usize, usize, usize)>,
    /// Estimates that variants share: index, and that of an estimate above with the same maps and settings.
    repeated: Vec<(usize, usize)>,
}

impl Maps {
    /// The maps of the estimates for whose index `is_selected` returns true.
    pub(super) fn new(run: RunId, estimates: &[Estimate], is_selected: impl Fn(usize) -> bool) -> Self {
        let mut maps = Self { run, topics: Vec::new(), estimates: Vec::new(), repeated: Vec::new() };
        let selected =
            estimates.iter().enumerate().filter(|(index, estimate)| estimate.run == run && is_selected(*index));
        for (index, estimate) in selected {
            if let Some(Compared { truth_topic, estimate_topic, .. }) = estimate.compared() {
                let (truth, depth) = (maps.place(truth_topic), maps.place(estimate_topic));
                let is_equal = |(other, other_truth, other_depth): &&(usize, usize, usize)| {
                    (*other_truth, *other_depth) == (truth, depth) && estimates[*other].settings == estimate.settings
                };
                match maps.estimates.iter().find(is_equal) {
                    Some((first, ..)) => maps.repeated.push((index, *first)),
                    None => maps.estimates.push((index, truth, depth)),
                }
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

    /// The samples of a frame, from the values of its topics. Adds its pixels with ground truth to `counts` by stage
    /// run and metre.
    pub(super) fn samples(
        &self,
        estimates: &[Estimate],
        maps: &[Option<Value>],
        counts: &mut BTreeMap<(RunId, u32), u64>,
    ) -> Result<FrameSamples, AnalysisError> {
        let map = |place: usize| maps[place].as_ref().filter(|value| value.metres().is_some());
        let mut samples = FrameSamples::default();
        let mut pending: Vec<(usize, usize, usize)> = self.estimates.clone();
        // The pixels that were counted, for each ground truth that is used with several settings.
        let mut counted: BTreeMap<usize, Vec<bool>> = BTreeMap::new();
        // Estimates with the same ground truth and settings are compared: nearly always all of them.
        while let Some(&(first, truth_place, _)) = pending.first() {
            let Some(settings) = &estimates[first].settings else { break };
            let compared: Vec<(usize, Option<&Value>)> = pending
                .extract_if(.., |(index, truth, _)| {
                    *truth == truth_place && estimates[*index].settings.as_ref() == Some(settings)
                })
                .map(|(index, _, estimate)| (index, map(estimate)))
                .collect();
            let Some(truth) = map(truth_place).and_then(Value::metres) else { continue };
            // An estimate whose size differs from its ground truth was not scored: the run reported the failure.
            let has_truth_size =
                |value: &&Value| value.metres().is_some_and(|map| map.dimensions() == truth.dimensions());
            let compared: Vec<_> =
                compared.into_iter().map(|(index, estimate)| (index, estimate.filter(has_truth_size))).collect();
            let (width, height) = truth.dimensions();
            let pixels = ScoredPixels::new(truth, width as usize, height as usize, settings);
            let metres = Metres::new(pixels.ground_truth_m());
            if compared.iter().any(|(_, estimate)| estimate.is_some()) {
                let is_with_others = pending.iter().any(|(_, truth, _)| *truth == truth_place);
                if is_with_others {
                    counted.entry(truth_place).or_insert_with(|| vec![false; (width * height) as usize]);
                }
                let mut count = |metre: u32, pixels: u64| *counts.entry((self.run, metre)).or_default() += pixels;
                match counted.get_mut(&truth_place) {
                    None => metres.counts().for_each(|(metre, pixels)| count(metre, pixels as u64)),
                    Some(counted) => {
                        for (metre, place) in metres.of_pixels().zip(pixels.positions()) {
                            let is_new = !std::mem::replace(&mut counted[*place as usize], true);
                            if let (Some(metre), true) = (metre, is_new) {
                                count(metre, 1);
                            }
                        }
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
                    samples.add(*index, &metres, errors, &shared);
                }
            }
        }
        Ok(samples)
    }
}
