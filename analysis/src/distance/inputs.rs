//! Keys of what the error against distance is computed from. Estimators with equal keys have equal samples.

use depthloom_graphs::plan::RunId;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use depthloom_graphs::Key;
use depthloom_recording::Recording;

use super::FARTHEST_M;
use crate::error::AnalysisError;
use crate::estimators::{Compared, Estimator};

/// Raised when the bins of equal maps change.
const VERSION: u64 = 1;

/// What the bins of an estimator are computed from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Input {
    /// The number of its group. Estimators of a group have the same truth and the same settings, and share pixels.
    pub(super) group: usize,
    /// A key of the settings, and of truth and estimate on every frame. `None` if a map is missing on a frame.
    pub(super) key: Option<Key>,
}

/// By estimator: what its bins are computed from. `None` for an estimator without recorded maps.
pub(super) fn inputs(recording: &Recording, estimators: &[Estimator]) -> Result<Vec<Option<Input>>, AnalysisError> {
    let mut groups: Vec<(RunId, &str, String)> = Vec::new();
    let mut inputs = Vec::with_capacity(estimators.len());
    let mut digests: BTreeMap<(RunId, &str), Vec<Option<Key>>> = BTreeMap::new();
    for estimator in estimators {
        let Some(Compared { truth_topic, estimate_topic, settings }) = estimator.compared() else {
            inputs.push(None);
            continue;
        };
        let settings = format!("{settings:?}");
        for topic in [truth_topic, estimate_topic] {
            if let Entry::Vacant(entry) = digests.entry((estimator.run, topic)) {
                entry.insert(recording.value_digests(estimator.run, topic)?);
            }
        }
        let [truth, estimate] = [truth_topic, estimate_topic].map(|topic| &digests[&(estimator.run, topic)]);
        let frames = truth.iter().zip(estimate).map(|(truth, estimate)| Some(((*truth)?, (*estimate)?)));
        let frames: Option<Vec<(Key, Key)>> = frames.collect();
        let key = frames.map(|frames| {
            let key = Key::build("error against distance").number(VERSION).number(u64::from(FARTHEST_M));
            let key = key.text(&settings).number(frames.len() as u64);
            frames.iter().fold(key, |key, (truth, estimate)| key.key(truth).key(estimate)).finish()
        });
        let group = (estimator.run, truth_topic, settings);
        let number = groups.iter().position(|known| *known == group).unwrap_or(groups.len());
        if number == groups.len() {
            groups.push(group);
        }
        inputs.push(Some(Input { group: number, key }));
    }
    Ok(inputs)
}
