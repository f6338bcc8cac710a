//! A recording as a store: values by key.

use std::sync::Arc;

use depthloom_graphs::contracts::{Fault, Slot, Store, StoredPort, StoredState};
use depthloom_graphs::plan::{FrameIndex, NodeId, PortId, RunId};
use depthloom_graphs::values::Artifact;
use depthloom_graphs::{Key, Value, ValueType};

use crate::condition::Condition;
use crate::error::RecordingError;
use crate::plan::RecordedOutput;
use crate::read::index::ChunkEntry;
use crate::read::recording::{RecordedAggregate, RecordedContent, Recording, StoredValues};
use crate::reuse::key_index::{KeyIndex, KeyedPlace};

/// The chunk with a value of a port, and its topic in the recording.
pub(crate) struct ValueChunk<'a> {
    pub(crate) channel: u16,
    /// The topic of its port in the recorded plan.
    pub(crate) topic: &'a str,
    pub(crate) chunk: &'a ChunkEntry,
}

impl Recording {
    /// Where the values of a key are stored.
    pub(crate) fn place_of(&self, key: &Key) -> Option<KeyedPlace> {
        let index = self.by_key.get_or_init(|| KeyIndex::new(std::iter::once(self)));
        index.places(key).next().map(|(_, place)| place)
    }

    /// The chunk with the value of a port under the key of a place; `None` for aggregate values, and if the port has no
    /// value.
    pub(crate) fn value_chunk(&self, place: KeyedPlace, port: &str) -> Option<ValueChunk<'_>> {
        let StoredValues::Frame { run, position, node } = place.values() else { return None };
        let topic = self.topic_of(run, node, port)?;
        self.channels_of(topic).find_map(|channel| {
            let chunk = self.chunk_of(run, position, channel)?;
            Some(ValueChunk { channel, topic, chunk })
        })
    }

    /// The chunk of a frame that has messages of a channel.
    pub(crate) fn chunk_of(&self, run: RunId, position: FrameIndex, channel: u16) -> Option<&ChunkEntry> {
        let chunks = self.frames(run)[position].chunks(&self.index);
        chunks.iter().find(|chunk| chunk.channels.binary_search(&channel).is_ok())
    }

    /// What the recording has of a place, by output port: all ports of a node share its key. See [`Store::find`].
    pub(crate) fn stored_at(&self, place: KeyedPlace) -> Vec<StoredPort> {
        match place.values() {
            StoredValues::Once { run, node } => self.stored_aggregates(run, node),
            StoredValues::Frame { run, position, node } => {
                let frame = &self.frames(run)[position];
                let is_there = |output: &RecordedOutput| self.value_chunk(place, &output.port).is_some();
                let slot = |port| node.map_or(Slot::Source { port }, |node| Slot::Node { node, port });
                let has_value = |port: PortId| frame.absent.as_ref().map(|absent| !absent.contains(&slot(port)));
                let of_frames = PortId::enumerate(self.outputs_of(run, node)).filter(|(_, output)| !output.once);
                let ports = of_frames.filter_map(|(port, output)| {
                    let state = match (self.keeps(output, position), has_value(port)) {
                        (true, _) if is_there(output) => StoredState::Stored,
                        (true, _) | (false, Some(false)) => StoredState::Absent,
                        (false, Some(true)) => StoredState::NotKept,
                        (false, None) => return None,
                    };
                    Some(StoredPort { port: output.port.clone(), state })
                });
                ports.collect()
            }
        }
    }

    /// Whether an output's value on the frame at a position was recorded.
    fn keeps(&self, output: &RecordedOutput, position: FrameIndex) -> bool {
        // On frames that `every` leaves out, only scores are recorded.
        let is_whole = (position.0 as u64).is_multiple_of(self.plan().every.max(1));
        let is_kept = is_whole || output.value_type() == Some(ValueType::Scores);
        output.recorded && !output.once && is_kept
    }

    /// The channels of a topic; for images including the channel for images with their file's bytes.
    pub(crate) fn channels_of(&self, topic: &str) -> impl Iterator<Item = u16> {
        self.index.channels.iter().filter(move |(_, channel)| channel.topic == topic).map(|(id, _)| *id)
    }

    /// The value of a port at a place; `None` if the port has no value.
    pub(crate) fn value_at(&self, place: KeyedPlace, port: &str) -> Result<Option<Value>, RecordingError> {
        let missing =
            || RecordingError::Missing { path: self.path().to_owned(), what: format!("a value of port `{port}`") };
        match place.values() {
            StoredValues::Frame { run, position, node } => {
                let mut outputs = self.outputs_of(run, node);
                let output = outputs.find(|output| output.port == port && self.keeps(output, position));
                let output = output.ok_or_else(missing)?;
                Ok(self.reader(run, &[&output.topic])?.read(position)?.pop().flatten())
            }
            StoredValues::Once { run, node } => {
                let stored = self
                    .stored_aggregates(run, node)
                    .into_iter()
                    .find(|stored| stored.port == port)
                    .ok_or_else(missing)?;
                if stored.state == StoredState::Absent {
                    return Ok(None);
                }
                let of_port = |once: &&RecordedAggregate| {
                    let output = self.plan().runs[run].nodes[node].outputs.get(once.port.0);
                    (once.run, once.node) == (run, node) && output.is_some_and(|output| output.port == port)
                };
                let once = self.aggregate_values().iter().find(of_port).ok_or_else(missing)?;
                self.aggregate_value(once).map(Some)
            }
        }
    }

    /// The topic of a per-frame output of a source (`None`) or node.
    pub(crate) fn topic_of(&self, run: RunId, node: Option<NodeId>, port: &str) -> Option<&str> {
        let mut outputs = self.outputs_of(run, node);
        outputs.find(|output| output.port == port && !output.once).map(|output| output.topic.as_str())
    }

    /// The warnings that were reported when the values at a place were computed.
    pub(crate) fn warnings_at(&self, place: KeyedPlace) -> Vec<(String, u64)> {
        match place.values() {
            StoredValues::Frame { run, position, node } => {
                let warnings = self.frames(run)[position].warnings.iter().filter(|warning| warning.node == node);
                warnings.map(|warning| (warning.what.clone(), warning.count)).collect()
            }
            StoredValues::Once { run, node } => {
                let once = self.aggregate_values().iter().find(|once| (once.run, once.node) == (run, node));
                once.map(|once| once.warnings.clone()).unwrap_or_default()
            }
        }
    }

    fn stored_aggregates(&self, run: RunId, node: NodeId) -> Vec<StoredPort> {
        let mut ports = Vec::new();
        for (port, output) in PortId::enumerate(self.outputs_of(run, Some(node))) {
            let is_there =
                self.aggregate_values().iter().any(|once| (once.run, once.node, once.port) == (run, node, port));
            // Each aggregate value of a node has its own record: a missing one may have been cut off.
            if output.recorded && output.once && (is_there || *self.condition() == Condition::Complete) {
                let state = if is_there { StoredState::Stored } else { StoredState::Absent };
                ports.push(StoredPort { port: output.port.clone(), state });
            }
        }
        ports
    }

    /// The planned outputs of a source (`None`) or node.
    fn outputs_of(&self, run: RunId, node: Option<NodeId>) -> impl Iterator<Item = &RecordedOutput> {
        let planned = &self.plan().runs[run];
        let outputs = match node {
            None => Some(&planned.source.outputs),
            Some(node) => planned.nodes.get(node.0).map(|node| &node.outputs),
        };
        outputs.into_iter().flatten()
    }

    /// Reads an aggregate value.
    ///
    /// # Errors
    /// If the recording cannot be read.
    pub fn aggregate_value(&self, aggregate: &RecordedAggregate) -> Result<Value, RecordingError> {
        Ok(match &aggregate.content {
            RecordedContent::Messages { topic, count } => self.curve(topic, *count)?.into(),
            RecordedContent::Attachment { media_type, name, hash } => {
                let artifact = Arc::new(Artifact::new(media_type.clone(), self.attachment(name)?));
                if artifact.hash != *hash {
                    let what = format!("attachment `{name}` is another than the one of its aggregate value");
                    return Err(RecordingError::Content { path: self.path().to_owned(), what });
                }
                let value_type = ValueType::from_name(&aggregate.value_type);
                value_type.and_then(|value_type| Value::from_artifact(value_type, artifact)).ok_or_else(|| {
                    let what = format!("attachment `{name}` has the type {}", aggregate.value_type);
                    RecordingError::Content { path: self.path().to_owned(), what }
                })?
            }
        })
    }

    /// Passes each key and where its values are: first those of frames in order, then aggregate values.
    pub(crate) fn each_keyed_place(&self, mut each: impl FnMut(Key, StoredValues)) {
        for run in RunId::all(self.plan().runs.len()) {
            for (position, frame) in FrameIndex::enumerate(self.frames(run)) {
                let of_nodes = frame.keys.iter().map(|of| (of.key, Some(of.node)));
                let of_source = frame.source_key.map(|key| (key, None));
                for (key, node) in of_source.into_iter().chain(of_nodes) {
                    each(key, StoredValues::Frame { run, position, node });
                }
            }
        }
        for once in self.aggregate_values() {
            each(once.key, StoredValues::Once { run: once.run, node: once.node });
        }
    }
}

impl Store for Recording {
    fn find(&self, key: &Key) -> Option<Vec<StoredPort>> {
        self.place_of(key).map(|place| self.stored_at(place))
    }

    fn value(&self, key: &Key, port: &str) -> Result<Option<Value>, Fault> {
        let place = self.place_of(key).ok_or_else(|| unknown(key))?;
        self.value_at(place, port).map_err(fault)
    }

    fn warnings(&self, key: &Key) -> Vec<(String, u64)> {
        self.place_of(key).map(|place| self.warnings_at(place)).unwrap_or_default()
    }
}

pub(crate) fn unknown(key: &Key) -> Fault {
    Fault::new(format!("the store knows no key {key}"))
}

pub(crate) fn fault(error: RecordingError) -> Fault {
    Fault::Failed(error.into())
}
