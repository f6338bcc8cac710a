//! A pool of buffers: a frame's parts are megabytes, and new memory from the system costs more than filling it.

use depthloom_threads::locked;
use std::sync::Mutex;

/// The most buffers in a pool; more than the frames in flight of any window.
const MOST: usize = 64;

/// Buffers for one kind of content, which therefore have about the right size for the next use.
#[derive(Debug, Default)]
pub(crate) struct Pool(Mutex<Vec<Vec<u8>>>);

impl Pool {
    /// An empty buffer: the one used last, or a new one.
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
    /// For a finished part that waits to be written.
    pub(crate) bytes: Pool,
    /// For uncompressed records, returned at once.
    pub(crate) records: Pool,
}
