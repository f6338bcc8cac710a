//! Synchronises a recording with the disk during its run, so that the end of the run waits for little.

use std::io;
use std::sync::Arc;
use std::sync::mpsc::{self, SyncSender};
use std::thread::{self, JoinHandle};

use crate::write::disk::Disk;

use depthloom_threads::look_for_room;

/// The number of written bytes after which the disk is synchronised again: about as much is left at the end.
const STRIDE_BYTES: u64 = 16 << 20;

/// Synchronises a file's data on another thread; the writer never waits for it.
pub(crate) struct EarlySync {
    file: Arc<dyn Disk>,
    /// Bytes written since the last request.
    waiting: u64,
    worker: Option<Worker>,
}

struct Worker {
    requests: SyncSender<()>,
    thread: JoinHandle<io::Result<()>>,
}

impl EarlySync {
    pub(crate) const fn new(file: Arc<dyn Disk>) -> Self {
        Self { file, waiting: 0, worker: None }
    }

    /// Counts written bytes, and requests a synchronisation if they are enough and no earlier request is pending.
    pub(crate) fn written(&mut self, bytes: u64) {
        self.waiting += bytes;
        if self.waiting < STRIDE_BYTES {
            return;
        }
        if self.worker.is_none() {
            // If the system refuses a thread, all bytes are synchronised at the end.
            self.worker = Worker::start(Arc::clone(&self.file)).ok();
        }
        if self.worker.as_ref().is_some_and(|worker| worker.requests.try_send(()).is_ok()) {
            self.waiting = 0;
        }
    }

    pub(crate) fn finish(&mut self) -> io::Result<()> {
        let Some(Worker { requests, thread }) = self.worker.take() else { return Ok(()) };
        drop(requests);
        thread.join().unwrap_or_else(|_| Err(io::Error::other("the thread that synchronised it panicked")))
    }
}

impl Worker {
    fn start(file: Arc<dyn Disk>) -> io::Result<Self> {
        let (requests, asked) = mpsc::sync_channel(1);
        let synchronise = move || asked.into_iter().try_for_each(|()| file.sync_data());
        let thread = thread::Builder::new().name("depthloom-disk".to_owned()).stack_size(64 << 10);
        let thread = look_for_room().and_then(|()| thread.spawn(synchronise))?;
        Ok(Self { requests, thread })
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;

    #[test]
    fn every_stride_is_synchronised_and_the_end_waits() {
        let file = Arc::new(tempfile::tempfile().unwrap());
        let mut sync = EarlySync::new(file);
        sync.written(STRIDE_BYTES - 1);
        assert!(sync.worker.is_none(), "a small file needs no thread");
        sync.written(1);
        assert!(sync.worker.is_some());
        assert_eq!(sync.waiting, 0);
        sync.finish().unwrap();
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_failed_synchronisation_is_reported_at_the_end() {
        // A pipe cannot be synchronised.
        let (_reader, writer) = io::pipe().unwrap();
        let mut sync = EarlySync::new(Arc::new(File::from(std::os::fd::OwnedFd::from(writer))));
        sync.written(STRIDE_BYTES);
        assert!(sync.finish().is_err());
        sync.finish().unwrap();
    }
}
