//! Values of earlier recordings, found by their cache keys and copied as the bytes that they are stored in.

pub(crate) mod earlier_runs;
pub(crate) mod stored_bytes;
pub(crate) mod stored_values;
