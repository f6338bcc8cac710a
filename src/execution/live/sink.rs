//! The sink of a live run: its storage, and the latest map for the display.

use std::sync::{Arc, Mutex};

use depthloom_graphs::contracts::{Commit, ErrorMessage, NodeWarning, Sink, Slot, Store, StoredValue};
use depthloom_graphs::plan::{FrameIndex, PartId, Plan, RunId};
use depthloom_graphs::{Frame, Key, Value, ValueType};
use depthloom_recording::Recorder;
use depthloom_threads::locked;

/// The latest map of a live run.
pub(crate) type LatestMap = Arc<Mutex<Option<Value>>>;

/// Encoded values of a frame.
type Part = <Recorder as Sink>::Part;

/// Where values are stored.
#[derive(Clone, Copy)]
pub(super) enum Storage<'a> {
    /// In a recording, or a ring of frames.
    Sink(&'a dyn Sink<Part = Part>),
    /// Nowhere. Values of earlier runs are reused, for example a trained network.
    Nothing { earlier: &'a dyn Store },
}

pub(super) struct LiveSink<'a> {
    storage: Storage<'a>,
    run: RunId,
    /// The map that is shown: the last estimate, or the last depth or disparity of a node.
    shown: Option<Slot>,
    latest: LatestMap,
    /// Whether viewers may want any value, also where none is stored.
    has_viewers: bool,
}

impl<'a> LiveSink<'a> {
    pub(super) fn new(storage: Storage<'a>, plan: &Plan, run: RunId, has_viewers: bool) -> Self {
        let stage = &plan.runs[run];
        let estimate = stage.estimates.last().map(|estimate| estimate.estimate);
        let map = || {
            let is_map = |slot: &Slot| {
                matches!(slot, Slot::Node { .. })
                    && matches!(stage.output(*slot).port.value_type, ValueType::Depth | ValueType::Disparity)
            };
            stage.slots().filter(is_map).last()
        };
        Self { storage, run, shown: estimate.or_else(map), latest: LatestMap::default(), has_viewers }
    }

    pub(super) fn latest(&self) -> LatestMap {
        Arc::clone(&self.latest)
    }

    fn sink(&self) -> Option<&'a dyn Sink<Part = Part>> {
        match self.storage {
            Storage::Sink(sink) => Some(sink),
            Storage::Nothing { .. } => None,
        }
    }

    fn show(&self, run: RunId, values: &[(Slot, Value)]) {
        let shown = values.iter().find(|(slot, _)| run == self.run && Some(*slot) == self.shown);
        if let Some((_, value)) = shown {
            *locked(&self.latest) = Some(value.clone());
        }
    }
}

impl Sink for LiveSink<'_> {
    type Part = Option<Part>;

    fn parts(&self, run: RunId) -> usize {
        match self.storage {
            Storage::Sink(sink) => sink.parts(run),
            // Of what is shown.
            Storage::Nothing { .. } => 1,
        }
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        match self.storage {
            Storage::Sink(sink) => sink.part(run, slot),
            Storage::Nothing { .. } => {
                (run == self.run && (self.has_viewers || Some(slot) == self.shown)).then_some(PartId(0))
            }
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
        self.sink().map(|sink| sink.encode(run, frame, part, values)).transpose()
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<Self::Part>) -> Result<(), ErrorMessage> {
        let Some(sink) = self.sink() else { return Ok(()) };
        sink.write(commit, parts.into_iter().flatten().collect())
    }

    fn once(
        &self,
        run: RunId,
        slot: Slot,
        key: &Key,
        value: &Value,
        warnings: &[NodeWarning],
    ) -> Result<(), ErrorMessage> {
        self.sink().map_or(Ok(()), |sink| sink.once(run, slot, key, value, warnings))
    }

    fn keeps(&self, run: RunId, slot: Slot, position: FrameIndex) -> bool {
        self.sink().is_some_and(|sink| sink.keeps(run, slot, position))
    }

    fn store(&self) -> Option<&dyn Store> {
        match self.storage {
            Storage::Sink(sink) => sink.store(),
            Storage::Nothing { earlier } => Some(earlier),
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
        self.sink().map(|sink| sink.encode_stored(run, frame, part, values, stored)).transpose()
    }

    fn written_aggregate(&self, run: RunId, slot: Slot) -> Option<Key> {
        self.sink().and_then(|sink| sink.written_aggregate(run, slot))
    }
}
