//! Values looked up by key.

use super::Fault;
use crate::{Key, Value};

/// A store of values by key: a recording is one.
pub trait Store: Send + Sync {
    /// The value of that key, if the store has it.
    ///
    /// # Errors
    /// If the store cannot be read.
    fn get(&self, key: &Key) -> Result<Option<Value>, Fault>;
}
