//! Values looked up by key.

use super::Fault;
use crate::{Key, Value};

/// A store of values by key: a recording is one.
pub trait Store: Send + Sync {
    /// What the store has of the values that a key names: all that a source or a node gave on a frame, or the once-values of a node.
    /// `None` if it does not know the key.
    ///
    /// # Errors
    /// If the store cannot be read, or what it holds is damaged.
    fn get(&self, key: &Key) -> Result<Option<Vec<Stored>>, Fault>;
}

/// What a store has of an output port; a port that it has nothing of is not listed, and its value must be made again.
#[derive(Clone, Debug)]
pub struct Stored {
    /// The output port.
    pub port: String,
    /// Its value; `None` if it is known that the port gave none.
    pub value: Option<Value>,
}
