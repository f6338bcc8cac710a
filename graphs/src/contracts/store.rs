//! Values looked up by key.

use super::Fault;
use crate::{Key, Value};

/// A store of values by key: recordings are one.
pub trait Store: Send + Sync {
    /// What the store has of the values that a key names, nothing decoded: all that a source or a node gave on a frame, or the once-values
    /// of a node. `None` if it does not know the key, or what it has is damaged.
    fn find(&self, key: &Key) -> Option<Vec<Held>>;

    /// The value of a port under a key; `None` if it is known that the port gave none.
    ///
    /// # Errors
    /// If the store has nothing of the port, cannot be read, or what it holds is damaged.
    fn value(&self, key: &Key, port: &str) -> Result<Option<Value>, Fault>;

    /// Where the value of a port under a key is stored, for messages: a path.
    fn origin(&self, _key: &Key, _port: &str) -> Option<String> {
        None
    }

    /// What was told of when the values of a key were made, without failing: what, and how many of it.
    fn warnings(&self, _key: &Key) -> Vec<(String, u64)> {
        Vec::new()
    }

    /// Several values at once, as [`Store::value`] gives each: what lies together is read once.
    ///
    /// # Errors
    /// As [`Store::value`].
    fn values(&self, wanted: &[(Key, &str)]) -> Result<Vec<Option<Value>>, Fault> {
        wanted.iter().map(|(key, port)| self.value(key, port)).collect()
    }
}

/// What a store has of an output port; of a port that is not listed nothing is known, and its value must be made again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Held {
    /// The output port.
    pub port: String,
    /// What of it.
    pub is: Holding,
}

/// What a store has of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Holding {
    /// The port gave a value, which was not kept.
    NotKept,
    /// It is known that the port gave none.
    Nothing,
    /// The value.
    There,
}
