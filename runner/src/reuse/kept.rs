//! What an interrupted run left, compared with what the same run would write today: frame by frame, by cache keys, before any of it is kept.

use std::fmt;
use std::ops::ControlFlow;

use depthloom_graphs::contracts::{SlotKey, Store};
use depthloom_graphs::plan::{FrameIndex, NodeId, RunId};
use depthloom_graphs::ready::Ready;
use depthloom_graphs::{Frame, Host, Key};

use crate::reuse::foresee::{KnownStage, Preview, walk};
use crate::stage::frame_graph::StepId;

/// The frames and aggregate values that an interrupted run recorded.
pub trait KeptValues {
    /// How many frames of a stage run.
    fn frames(&self, run: RunId) -> usize;

    /// Whether the frame at a position has the id, index and time of this one.
    fn is_frame(&self, run: RunId, position: FrameIndex, frame: &Frame) -> bool;

    /// The key of the source's values; `None` if the source failed.
    fn source_key(&self, run: RunId, position: FrameIndex) -> Option<Key>;

    /// Whether the source or a node failed on the frame at a position.
    fn has_failed(&self, run: RunId, position: FrameIndex) -> bool;

    /// The keys of the nodes' values.
    fn node_keys(&self, run: RunId, position: FrameIndex) -> &[SlotKey];

    /// The keys of the aggregate values of a stage run, by node.
    fn aggregates(&self, run: RunId) -> Vec<(NodeId, Key)>;
}

/// Why what an interrupted run recorded is not what the same run would record today.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outdated {
    /// The source has another frame at a position, or none.
    Frame {
        /// The stage.
        stage: String,
        /// From 0.
        position: FrameIndex,
        /// The frame's id today; `None` if the source has fewer frames.
        today: Option<String>,
    },
    /// The source has more frames than those after which the stage ended.
    MoreFrames {
        /// The stage.
        stage: String,
        /// How many frames the stage had.
        recorded: usize,
        /// How many it has today.
        today: usize,
    },
    /// The source or a node failed on a frame. A failure is not a result: today it may succeed.
    Failed {
        /// The stage.
        stage: String,
        /// The frame's id.
        frame: String,
    },
    /// The source's data of a frame changed.
    Data {
        /// The stage.
        stage: String,
        /// The frame's id.
        frame: String,
    },
    /// A node's cache key on a frame is another one.
    Node {
        /// The stage.
        stage: String,
        /// The node.
        node: String,
        /// The frame's id.
        frame: String,
    },
    /// The cache key of a node's aggregate values is another one.
    Aggregate {
        /// The stage.
        stage: String,
        /// The node.
        node: String,
    },
}

impl fmt::Display for Outdated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frame { stage, position, today: Some(frame) } => {
                write!(f, "frame {} of stage `{stage}` is `{frame}` today, and was another frame", position.0 + 1)
            }
            Self::Frame { stage, position, today: None } => {
                write!(f, "stage `{stage}` has {position} frames today, and had more")
            }
            Self::MoreFrames { stage, recorded, today } => {
                write!(f, "stage `{stage}` has {today} frames today, and ended after {recorded}")
            }
            Self::Failed { stage, frame } => write!(f, "frame `{frame}` of stage `{stage}` failed then"),
            Self::Data { stage, frame } => write!(f, "the data of frame `{frame}` of stage `{stage}` changed"),
            Self::Node { stage, node, frame } => {
                write!(
                    f,
                    "what node `{stage}.{node}` computes frame `{frame}` from changed, or its recorded values are damaged"
                )
            }
            Self::Aggregate { stage, node } => {
                write!(
                    f,
                    "what node `{stage}.{node}` computes its aggregate values from changed, or they are incomplete"
                )
            }
        }
    }
}

/// Compares what an interrupted run recorded, and `store` has, with what a run would record today.
///
/// # Errors
/// Where the plan contradicts itself or the nodes built, in words.
pub fn outdated(
    ready: &Ready,
    store: &dyn Store,
    kept: &dyn KeptValues,
    host: &dyn Host,
) -> Result<Option<Outdated>, String> {
    let tap = Preview { plan: &ready.plan, store };
    let mut found = None;
    walk(ready, &tap, host, |stage| {
        found = outdated_in(ready, stage, kept);
        if found.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    Ok(found)
}

fn outdated_in(ready: &Ready, known: &KnownStage<'_>, kept: &dyn KeptValues) -> Option<Outdated> {
    let (run, planned) = (known.run, &ready.plan.runs[known.run]);
    let stage = || planned.stage.clone();
    for position in FrameIndex::all(kept.frames(run)) {
        let Some(frame) = known.source.frames().get(position.0) else {
            return Some(Outdated::Frame { stage: stage(), position, today: None });
        };
        let id = || frame.id.to_string();
        if !kept.is_frame(run, position, frame) {
            return Some(Outdated::Frame { stage: stage(), position, today: Some(id()) });
        }
        let Some(key) = kept.source_key(run, position).filter(|_| !kept.has_failed(run, position)) else {
            return Some(Outdated::Failed { stage: stage(), frame: id() });
        };
        if known.source.key(position).ok() != Some(key) {
            return Some(Outdated::Data { stage: stage(), frame: id() });
        }
        let keys = known.reuse.keys(known.graph, position, key);
        let changed =
            kept.node_keys(run, position).iter().find(|kept| keys[StepId::of_node(kept.node)] != Some(kept.key));
        if let Some(changed) = changed {
            let node = planned.nodes[changed.node].name.clone();
            return Some(Outdated::Node { stage: stage(), node, frame: id() });
        }
    }
    // Aggregate values and later stages are written behind the last frame of a stage.
    let (recorded, today) = (kept.frames(run), known.source.frames().len());
    let is_written = |later: RunId| later > run && kept.frames(later) > 0 || !kept.aggregates(later).is_empty();
    if recorded < today && RunId::all(ready.plan.runs.len()).skip(run.0).any(is_written) {
        return Some(Outdated::MoreFrames { stage: stage(), recorded, today });
    }
    // One whose key is not known before the run is compared when it is written.
    let mut aggregates = kept.aggregates(run).into_iter();
    let changed = aggregates.find(|(node, key)| known.aggregates.get(node).is_some_and(|today| today != key));
    changed.map(|(node, _)| Outdated::Aggregate { stage: stage(), node: planned.nodes[node].name.clone() })
}
