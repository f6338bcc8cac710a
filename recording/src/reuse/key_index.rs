//! Which recordings have the values of a cache key, and where: one table for any number of recordings.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use depthloom_graphs::Key;
use depthloom_graphs::plan::{FrameIndex, NodeId, RunId};

use crate::read::recording::{Recording, StoredValues};

/// Where the values of one cache key are stored. Only a [`KeyIndex`] creates a place, and stored bytes can be read only
/// by a place. So the key of stored bytes is always known, and topic, node, variant and position never decide which
/// bytes are read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct KeyedPlace {
    key: Key,
    values: StoredValues,
}

impl KeyedPlace {
    /// The key that the values are stored under.
    pub(crate) const fn key(&self) -> Key {
        self.key
    }

    pub(crate) const fn values(&self) -> StoredValues {
        self.values
    }
}

/// The places of all keys of some recordings.
///
/// Per key it needs a table entry of 21 bytes, and 20 bytes for each recording with the key; up to twice as much where
/// table and list have grown in advance.
#[derive(Debug)]
pub(crate) struct KeyIndex {
    /// By key, the index of its place in the first recording.
    first: HashMap<Key, u32>,
    places: Vec<StoredPlace>,
}

/// A place in one of the recordings, with small numbers: there are millions of them.
#[derive(Clone, Copy, Debug)]
struct StoredPlace {
    recording: u32,
    run: u32,
    /// [`NONE`] for aggregate values.
    position: u32,
    /// [`NONE`] for the values of a source.
    node: u32,
    /// The index of the place of the same key in a later recording, or [`NONE`].
    next: u32,
}

const NONE: u32 = u32::MAX;

impl KeyIndex {
    /// The places in recordings. Within a recording, a key has one place: that of an aggregate value, or the first one.
    pub(crate) fn new<'a>(recordings: impl DoubleEndedIterator<Item = &'a Recording> + ExactSizeIterator) -> Self {
        let mut index = Self { first: HashMap::new(), places: Vec::new() };
        // The last recording comes first, so that each place is put before those of later recordings.
        for (number, recording) in recordings.enumerate().rev() {
            recording.each_keyed_place(|key, values| {
                // A place that does not fit is not found, and its values are recomputed.
                if let Some(place) = StoredPlace::new(number, values) {
                    index.add(key, place);
                }
            });
        }
        index
    }

    fn add(&mut self, key: Key, place: StoredPlace) {
        let Some(number) = u32::try_from(self.places.len()).ok().filter(|number| *number != NONE) else { return };
        match self.first.entry(key) {
            Entry::Vacant(entry) => {
                entry.insert(number);
                self.places.push(place);
            }
            Entry::Occupied(mut entry) => {
                let earlier = &mut self.places[*entry.get() as usize];
                if earlier.recording != place.recording {
                    self.places.push(StoredPlace { next: entry.insert(number), ..place });
                } else if place.position == NONE {
                    *earlier = StoredPlace { next: earlier.next, ..place };
                }
            }
        }
    }

    /// The places of a key, with the number of the recording, in order.
    pub(crate) fn places(&self, key: &Key) -> impl Iterator<Item = (usize, KeyedPlace)> {
        let key = *key;
        let first = self.first.get(&key).map(|number| self.places[*number as usize]);
        let next = |place: &StoredPlace| (place.next != NONE).then(|| self.places[place.next as usize]);
        let places = std::iter::successors(first, next);
        places.map(move |place| (place.recording as usize, KeyedPlace { key, values: place.values() }))
    }
}

impl StoredPlace {
    /// `None` if a number is too large.
    fn new(recording: usize, values: StoredValues) -> Option<Self> {
        let small = |number: usize| u32::try_from(number).ok().filter(|number| *number != NONE);
        let (run, position, node) = match values {
            StoredValues::Frame { run, position, node } => (run, small(position.0)?, node),
            StoredValues::Once { run, node } => (run, NONE, Some(node)),
        };
        let node = node.map_or(Some(NONE), |node| small(node.0))?;
        Some(Self { recording: small(recording)?, run: small(run.0)?, position, node, next: NONE })
    }

    fn values(&self) -> StoredValues {
        let (run, node) = (RunId(self.run as usize), NodeId(self.node as usize));
        match self.position {
            NONE => StoredValues::Once { run, node },
            position => {
                let node = (self.node != NONE).then_some(node);
                StoredValues::Frame { run, position: FrameIndex(position as usize), node }
            }
        }
    }
}
