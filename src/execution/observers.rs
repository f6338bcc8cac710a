//! Two observers of one run.

use depthloom_graphs::Frame;
use depthloom_graphs::contracts::Failure;
use depthloom_graphs::plan::{NodeId, RunId};
use depthloom_runner::Observer;

pub(super) struct Both<'a>(pub(super) &'a dyn Observer, pub(super) &'a dyn Observer);

impl Observer for Both<'_> {
    fn stage_started(&self, run: RunId, frames: u64) {
        self.0.stage_started(run, frames);
        self.1.stage_started(run, frames);
    }

    fn frame_retired(&self, run: RunId, frame: &Frame, failures: &[Failure]) {
        self.0.frame_retired(run, frame, failures);
        self.1.frame_retired(run, frame, failures);
    }

    fn progress(&self, run: RunId, node: NodeId, done: u64, total: u64, message: &str) {
        self.0.progress(run, node, done, total, message);
        self.1.progress(run, node, done, total, message);
    }

    fn warned(&self, run: RunId, node: Option<NodeId>, what: &str) {
        self.0.warned(run, node, what);
        self.1.warned(run, node, what);
    }

    fn info(&self, run: RunId, node: NodeId, what: &str) {
        self.0.info(run, node, what);
        self.1.info(run, node, what);
    }

    fn stage_finished(&self, run: RunId) {
        self.0.stage_finished(run);
        self.1.stage_finished(run);
    }
}
