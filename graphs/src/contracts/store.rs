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

    /// What was told of when the values of a key were made, without failing: what, and how many of it.
    fn warnings(&self, _key: &Key) -> Vec<(String, u64)> {
        Vec::new()
    }

    /// All values of a key, by port; `None` if the store does not know the key.
    ///
    /// # Errors
    /// If the store cannot be read, or what it holds is damaged.
    fn get(&self, key: &Key) -> Result<Option<Vec<Stored>>, Fault> {
        let Some(held) = self.find(key) else { return Ok(None) };
        let read = |held: Held| {
            let value = if held.is_there { self.value(key, &held.port)? } else { None };
            Ok(Stored { port: held.port, value })
        };
        held.into_iter().map(read).collect::<Result<_, _>>().map(Some)
    }
}

/// What a store has of an output port; a port that it has nothing of is not listed, and its value must be made again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Held {
    /// The output port.
    pub port: String,
    /// Whether the port gave a value, which is there; else it is known that it gave none.
    pub is_there: bool,
}

/// A value of a store.
#[derive(Clone, Debug)]
pub struct Stored {
    /// The output port.
    pub port: String,
    /// Its value; `None` if it is known that the port gave none.
    pub value: Option<Value>,
}
