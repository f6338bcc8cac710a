//! Brings a recording to the disk while its run goes on, so that little is left to wait for at the end.

use std::io;
use std::sync::Arc;
use std::sync::mpsc::{self, SyncSender};
use std::thread::{self, JoinHandle};

use crate::write::disk::Disk;

use depthloom_threads::look_for_room;

/// After how many bytes the disk is asked again: what is left at the end is about as much.
const STRIDE_BYTES: u64 = 16 << 20;

/// Synchronises a file's data beside its writer, which never waits for it.
pub(crate) struct EarlySync {
    file: Arc<dyn Disk>,
    /// Bytes written since the disk was last asked.
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

    /// Takes note of bytes that were written; asks the disk for them if they are enough, and it is not busy with
    /// earlier ones.
    pub(crate) fn written(&mut self, bytes: u64) {
        self.waiting += bytes;
        if self.waiting < STRIDE_BYTES {
            return;
        }
        if self.worker.is_none() {
            // Where the system gives no thread, the end waits for the disk alone.
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
    fn the_disk_is_asked_for_every_stride_and_waited_for_at_the_end() {
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
    fn what_the_disk_refused_is_told_at_the_end() {
        // A pipe's end cannot be synchronised.
        let (_reader, writer) = io::pipe().unwrap();
        let mut sync = EarlySync::new(Arc::new(File::from(std::os::fd::OwnedFd::from(writer))));
        sync.written(STRIDE_BYTES);
        assert!(sync.finish().is_err());
        sync.finish().unwrap();
    }
}
