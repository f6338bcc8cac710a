//! What a run did.

use depthloom_graphs::Frame;
use depthloom_graphs::plan::{NodeId, RunId};

use crate::checkpoints::Checkpoints;
use crate::timing::Timing;
use crate::warnings::Warning;

/// What a run did.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// The stage runs that were started, in the order of the plan.
    pub stages: Vec<StageReport>,
    /// The failures that were kept as tombstones, each where it arose; at most [`Report::FAILURES`] of them.
    pub failures: Vec<FrameFailure>,
    /// Whether the run was interrupted: frames or stages are missing.
    pub interrupted: bool,
    /// The warnings of nodes, in plan order.
    pub warnings: Vec<Warning>,
    /// Where the time went, by stage run and class of task.
    pub timings: Vec<Timing>,
    /// What once-nodes put down on the way: to be removed when what they gave is safe.
    pub checkpoints: Checkpoints,
}

impl Report {
    /// The most failures that are listed; [`StageReport::failed`] counts all frames that failed.
    pub const FAILURES: usize = 1000;
}

/// What a stage run did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StageReport {
    /// Frames its source has.
    pub frames: u64,
    /// Frames that were let in.
    pub admitted: u64,
    /// Frames that were written.
    pub retired: u64,
    /// Frames among them on which something failed.
    pub failed: u64,
    /// The most frames in flight at once.
    pub peak_in_flight: usize,
    /// On how many of the frames written each node fired (of a once-node: whether it did).
    pub firings: Vec<u64>,
    /// On how many of them each node need not fire, for its values were in the tap's store (of a once-node: whether they were).
    pub reused: Vec<u64>,
    /// How many frames an earlier process had written.
    pub resumed: u64,
    /// How many reused values were recomputed and found equal.
    pub audited: u64,
}

/// A failure kept as a tombstone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameFailure {
    /// The stage run.
    pub run: RunId,
    /// The frame.
    pub frame: Frame,
    /// The node; `None` for the source.
    pub node: Option<NodeId>,
    /// What failed, with everything beneath.
    pub what: String,
    /// What the person can do about it.
    pub remedy: Option<String>,
}
