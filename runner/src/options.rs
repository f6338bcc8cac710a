//! How a plan is run, as opposed to what is run.

use std::num::NonZeroUsize;
use std::path::PathBuf;

/// How a plan is run; results do not depend on any of it, but for which frames are missing after a failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// How many threads work at once, those that help with tiles included. The thread that writes is not among them.
    pub workers: usize,
    /// How many frames may be in flight; two more than workers if not given.
    pub window: Option<usize>,
    /// Whether a failing frame leaves tombstones and the run goes on, instead of ending there.
    pub keep_going: bool,
    /// Where once-nodes put down checkpoints; see [`Host::checkpoint`](depthloom_graphs::Host::checkpoint).
    pub checkpoints: Option<PathBuf>,
    /// How much of what is reused is recomputed and compared.
    pub audit: Audit,
}

/// How much of what a run reuses is recomputed and compared with what is stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Audit {
    /// Every reused value, aggregate values such as trained networks included.
    All,
    /// One frame in fifty, chosen at random, and at least one value of every reused node that works frame by frame.
    #[default]
    Sample,
    /// Nothing.
    None,
}

impl Default for Options {
    /// As many workers as the machine has cores.
    fn default() -> Self {
        let workers = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
        Self { workers, window: None, keep_going: false, checkpoints: None, audit: Audit::default() }
    }
}

impl Options {
    /// At least one worker.
    pub(crate) fn workers(&self) -> usize {
        self.workers.max(1)
    }

    /// At least one frame. By default one for every worker, one being read and one being written.
    pub(crate) fn window(&self) -> usize {
        self.window.unwrap_or(self.workers() + 2).max(1)
    }
}
