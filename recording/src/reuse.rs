//! Values of earlier recordings, found by their cache keys and copied as stored bytes.

pub(crate) mod earlier_runs;
pub(crate) mod key_index;
pub(crate) mod stored_bytes;
pub(crate) mod stored_values;
