//! What a node may ask of whoever runs it.

use std::any::{Any, TypeId};
use std::collections::HashMap;
use std::path::PathBuf;

use crate::Key;
use crate::ids::FrameIndex;

/// What the runner offers a node while it works.
pub trait Host: Sync {
    /// Whether the run is being abandoned; long work checks this now and then and returns [`Fault::Cancelled`](crate::Fault).
    fn cancelled(&self) -> bool;

    /// Whether the run is asked to end soon: long work that can be taken up again puts down where it is and returns
    /// [`Fault::Cancelled`](crate::Fault). Work that cannot goes on.
    fn stopping(&self) -> bool {
        self.cancelled()
    }

    /// Warns of something in this call that is not a failure but may spoil what is computed from its values, as a lower-case fragment
    /// without the frame's name (`3 pixels are not numbers`). Equal warnings of a node are counted, not repeated. A warning is recorded with
    /// the values and reported again where they are reused: it must be equal on every machine. See [`Host::notice`].
    fn warn(&self, what: &str) {
        self.warn_n(0, what);
    }

    /// As [`Host::warn`], of `count` things named in the plural (`pixels that are not numbers`): the counts are added up.
    fn warn_n(&self, _count: u64, _what: &str) {}

    /// As [`Host::warn`], of this run alone, and not of the values that it gives (`no checkpoint can be kept`).
    fn notice(&self, what: &str) {
        self.warn(what);
    }

    /// Shows a message that is not a warning at once, as a lower-case fragment (`resuming at step 60 of 120`).
    fn info(&self, _what: &str) {}

    /// Reports the progress of a long computation.
    fn progress(&self, done: u64, total: u64, message: &str);

    /// Runs `f(0) .. f(n - 1)`, each once: the caller works, idle workers help. Returns when all are done. They are begun in
    /// ascending order, so that one may wait for those before it.
    ///
    /// How the work is cut into tiles must depend on its size only, never on [`Host::width`].
    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync));

    /// How many tiles could run at once at best.
    fn width(&self) -> usize;

    /// Adds CPU time of the node's own threads, nanoseconds, to the node's timings.
    fn add_cpu_time(&self, _cpu_ns: u64) {}

    /// Names what this call gives: the key of a once-node's values. `None` where no key is known, as outside of a run.
    fn key(&self) -> Option<Key> {
        None
    }

    /// The position of the frame that this call is about among those of its stage run, from 0; `None` where it is about none. For whoever passes
    /// calls on to somewhere else. No result may depend on it: those of pure nodes are taken again wherever their inputs are equal.
    fn position(&self) -> Option<FrameIndex> {
        None
    }

    /// A file where long work puts down where it is, now and then and at its end, so that a run begun again after a kill takes it
    /// up there. Its name is [`Host::key`]; nobody else has it until the call returns. The host removes it when what the call
    /// gave is safe. `None`: nothing is kept, for nobody asked for it or another process is at the same work.
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

/// Buffers that a worker keeps between calls, one a type.
#[derive(Default)]
pub struct Scratch(HashMap<TypeId, Box<dyn Any + Send>>);

impl Scratch {
    /// Takes the buffer of type `T`, or a fresh one. Put it back after use.
    #[must_use]
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
    #[must_use]
    pub const fn new(host: &'a dyn Host, scratch: &'a mut Scratch) -> Self {
        Self { host, scratch }
    }
}
