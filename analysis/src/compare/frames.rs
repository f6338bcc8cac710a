//! Pairs the frames of two estimates.

use std::collections::BTreeMap;

use depthloom_graphs::Key;

use super::ComparedRun;
use crate::estimates::Estimate;
use crate::scores::FrameScore;

/// The scores of an estimate on one pixel set of one zone, frame by frame.
#[derive(Clone)]
pub(super) struct ScoredBy<'a> {
    pub(super) run: ComparedRun<'a>,
    pub(super) estimate: &'a Estimate,
    pub(super) scores: Vec<&'a FrameScore>,
}

/// The common frames of two estimates.
pub(super) struct Paired<'a> {
    /// The scores of the baseline and of the other, in the order of the baseline.
    pub(super) frames: Vec<(&'a FrameScore, &'a FrameScore)>,
    /// The numbers of frames that only one side has.
    pub(super) only_baseline: usize,
    pub(super) only_other: usize,
    /// The number of common frames with different source values.
    pub(super) other_values: usize,
    /// The number of common frames with different numbers of pixels with ground truth.
    pub(super) other_truth: usize,
}

impl ScoredBy<'_> {
    pub(super) fn stage(&self) -> &str {
        &self.run.recording.plan().runs[self.estimate.run].stage
    }

    /// Its label, with its run if there are several.
    pub(super) fn title(&self, runs: usize) -> String {
        if runs > 1 { format!("{}:{}", self.run.called, self.estimate.label) } else { self.estimate.label.clone() }
    }

    fn key(&self, score: &FrameScore) -> Option<Key> {
        self.run.recording.frames(self.estimate.run).get(score.position.0).and_then(|frame| frame.source_key)
    }

    fn has_same_run(&self, other: &Self) -> bool {
        std::ptr::eq(self.run.recording, other.run.recording) && self.estimate.run == other.estimate.run
    }
}

impl<'a> Paired<'a> {
    /// Pairs the frames of one run by position. Frames of different runs are paired by id if their stages have one
    /// name. If an id repeats, frames with equal source values are paired first, in their order. Stages with different
    /// names share only frames with equal source values.
    pub(super) fn new(baseline: &ScoredBy<'a>, other: &ScoredBy<'a>) -> Self {
        let (is_run, is_stage) = (baseline.has_same_run(other), baseline.stage() == other.stage());
        let mut unpaired: BTreeMap<&str, Vec<&'a FrameScore>> = BTreeMap::new();
        for &score in &other.scores {
            unpaired.entry(&score.frame).or_default().push(score);
        }
        let mut take = |score: &FrameScore, is_counterpart: &dyn Fn(&FrameScore) -> bool| {
            let same_id = unpaired.get_mut(&*score.frame)?;
            let place = same_id.iter().position(|other| is_counterpart(other))?;
            Some(same_id.remove(place))
        };
        let mut found: Vec<Option<&'a FrameScore>> = vec![None; baseline.scores.len()];
        for (score, found) in baseline.scores.iter().zip(&mut found) {
            let key = baseline.key(score);
            *found = take(score, &|candidate| match is_run {
                true => candidate.position == score.position,
                false => key.is_some() && other.key(candidate) == key,
            });
        }
        if is_stage && !is_run {
            for (score, found) in baseline.scores.iter().zip(&mut found).filter(|(_, found)| found.is_none()) {
                *found = take(score, &|_| true);
            }
        }
        let frames: Vec<_> =
            baseline.scores.iter().zip(found).filter_map(|(score, found)| Some((*score, found?))).collect();
        let count = |differs: &dyn Fn(&FrameScore, &FrameScore) -> bool| {
            frames.iter().filter(|(one, two)| differs(one, two)).count()
        };
        Self {
            only_baseline: baseline.scores.len() - frames.len(),
            only_other: other.scores.len() - frames.len(),
            other_values: count(&|one, two| baseline.key(one) != other.key(two)),
            other_truth: count(&|one, two| one.row.truth != two.row.truth),
            frames,
        }
    }
}
