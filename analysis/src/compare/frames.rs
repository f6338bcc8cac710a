//! Which frame of one estimate is held against which of another.

use std::collections::BTreeMap;

use depthloom_graphs::Key;

use super::ComparedRun;
use crate::estimates::Estimate;
use crate::scores::FrameScore;

/// An estimate's scores on one pixel set of one zone, frame by frame.
#[derive(Clone)]
pub(super) struct ScoredBy<'a> {
    pub(super) run: ComparedRun<'a>,
    pub(super) estimate: &'a Estimate,
    pub(super) scores: Vec<&'a FrameScore>,
}

/// The frames of two estimates that are the same.
pub(super) struct Paired<'a> {
    /// The baseline's score, and the other's, in the baseline's order.
    pub(super) frames: Vec<(&'a FrameScore, &'a FrameScore)>,
    /// How many frames one of them has alone.
    pub(super) only_baseline: usize,
    pub(super) only_other: usize,
    /// On how many of the frames in both the source's values are not the same.
    pub(super) other_values: usize,
    /// On how many the number of pixels with ground truth is not.
    pub(super) other_truth: usize,
}

impl ScoredBy<'_> {
    pub(super) fn stage(&self) -> &str {
        &self.run.recording.plan().runs[self.estimate.run].stage
    }

    /// Its label, with its run where there are several.
    pub(super) fn title(&self, runs: usize) -> String {
        if runs > 1 { format!("{}:{}", self.run.called, self.estimate.label) } else { self.estimate.label.clone() }
    }

    fn key(&self, score: &FrameScore) -> Option<Key> {
        self.run.recording.frames(self.estimate.run).get(score.position.0).and_then(|frame| frame.source_key)
    }

    fn is_of_run(&self, other: &Self) -> bool {
        std::ptr::eq(self.run.recording, other.run.recording) && self.estimate.run == other.estimate.run
    }
}

impl<'a> Paired<'a> {
    /// Frames of one run by their places; else those of one id, of stages of one name. Where an id repeats, frames of
    /// equal source values go together before others, the first before the second. Stages of two names have only frames
    /// of equal source values in common.
    pub(super) fn of(baseline: &ScoredBy<'a>, other: &ScoredBy<'a>) -> Self {
        let (is_run, is_stage) = (baseline.is_of_run(other), baseline.stage() == other.stage());
        let mut left: BTreeMap<&str, Vec<&'a FrameScore>> = BTreeMap::new();
        for &score in &other.scores {
            left.entry(&score.frame).or_default().push(score);
        }
        let mut take = |score: &FrameScore, is_its: &dyn Fn(&FrameScore) -> bool| {
            let of_id = left.get_mut(&*score.frame)?;
            let place = of_id.iter().position(|other| is_its(other))?;
            Some(of_id.remove(place))
        };
        let mut found: Vec<Option<&'a FrameScore>> = vec![None; baseline.scores.len()];
        for (score, found) in baseline.scores.iter().zip(&mut found) {
            let key = baseline.key(score);
            *found = take(score, &|of| match is_run {
                true => of.position == score.position,
                false => key.is_some() && other.key(of) == key,
            });
        }
        if is_stage && !is_run {
            for (score, found) in baseline.scores.iter().zip(&mut found).filter(|(_, found)| found.is_none()) {
                *found = take(score, &|_| true);
            }
        }
        let frames: Vec<_> = baseline.scores.iter().zip(found).filter_map(|(score, of)| Some((*score, of?))).collect();
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
