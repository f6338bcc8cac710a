//! What a run did.

use depthloom_graphs::Frame;
use depthloom_graphs::plan::{NodeId, RunId};

use crate::checkpoints::Checkpoints;
use crate::live::LiveReport;
use crate::timing::Timing;
use crate::warnings::Warning;

/// What a run did.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// The stage runs that were started, in the order of the plan.
    pub stages: Vec<StageReport>,
    /// The failures that were recorded; at most [`Report::FAILURES`] of them.
    pub failures: Vec<FrameFailure>,
    /// Whether the run was interrupted: frames or stages are missing.
    pub interrupted: bool,
    /// The warnings of nodes, in plan order.
    pub warnings: Vec<Warning>,
    /// Times, by stage run and class of task.
    pub timings: Vec<Timing>,
    /// What the live stage did, if there was one.
    pub live: Option<LiveReport>,
    /// The checkpoints of aggregate nodes, to be removed when their values are safe.
    pub checkpoints: Checkpoints,
}

impl Report {
    /// The most failures that are listed; [`StageReport::failed`] counts all.
    pub const FAILURES: usize = 1000;
}

/// What a stage run did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StageReport {
    /// Frames of its source.
    pub frames: u64,
    /// Frames that were admitted.
    pub admitted: u64,
    /// Frames that were written.
    pub retired: u64,
    /// Written frames with a failure.
    pub failed: u64,
    /// The most frames in flight at once.
    pub peak_in_flight: usize,
    /// By node, written frames on which it ran; for an aggregate node, whether it ran.
    pub firings: Vec<u64>,
    /// By node, written frames on which its values were reused; for an aggregate node, whether they were.
    pub reused: Vec<u64>,
    /// Frames that an earlier process had written.
    pub resumed: u64,
    /// Reused values that were recomputed and found equal.
    pub audited: u64,
}

/// A recorded failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameFailure {
    /// The stage run.
    pub run: RunId,
    /// The frame.
    pub frame: Frame,
    /// The node; `None` for the source.
    pub node: Option<NodeId>,
    /// What failed, with its causes.
    pub what: String,
    /// The remedy.
    pub remedy: Option<String>,
}
