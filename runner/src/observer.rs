//! Observers of a run: progress bars, logs.

use depthloom_graphs::Frame;
use depthloom_graphs::contracts::Failure;
use depthloom_graphs::plan::{NodeId, RunId};

use crate::live::LiveStatus;

/// Receives the events of a run. Calls should return at once.
pub trait Observer: Sync {
    /// A stage run with this many frames starts.
    fn stage_started(&self, run: RunId, frames: u64) {
        let _ = (run, frames);
    }

    /// A frame was written. Called in the order of the frames.
    fn frame_retired(&self, run: RunId, frame: &Frame, failures: &[Failure]) {
        let _ = (run, frame, failures);
    }

    /// Progress of a long computation. Called on the node's thread.
    fn progress(&self, run: RunId, node: NodeId, done: u64, total: u64, message: &str) {
        let _ = (run, node, done, total, message);
    }

    /// The first warning of its kind; the report counts them. Called on the node's thread.
    fn warned(&self, run: RunId, node: Option<NodeId>, what: &str) {
        let _ = (run, node, what);
    }

    /// A message that is not a warning. Called on the node's thread.
    fn info(&self, run: RunId, node: NodeId, what: &str) {
        let _ = (run, node, what);
    }

    /// How a live stage is doing, a few times per second.
    fn live(&self, run: RunId, status: &LiveStatus) {
        let _ = (run, status);
    }

    /// A stage run has ended: complete, interrupted or failed.
    fn stage_finished(&self, run: RunId) {
        let _ = run;
    }
}

/// Ignores all events.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwatched;

impl Observer for Unwatched {}
