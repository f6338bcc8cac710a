//! How a plan is run.

use std::path::PathBuf;

use crate::share::Share;

/// How a plan is run. Results do not depend on it, except which frames are missing after a failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Threads that work at once, with those that help with tiles; without the thread that writes.
    pub workers: usize,
    /// Frames in flight; by default two more than workers.
    pub window: Option<usize>,
    /// Whether the run continues after a failing frame, with failure records.
    pub keep_going: bool,
    /// The folder for checkpoints of aggregate nodes; see [`Host::checkpoint`](depthloom_graphs::Host::checkpoint).
    pub checkpoints: Option<PathBuf>,
    /// Which reused values are recomputed and compared.
    pub audit: Audit,
    /// What this process computes, if other processes compute the rest.
    pub share: Option<Share>,
}

/// Which reused values are recomputed and compared with the stored ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Audit {
    /// Every reused value, aggregate values such as trained networks included.
    All,
    /// One frame in fifty, chosen at random, and at least one value of every reused node that works frame by frame.
    #[default]
    Sample,
    /// No value.
    None,
}

impl Default for Options {
    /// One worker per core that this process may use.
    fn default() -> Self {
        Self {
            workers: depthloom_threads::core_count(),
            window: None,
            keep_going: false,
            checkpoints: None,
            audit: Audit::default(),
            share: None,
        }
    }
}

impl Options {
    pub(crate) fn workers(&self) -> usize {
        self.workers.max(1)
    }

    /// By default one for every worker, one being read and one being written.
    pub(crate) fn window(&self) -> usize {
        self.window.unwrap_or(self.workers() + 2).max(1)
    }
}
