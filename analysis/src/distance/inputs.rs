//! Keys of what the error against distance is computed from. Estimates with equal keys have equal samples.

use depthloom_graphs::plan::RunId;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use depthloom_graphs::Key;
use depthloom_recording::Recording;

use super::FARTHEST_M;
use crate::error::AnalysisError;
use crate::estimates::{Compared, Estimate};

/// Raised when the bins of equal maps change.
const VERSION: u64 = 1;

/// What the bins of an estimate are computed from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Input {
    /// The number of its group. Estimates of a group have the same ground truth and the same settings, and share
    /// pixels.
    pub(super) group: usize,
    /// A key of the settings, and of ground truth and estimate on every frame. `None` if a map is missing on a frame.
    pub(super) key: Option<Key>,
}

/// By estimate: what its bins are computed from. `None` for an estimate without recorded maps.
pub(super) fn inputs(recording: &Recording, estimates: &[Estimate]) -> Result<Vec<Option<Input>>, AnalysisError> {
    let mut groups: Vec<(RunId, &str, String)> = Vec::new();
    let mut inputs = Vec::with_capacity(estimates.len());
    let mut digests: BTreeMap<(RunId, &str), Vec<Option<Key>>> = BTreeMap::new();
    for estimate in estimates {
        let Some(Compared { truth_topic, estimate_topic, settings }) = estimate.compared() else {
            inputs.push(None);
            continue;
        };
        let settings = format!("{settings:?}");
        for topic in [truth_topic, estimate_topic] {
            if let Entry::Vacant(entry) = digests.entry((estimate.run, topic)) {
                entry.insert(recording.value_digests(estimate.run, topic)?);
            }
        }
        let [truth, depths] = [truth_topic, estimate_topic].map(|topic| &digests[&(estimate.run, topic)]);
        let frames = truth.iter().zip(depths).map(|(truth, depth)| Some(((*truth)?, (*depth)?)));
        let frames: Option<Vec<(Key, Key)>> = frames.collect();
        let key = frames.map(|frames| {
            let key = Key::build("error against distance").number(VERSION).number(u64::from(FARTHEST_M));
            let key = key.text(&settings).number(frames.len() as u64);
            frames.iter().fold(key, |key, (truth, depth)| key.key(truth).key(depth)).finish()
        });
        let group = (estimate.run, truth_topic, settings);
        let number = groups.iter().position(|known| *known == group).unwrap_or(groups.len());
        if number == groups.len() {
            groups.push(group);
        }
        inputs.push(Some(Input { group: number, key }));
    }
    Ok(inputs)
}
