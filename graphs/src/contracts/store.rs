//! Stored values by cache key.

use super::Fault;
use crate::{Key, Value};

/// A store of values by key: recordings are one.
pub trait Store: Send + Sync {
    /// Which values the store has under a key, without decoding them. `None` if the key is unknown or its values are
    /// damaged.
    fn find(&self, key: &Key) -> Option<Vec<StoredPort>>;

    /// The value of a port; `None` if the port gave none.
    ///
    /// # Errors
    /// If the store has nothing of the port, cannot be read, or is damaged.
    fn value(&self, key: &Key, port: &str) -> Result<Option<Value>, Fault>;

    /// The path of the recording that stores a value, for messages.
    fn origin(&self, _key: &Key, _port: &str) -> Option<String> {
        None
    }

    /// The warnings of the computation that made the values of a key, with counts.
    fn warnings(&self, _key: &Key) -> Vec<(String, u64)> {
        Vec::new()
    }

    /// Several values at once, as [`Store::value`]; neighbours are read once.
    ///
    /// # Errors
    /// As [`Store::value`].
    fn values(&self, wanted: &[(Key, &str)]) -> Result<Vec<Option<Value>>, Fault> {
        wanted.iter().map(|(key, port)| self.value(key, port)).collect()
    }
}

/// What a store has of an output port. Nothing is known of a port that is not listed: its value must be recomputed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredPort {
    /// The output port.
    pub port: String,
    /// Whether it has the value.
    pub state: StoredState,
}

/// What a store has of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum StoredState {
    /// A value that was not kept.
    NotKept,
    /// The port gave no value.
    Absent,
    /// A stored value.
    Stored,
}
