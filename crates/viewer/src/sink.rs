//! A sink that shows its values to a viewer.

use depthloom_graphs::contracts::{Commit, ErrorMessage, NodeWarning, Sink, Slot, Store, StoredValue};
use depthloom_graphs::plan::{FrameIndex, PartId, RunId};
use depthloom_graphs::{Frame, Key, Value};

use crate::viewer::Viewer;

/// Forwards everything to another sink unchanged, and passes values to a viewer, if there is one.
pub struct ViewerSink<'a, S> {
    sink: &'a S,
    viewer: Option<&'a Viewer>,
}

impl<'a, S: Sink> ViewerSink<'a, S> {
    /// Shows the values that `sink` takes.
    pub const fn new(sink: &'a S, viewer: Option<&'a Viewer>) -> Self {
        Self { sink, viewer }
    }
}

impl<S: Sink> Sink for ViewerSink<'_, S> {
    type Part = S::Part;

    fn parts(&self, run: RunId) -> usize {
        self.sink.parts(run)
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        self.sink.part(run, slot)
    }

    fn encode(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<Self::Part, ErrorMessage> {
        // First: the viewer's thread encodes at the same time.
        if let Some(viewer) = self.viewer {
            viewer.offer(run, frame, values.iter().map(|(slot, value)| (*slot, value)));
        }
        self.sink.encode(run, frame, part, values)
    }

    fn encode_stored(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
        stored: &[StoredValue<'_>],
    ) -> Result<Self::Part, ErrorMessage> {
        if let Some(viewer) = self.viewer {
            // Values that no node needed are not decoded, and not shown.
            let stored = stored.iter().filter_map(|stored| Some((stored.slot, stored.value.as_ref()?)));
            viewer.offer(run, frame, values.iter().map(|(slot, value)| (*slot, value)).chain(stored));
        }
        self.sink.encode_stored(run, frame, part, values, stored)
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<Self::Part>) -> Result<(), ErrorMessage> {
        self.sink.write(commit, parts)
    }

    fn once(
        &self,
        run: RunId,
        slot: Slot,
        key: &Key,
        value: &Value,
        warnings: &[NodeWarning],
    ) -> Result<(), ErrorMessage> {
        self.sink.once(run, slot, key, value, warnings)
    }

    fn keeps(&self, run: RunId, slot: Slot, position: FrameIndex) -> bool {
        self.sink.keeps(run, slot, position)
    }

    fn store(&self) -> Option<&dyn Store> {
        self.sink.store()
    }

    fn written(&self, run: RunId) -> usize {
        self.sink.written(run)
    }

    fn recorded_warnings(&self, run: RunId) -> Vec<Vec<NodeWarning>> {
        self.sink.recorded_warnings(run)
    }

    fn written_aggregate(&self, run: RunId, slot: Slot) -> Option<Key> {
        self.sink.written_aggregate(run, slot)
    }
}
