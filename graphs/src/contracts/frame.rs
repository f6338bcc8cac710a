//! One instant of a source.

use std::sync::Arc;

/// One instant of a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// The source's own name for it, e.g. `000150_10`.
    pub id: Arc<str>,
    /// Its index in the source, counted before any selection.
    pub index: u64,
    /// The data set's time, or index x 100 ms; nanoseconds.
    pub time_ns: u64,
}

impl Frame {
    /// A frame of a source without timestamps: index x 100 ms.
    #[must_use]
    pub fn at_10_hz(id: impl Into<Arc<str>>, index: u64) -> Self {
        Self { id: id.into(), index, time_ns: index * 100_000_000 }
    }
}
