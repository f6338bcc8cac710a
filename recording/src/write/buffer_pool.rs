//! Buffers used again: a frame's parts are megabytes, and asking the system for fresh memory costs more than filling
//! it.

use depthloom_threads::locked;
use std::sync::Mutex;

/// As many buffers as are kept for later; more than any window has frames in flight.
const MOST: usize = 64;

/// Buffers that were used for one kind of content, and so are of about the right size for the next.
#[derive(Debug, Default)]
pub(crate) struct Pool(Mutex<Vec<Vec<u8>>>);

impl Pool {
    /// An empty buffer, the one last used if there is one.
    pub(crate) fn take(&self) -> Vec<u8> {
        locked(&self.0).pop().unwrap_or_default()
    }

    pub(crate) fn put(&self, mut buffer: Vec<u8>) {
        buffer.clear();
        let mut buffers = locked(&self.0);
        if buffers.len() < MOST && buffer.capacity() > 0 {
            buffers.push(buffer);
        }
    }
}

/// The buffers of one part of a stage run's frames.
#[derive(Debug, Default)]
pub(crate) struct PartPools {
    /// For the finished part, which waits to be written.
    pub(crate) bytes: Pool,
    /// For what is to be compressed, given back at once.
    pub(crate) records: Pool,
}
