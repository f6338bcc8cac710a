//! The tap: where a run's values go besides to each other. A recording is one.

use super::{Frame, Store};
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

/// The key of one value of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotKey {
    /// Which node of the stage run; all its output ports share the key.
    pub node: NodeId,
    /// The key.
    pub key: Key,
}

/// A node that failed on a frame, kept when the run goes on: the tombstone of its values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Which node of the stage run; `None` for its source.
    pub node: Option<NodeId>,
    /// What failed, with everything beneath.
    pub what: String,
}

/// What a node told of without failing; see [`Host::warn_n`](super::Host::warn_n).
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Warned {
    /// Which node of the stage run; `None` for its source.
    pub node: Option<NodeId>,
    /// What it told.
    pub what: String,
    /// How many of the thing there were; 0 if it is none to be counted.
    pub count: u64,
}

/// All there is to say of a finished frame besides its values.
#[derive(Clone, Debug)]
pub struct Commit<'a> {
    /// The stage run.
    pub run: RunId,
    /// The frame.
    pub frame: &'a Frame,
    /// The key of the source's values; `None` if the source failed.
    pub source_key: Option<Key>,
    /// The keys of the nodes' values, by node index; nodes that did not fire are left out.
    pub keys: &'a [SlotKey],
    /// The failures on this frame, by node index.
    pub failures: &'a [Failure],
    /// The outputs that gave nothing although their source or node fired, in plan order.
    pub absent: &'a [Slot],
    /// What was told of without failing, by node index: whoever takes the values is to be told, too.
    pub warnings: &'a [Warned],
}

/// A value of a part that lies in the tap's store.
#[derive(Clone, Debug)]
pub struct StoredValue<'a> {
    /// Whose it is.
    pub slot: Slot,
    /// The key of what made it.
    pub key: Key,
    /// Its output port.
    pub port: &'a str,
    /// The value, where a node needed it.
    pub value: Option<Value>,
}

/// The values of a store; what lies together is read once.
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
/// The values of one frame are handed over in *parts*: the tap says which part a slot belongs to, workers encode the parts of
/// a frame as soon as their values are there, and one thread writes the frames in order.
pub trait Tap: Send + Sync {
    /// An encoded part, ready to be written.
    type Part: Send;

    /// How many parts a frame of this stage run has.
    fn parts(&self, run: RunId) -> usize;

    /// The part a slot's values belong to; `None` if they are not taken at all.
    fn part(&self, run: RunId, slot: Slot) -> Option<PartId>;

    /// Encodes (and compresses) one part of a frame; called on workers, several at once. With the frame comes its
    /// position among those of the stage run, from 0, whatever the source numbers them; `values` are in plan order and hold
    /// those of the part's slots that are there.
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

    /// Writes a frame: its parts in order, then its commit record. Called by one thread, in order of frames.
    ///
    /// # Errors
    /// If the disk refuses.
    fn write(&self, commit: &Commit<'_>, parts: Vec<Self::Part>) -> Result<(), ErrorMessage>;

    /// Takes a once-value, after the frames of its stage run, with what its node told of.
    ///
    /// # Errors
    /// If the disk refuses.
    fn once(&self, run: RunId, slot: Slot, key: &Key, value: &Value, warnings: &[Warned]) -> Result<(), ErrorMessage>;

    /// Whether a slot's values are kept of the frame at a position: else it makes no difference whether they are handed over.
    fn keeps(&self, _run: RunId, _slot: Slot, _position: FrameIndex) -> bool {
        true
    }

    /// Values that were made before, and need not be made again.
    fn store(&self) -> Option<&dyn Store> {
        None
    }

    /// As [`Tap::encode`], of a part of which some values lie in the store: these may be taken over as they lie there, if that gives
    /// the same bytes.
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

    /// How many frames of a stage run are written already, from the first on, by an earlier process whose work goes on. Their values
    /// are in the store.
    fn written(&self, _run: RunId) -> usize {
        0
    }

    /// What was told of on the frames that are written already, one list a frame.
    fn told(&self, _run: RunId) -> Vec<Vec<Warned>> {
        Vec::new()
    }

    /// The key of an aggregate value that is written already, as [`Tap::written`] frames are.
    fn written_aggregate(&self, _run: RunId, _slot: Slot) -> Option<Key> {
        None
    }
}
