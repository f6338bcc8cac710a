//! The sink of a run's values, for example a recording.

use super::{Frame, LiveCommit, Store};
use crate::ids::{FrameIndex, NodeId, PartId, PortId, RunId};
use crate::{ErrorMessage, Key, Value};

/// An output port of a stage run: of its source, or of one of its nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Slot {
    /// An output port of the source.
    Source {
        /// The port.
        port: PortId,
    },
    /// An output port of a node.
    Node {
        /// The node.
        node: NodeId,
        /// The port.
        port: PortId,
    },
}

/// The key that all output values of a node share on a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotKey {
    /// The node.
    pub node: NodeId,
    /// The key.
    pub key: Key,
}

/// The failure record of a node on a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Which node of the stage run; `None` for its source.
    pub node: Option<NodeId>,
    /// What failed, with its causes.
    pub what: String,
}

/// A warning of a node; see [`Host::warn_n`](super::Host::warn_n).
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct NodeWarning {
    /// Which node of the stage run; `None` for its source.
    pub node: Option<NodeId>,
    /// The message.
    pub what: String,
    /// How many things it concerns; 0 if they are not counted.
    pub count: u64,
}

/// Everything about a finished frame except its values.
#[derive(Clone, Debug)]
pub struct Commit<'a> {
    /// The stage run.
    pub run: RunId,
    /// The frame.
    pub frame: &'a Frame,
    /// The key of the source's values; `None` if the source failed.
    pub source_key: Option<Key>,
    /// The keys of the nodes' values, by node index; nodes that did not run are left out.
    pub keys: &'a [SlotKey],
    /// The failures on this frame, by node index.
    pub failures: &'a [Failure],
    /// The outputs without a value although their source or node ran, in plan order.
    pub absent: &'a [Slot],
    /// The warnings, by node index. They are repeated where the values are reused.
    pub warnings: &'a [NodeWarning],
    /// Of a live run.
    pub live: Option<LiveCommit>,
}

/// A value that is in the sink's store.
#[derive(Clone, Debug)]
pub struct StoredValue<'a> {
    /// Its slot.
    pub slot: Slot,
    /// The key of what made it.
    pub key: Key,
    /// Its output port.
    pub port: &'a str,
    /// The value, if a node needed it.
    pub value: Option<Value>,
}

/// The values of a store; neighbours are read once.
///
/// # Errors
/// If the store cannot be read.
pub fn stored_values<'a>(
    store: &dyn Store,
    stored: impl Iterator<Item = &'a StoredValue<'a>>,
) -> Result<Vec<(Slot, Value)>, ErrorMessage> {
    let (there, missing): (Vec<_>, Vec<_>) = stored.partition(|stored| stored.value.is_some());
    let wanted: Vec<(Key, &str)> = missing.iter().map(|stored| (stored.key, stored.port)).collect();
    let read = store.values(&wanted)?;
    let there = there.into_iter().filter_map(|stored| Some((stored.slot, stored.value.clone()?)));
    let read = missing.into_iter().zip(read).filter_map(|(stored, value)| Some((stored.slot, value?)));
    Ok(there.chain(read).collect())
}

/// Takes the values of a run, in the order (stage run, frame, plan position, port).
///
/// A frame is written in *parts*: the sink assigns each slot to a part, workers encode a part as soon as its values
/// are there, and one thread writes the frames in order.
pub trait Sink: Send + Sync {
    /// An encoded part, ready to be written.
    type Part: Send;

    /// How many parts a frame of this stage run has.
    fn parts(&self, run: RunId) -> usize;

    /// The part a slot's values belong to; `None` if they are not taken at all.
    fn part(&self, run: RunId, slot: Slot) -> Option<PartId>;

    /// Encodes (and compresses) one part of a frame; called on workers, several at once. The frame comes with its
    /// position in the stage run. `values` are the values of the part, in plan order.
    ///
    /// # Errors
    /// If a value cannot be encoded.
    fn encode(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<Self::Part, ErrorMessage>;

    /// Writes a frame: its parts in order, then its commit record. Called on one thread, in the order of the frames.
    ///
    /// # Errors
    /// If the disk refuses.
    fn write(&self, commit: &Commit<'_>, parts: Vec<Self::Part>) -> Result<(), ErrorMessage>;

    /// Takes an aggregate value with the warnings of its node, after the frames of the stage run.
    ///
    /// # Errors
    /// If the disk refuses.
    fn once(
        &self,
        run: RunId,
        slot: Slot,
        key: &Key,
        value: &Value,
        warnings: &[NodeWarning],
    ) -> Result<(), ErrorMessage>;

    /// Whether a slot's value is kept on this frame.
    fn keeps(&self, _run: RunId, _slot: Slot, _position: FrameIndex) -> bool {
        true
    }

    /// Stored values, which need not be recomputed.
    fn store(&self) -> Option<&dyn Store> {
        None
    }

    /// As [`Sink::encode`], for a part with stored values, whose bytes may be copied if that gives the same result.
    ///
    /// # Errors
    /// If a value cannot be encoded, or the store cannot be read.
    fn encode_stored(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
        stored: &[StoredValue<'_>],
    ) -> Result<Self::Part, ErrorMessage> {
        let mut all = values.to_vec();
        if let Some(store) = self.store() {
            all.extend(stored_values(store, stored.iter())?);
        }
        // In plan order, which is the order of slots.
        all.sort_by_key(|(slot, _)| *slot);
        self.encode(run, frame, part, &all)
    }

    /// How many frames of a stage run an earlier process has written. Their values are in the store.
    fn written(&self, _run: RunId) -> usize {
        0
    }

    /// The warnings of the frames that an earlier process has written, one list per frame.
    fn recorded_warnings(&self, _run: RunId) -> Vec<Vec<NodeWarning>> {
        Vec::new()
    }

    /// The key of an aggregate value that an earlier process has written.
    fn written_aggregate(&self, _run: RunId, _slot: Slot) -> Option<Key> {
        None
    }
}
