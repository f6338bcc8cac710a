//! Which frames and nodes an audit recomputes.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{BuildHasher as _, RandomState};
use std::sync::Mutex;

use depthloom_graphs::plan::FrameIndex;
use depthloom_random::SplitMix64;
use depthloom_threads::locked;

use crate::options::Audit;
use crate::reuse::FramePlan;
use crate::stage::frame_graph::StepId;

/// One frame in this many is recomputed.
const FRAMES_PER_SAMPLE: usize = 50;

pub(crate) struct Sampler {
    mode: Audit,
    state: Mutex<SamplerState>,
}

struct SamplerState {
    random: SplitMix64,
    /// By step, whether a reused value was compared.
    covered: Vec<bool>,
    /// By uncovered step, on how many frames values were reused, and a random one of these.
    pending: BTreeMap<StepId, (usize, FrameIndex)>,
}

impl Sampler {
    pub(crate) fn new(mode: Audit, steps: usize) -> Self {
        let seed = RandomState::new().hash_one(std::process::id());
        let state =
            SamplerState { random: SplitMix64::new(seed), covered: vec![false; steps], pending: BTreeMap::new() };
        Self { mode, state: Mutex::new(state) }
    }

    pub(crate) fn is_on(&self) -> bool {
        self.mode != Audit::None
    }

    /// Notes the steps whose values are reused on a frame.
    pub(crate) fn note(&self, position: FrameIndex, plan: &FramePlan) {
        if self.mode != Audit::Sample {
            return;
        }
        let SamplerState { random, covered, pending } = &mut *locked(&self.state);
        for step in StepId::all(covered.len()).filter(|step| plan.reuses(*step)) {
            if covered[step] {
                continue;
            }
            let (seen, chosen) = pending.entry(step).or_insert((0, position));
            *seen += 1;
            if random.below(*seen) == 0 {
                *chosen = position;
            }
        }
    }

    /// The frames to recompute before the first one runs; `written` of them are kept from an interrupted run.
    pub(crate) fn early(&self, frames: usize, written: usize) -> Vec<FrameIndex> {
        match self.mode {
            Audit::None => Vec::new(),
            Audit::All => FrameIndex::all(frames).collect(),
            Audit::Sample => {
                let random = &mut locked(&self.state).random;
                let mut chosen = BTreeSet::new();
                for part in [0..written.min(frames), written.min(frames)..frames] {
                    if part.is_empty() {
                        continue;
                    }
                    let count = (part.len() / FRAMES_PER_SAMPLE).max(1);
                    chosen.extend((0..count).map(|_| part.start + random.below(part.len())));
                }
                chosen.into_iter().map(FrameIndex).collect()
            }
        }
    }

    /// On how many first frames an ordered node is recomputed.
    pub(crate) fn prefix(&self, frames: usize) -> usize {
        match self.mode {
            Audit::None => 0,
            Audit::All => frames,
            Audit::Sample => (1 + locked(&self.state).random.below((frames / FRAMES_PER_SAMPLE).max(1))).min(frames),
        }
    }

    pub(crate) fn cover(&self, step: StepId) {
        let state = &mut *locked(&self.state);
        state.covered[step] = true;
        state.pending.remove(&step);
    }

    /// Frames on which uncovered steps were reused, with these steps.
    pub(crate) fn late(&self) -> BTreeMap<FrameIndex, Vec<StepId>> {
        let mut frames: BTreeMap<FrameIndex, Vec<StepId>> = BTreeMap::new();
        for (step, (_, position)) in &locked(&self.state).pending {
            frames.entry(*position).or_default().push(*step);
        }
        frames
    }
}
