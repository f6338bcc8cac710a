//! Compares an interrupted run with what the same run would record today: frame by frame, by cache keys, before
//! anything is recorded.

use std::ops::ControlFlow;

use depthloom_graphs::contracts::{SlotKey, Store};
use depthloom_graphs::plan::{FrameIndex, NodeId, RunId};
use depthloom_graphs::ready::Ready;
use depthloom_graphs::{ErrorMessage, Frame, Host, Key};

use crate::reuse::foresee::{KnownStage, Preview, walk};
use crate::share::Share;
use crate::stage::frame_graph::StepId;

/// The frames and aggregate values that an interrupted run recorded.
pub trait RecordedValues {
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

/// Why the frames and values that an interrupted run recorded, which `store` has, are not what a run would record
/// today; with `share`, what it would record of that share. `None` if they are.
///
/// # Errors
/// If the plan contradicts itself.
pub fn outdated(
    ready: &Ready,
    store: &dyn Store,
    recorded: &dyn RecordedValues,
    host: &dyn Host,
    share: Option<&Share>,
) -> Result<Option<String>, ErrorMessage> {
    let sink = Preview { plan: &ready.plan, store };
    let mut found = None;
    walk(ready, &sink, host, share, |stage| {
        found = outdated_in(ready, stage, recorded);
        if found.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    Ok(found)
}

fn outdated_in(ready: &Ready, known: &KnownStage<'_>, recorded: &dyn RecordedValues) -> Option<String> {
    let (run, planned, range) = (known.run, &ready.plan.runs[known.run], &known.range);
    let stage = &planned.stage;
    for position in FrameIndex::all(recorded.frames(run)) {
        let today = FrameIndex(range.start + position.0);
        let Some(frame) = known.source.frames().get(today.0).filter(|_| range.contains(&today.0)) else {
            return Some(format!("stage `{stage}` has {position} frames today, and had more"));
        };
        let id = &frame.id;
        if !recorded.is_frame(run, position, frame) {
            let number = today.0 + 1;
            return Some(format!("frame {number} of stage `{stage}` is `{id}` today, and was another frame"));
        }
        // A failure is not a result: today it may succeed.
        let Some(key) = recorded.source_key(run, position).filter(|_| !recorded.has_failed(run, position)) else {
            return Some(format!("frame `{id}` of stage `{stage}` failed then"));
        };
        if known.source.key(today).ok() != Some(key) {
            return Some(format!("the data of frame `{id}` of stage `{stage}` changed"));
        }
        let keys = known.reuse.keys(known.graph, today, key);
        let mut node_keys = recorded.node_keys(run, position).iter();
        if let Some(changed) = node_keys.find(|stored| keys[StepId::of_node(stored.node)] != Some(stored.key)) {
            let node = &planned.nodes[changed.node].name;
            return Some(format!(
                "what node `{stage}.{node}` computes frame `{id}` from changed, or its recorded values are damaged"
            ));
        }
    }
    // Aggregate values and later stages are written after the last frame of a stage.
    let (then, today) = (recorded.frames(run), range.len());
    let is_written = |later: RunId| later > run && recorded.frames(later) > 0 || !recorded.aggregates(later).is_empty();
    if then < today && RunId::all(ready.plan.runs.len()).skip(run.0).any(is_written) {
        return Some(format!("stage `{stage}` has {today} frames today, and ended after {then}"));
    }
    // One whose key is not known before the run is compared when it is written.
    let mut aggregates = recorded.aggregates(run).into_iter();
    let (node, _) = aggregates.find(|(node, key)| known.aggregates.get(node).is_some_and(|today| today != key))?;
    let node = &planned.nodes[node].name;
    Some(format!("what node `{stage}.{node}` computes its aggregate values from changed, or they are incomplete"))
}
