//! The sink of a live run: the recording, and the latest map for the display.

use std::sync::{Arc, Mutex};

use depthloom_graphs::contracts::{Commit, ErrorMessage, NodeWarning, Sink, Slot, Store, StoredValue};
use depthloom_graphs::plan::{FrameIndex, PartId, Plan, RunId};
use depthloom_graphs::{Frame, Key, Value, ValueType};
use depthloom_recording::Recorder;
use depthloom_threads::locked;

/// The latest map of a live run.
pub(crate) type LatestMap = Arc<Mutex<Option<Value>>>;

/// Where values are stored.
pub(super) enum Storage<'a> {
    Recording(&'a Recorder),
    Nothing,
}

pub(super) struct LiveSink<'a> {
    storage: Storage<'a>,
    run: RunId,
    /// The map that is shown: the last estimate, or the last depth or disparity of a node.
    shown: Option<Slot>,
    latest: LatestMap,
}

impl<'a> LiveSink<'a> {
    pub(super) fn new(storage: Storage<'a>, plan: &Plan, run: RunId) -> Self {
        let stage = &plan.runs[run];
        let estimate = stage.estimates.last().map(|estimate| estimate.estimate);
        let map = || {
            let is_map = |slot: &Slot| {
                matches!(slot, Slot::Node { .. })
                    && matches!(stage.output(*slot).port.value_type, ValueType::Depth | ValueType::Disparity)
            };
            stage.slots().filter(is_map).last()
        };
        Self { storage, run, shown: estimate.or_else(map), latest: LatestMap::default() }
    }

    pub(super) fn latest(&self) -> LatestMap {
        Arc::clone(&self.latest)
    }

    fn show(&self, run: RunId, values: &[(Slot, Value)]) {
        let shown = values.iter().find(|(slot, _)| run == self.run && Some(*slot) == self.shown);
        if let Some((_, value)) = shown {
            *locked(&self.latest) = Some(value.clone());
        }
    }
}

impl Sink for LiveSink<'_> {
    type Part = Option<<Recorder as Sink>::Part>;

    fn parts(&self, run: RunId) -> usize {
        match self.storage {
            Storage::Recording(recorder) => recorder.parts(run),
            // One for the map that is shown.
            Storage::Nothing => 1,
        }
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        match self.storage {
            Storage::Recording(recorder) => recorder.part(run, slot),
            Storage::Nothing => (run == self.run && Some(slot) == self.shown).then_some(PartId(0)),
        }
    }

    fn encode(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<Self::Part, ErrorMessage> {
        self.show(run, values);
        match self.storage {
            Storage::Recording(recorder) => recorder.encode(run, frame, part, values).map(Some),
            Storage::Nothing => Ok(None),
        }
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<Self::Part>) -> Result<(), ErrorMessage> {
        match self.storage {
            Storage::Recording(recorder) => recorder.write(commit, parts.into_iter().flatten().collect()),
            Storage::Nothing => Ok(()),
        }
    }

    fn once(
        &self,
        run: RunId,
        slot: Slot,
        key: &Key,
        value: &Value,
        warnings: &[NodeWarning],
    ) -> Result<(), ErrorMessage> {
        match self.storage {
            Storage::Recording(recorder) => recorder.once(run, slot, key, value, warnings),
            Storage::Nothing => Ok(()),
        }
    }

    fn keeps(&self, run: RunId, slot: Slot, position: FrameIndex) -> bool {
        match self.storage {
            Storage::Recording(recorder) => recorder.keeps(run, slot, position),
            Storage::Nothing => false,
        }
    }

    fn store(&self) -> Option<&dyn Store> {
        match self.storage {
            Storage::Recording(recorder) => recorder.store(),
            Storage::Nothing => None,
        }
    }

    fn encode_stored(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
        stored: &[StoredValue<'_>],
    ) -> Result<Self::Part, ErrorMessage> {
        match self.storage {
            Storage::Recording(recorder) => recorder.encode_stored(run, frame, part, values, stored).map(Some),
            Storage::Nothing => Ok(None),
        }
    }

    fn written_aggregate(&self, run: RunId, slot: Slot) -> Option<Key> {
        match self.storage {
            Storage::Recording(recorder) => recorder.written_aggregate(run, slot),
            Storage::Nothing => None,
        }
    }
}
