//! Who watches a run: progress bars, logs.

use depthloom_graphs::Frame;
use depthloom_graphs::contracts::Failure;
use depthloom_graphs::plan::{NodeId, RunId};

/// Is notified of events; every call should return at once.
pub trait Observer: Sync {
    /// A stage run starts on so many frames.
    fn stage_started(&self, run: RunId, frames: u64) {
        let _ = (run, frames);
    }

    /// A frame has been written, with its failures if it has any. Called in the order of the frames.
    fn frame_retired(&self, run: RunId, frame: &Frame, failures: &[Failure]) {
        let _ = (run, frame, failures);
    }

    /// A node tells how far a long piece of work is. Called on the node's thread.
    fn progress(&self, run: RunId, node: NodeId, done: u64, total: u64, message: &str) {
        let _ = (run, node, done, total, message);
    }

    /// A node tells of something that is no failure, for the first time; the report says how often it did. Called on the node's thread.
    fn warned(&self, run: RunId, node: Option<NodeId>, what: &str) {
        let _ = (run, node, what);
    }

    /// A node reports something that is not a problem. Called on the node's thread.
    fn info(&self, run: RunId, node: NodeId, what: &str) {
        let _ = (run, node, what);
    }

    /// A stage run is over: whole, interrupted or failed.
    fn stage_finished(&self, run: RunId) {
        let _ = run;
    }
}

/// Watches nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwatched;

impl Observer for Unwatched {}
