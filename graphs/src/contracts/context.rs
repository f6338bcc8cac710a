//! The runner's services for a running node.

use std::any::{Any, TypeId};
use std::collections::HashMap;
use std::path::PathBuf;

use crate::Key;
use crate::ids::FrameIndex;

/// What the runner offers a node while it works.
pub trait Host: Sync {
    /// Whether the run is being abandoned. Long work polls this and returns [`Fault::Cancelled`](crate::Fault).
    fn cancelled(&self) -> bool;

    /// Whether the run is about to stop. Work that can be resumed stores a checkpoint and returns
    /// [`Fault::Cancelled`](crate::Fault).
    fn stopping(&self) -> bool {
        self.cancelled()
    }

    /// Warns of something that is not a failure but may spoil the values of this call, as a lower-case fragment
    /// without the frame's name (`3 pixels are not numbers`). Duplicate warnings of a node are counted. A warning is
    /// recorded with the values and repeated where they are reused, so it must be equal on every machine.
    fn warn(&self, what: &str) {
        self.warn_n(0, what);
    }

    /// As [`Host::warn`], for `count` things named in the plural (`pixels that are not numbers`). Counts are added
    /// up.
    fn warn_n(&self, _count: u64, _what: &str) {}

    /// As [`Host::warn`], for this run only: not recorded with the values (`no checkpoint can be kept`).
    fn notice(&self, what: &str) {
        self.warn(what);
    }

    /// Shows a message that is not a warning at once, as a lower-case fragment (`resuming at step 60 of 120`).
    fn info(&self, _what: &str) {}

    /// Reports the progress of a long computation.
    fn progress(&self, done: u64, total: u64, message: &str);

    /// Runs `f(0) .. f(n - 1)`, each once, on the caller's thread and on idle workers. Returns when all are done.
    /// They start in ascending order, so that one may wait for those before it.
    ///
    /// How work is cut into tiles must depend on its size only, never on [`Host::width`].
    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync));

    /// The most tiles that can run at once.
    fn width(&self) -> usize;

    /// Adds CPU time of the node's own threads, nanoseconds, to the node's timings.
    fn add_cpu_time(&self, _cpu_ns: u64) {}

    /// The cache key of the aggregate values that this call computes; `None` if it is not known.
    fn key(&self) -> Option<Key> {
        None
    }

    /// The position of this call's frame among those of its stage run, from 0. For nodes that forward calls: no
    /// result may depend on it.
    fn position(&self) -> Option<FrameIndex> {
        None
    }

    /// Whether frames arrive at their own rate, so that a frame should not wait for work that can be finished later.
    fn is_live(&self) -> bool {
        false
    }

    /// Adds what decided the outputs of this call besides its inputs to their cache key, for example that a network in
    /// training was replaced later than in a run that waits for it. A call that was not disturbed adds nothing.
    fn observe(&self, _what: Key) {}

    /// A file for checkpoints of long work, with which an interrupted run resumes. Its name is [`Host::key`]; no
    /// other process uses it until the call returns. The host removes it once the values are stored. `None`: keep no
    /// checkpoint.
    fn checkpoint(&self) -> Option<PathBuf> {
        None
    }
}

/// A host without workers: everything runs on the caller's thread. For tests and one-off calls.
#[derive(Clone, Copy, Debug, Default)]
pub struct InlineHost;

impl Host for InlineHost {
    fn cancelled(&self) -> bool {
        false
    }

    fn progress(&self, _done: u64, _total: u64, _message: &str) {}

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).for_each(f);
    }

    fn width(&self) -> usize {
        1
    }
}

/// Buffers that a worker keeps between calls, one per type.
#[derive(Default)]
pub struct Scratch(HashMap<TypeId, Box<dyn Any + Send>>);

impl Scratch {
    /// Takes the buffer of type `T`, or a fresh one. Put it back after use.
    pub fn take<T: Default + Send + 'static>(&mut self) -> Box<T> {
        self.0.remove(&TypeId::of::<T>()).and_then(|any| any.downcast().ok()).unwrap_or_default()
    }

    /// Puts a buffer back for the next call on this worker.
    pub fn put<T: Send + 'static>(&mut self, buffer: Box<T>) {
        self.0.insert(TypeId::of::<T>(), buffer);
    }
}

/// The surroundings of one call of a node.
pub struct Context<'a> {
    /// The runner.
    pub host: &'a dyn Host,
    /// This worker's buffers.
    pub scratch: &'a mut Scratch,
}

impl<'a> Context<'a> {
    /// Puts a context together.
    pub const fn new(host: &'a dyn Host, scratch: &'a mut Scratch) -> Self {
        Self { host, scratch }
    }
}
