//! What a run would reuse and compute, found by cache keys alone.

use std::collections::{BTreeMap, HashMap};
use std::ops::{ControlFlow, Range};

use depthloom_graphs::contracts::{Commit, Contract, ErrorMessage, NodeWarning, Sink, Slot, Store};
use depthloom_graphs::plan::{FrameIndex, NodeId, NodeRef, Origin, PartId, Plan, PlannedOutput, RunId};
use depthloom_graphs::ready::{Ready, ReadyRun};
use depthloom_graphs::{Frame, Host, Key, Rate, Source, Value, ValueType, value_keys};

use crate::aggregate_values::{AggregateState, AggregateValue, AggregateValues, inputs_of};
use crate::reuse::{Reuse, StepAction, aggregate_values};
use crate::share::Share;
use crate::stage::frame_graph::{FrameGraph, StepId};

/// What a run would do with a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Foreseen {
    /// Frames on which it would run; for an aggregate node, whether it would.
    pub fires: u64,
    /// Frames on which its values would be reused.
    pub taken: u64,
    /// Frames on which it would run although the store knows them: for another frame, or for a value that was not
    /// recorded.
    pub known: u64,
}

/// A sink that takes what a plan records, and stores nothing.
pub(crate) struct Preview<'a> {
    pub(crate) plan: &'a Plan,
    pub(crate) store: &'a dyn Store,
}

impl Preview<'_> {
    fn output(&self, run: RunId, slot: Slot) -> &PlannedOutput {
        self.plan.runs[run].output(slot)
    }
}

impl Sink for Preview<'_> {
    type Part = ();

    fn parts(&self, _run: RunId) -> usize {
        1
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        let output = self.output(run, slot);
        (output.recorded && output.port.rate == Rate::Frame).then_some(PartId(0))
    }

    fn encode(&self, _: RunId, _: (FrameIndex, &Frame), _: PartId, _: &[(Slot, Value)]) -> Result<(), ErrorMessage> {
        Ok(())
    }

    fn write(&self, _: &Commit<'_>, _: Vec<()>) -> Result<(), ErrorMessage> {
        Ok(())
    }

    fn once(&self, _: RunId, _: Slot, _: &Key, _: &Value, _: &[NodeWarning]) -> Result<(), ErrorMessage> {
        Ok(())
    }

    fn keeps(&self, run: RunId, slot: Slot, position: FrameIndex) -> bool {
        let is_of_scores = self.output(run, slot).port.value_type == ValueType::Scores;
        (position.0 as u64).is_multiple_of(self.plan.record.every.max(1)) || is_of_scores
    }

    fn store(&self) -> Option<&dyn Store> {
        Some(self.store)
    }
}

/// What a run would do with every node, by stage run and node. Reads the files of frames for their keys, and decodes
/// nothing.
///
/// # Errors
/// If the plan contradicts itself.
pub fn foresee(ready: &Ready, store: &dyn Store, host: &dyn Host) -> Result<Vec<Vec<Foreseen>>, ErrorMessage> {
    let sink = Preview { plan: &ready.plan, store };
    let mut foreseen = Vec::with_capacity(ready.runs.len());
    walk(ready, &sink, host, None, |stage| {
        let mut nodes = stage.nodes.clone();
        for position in FrameIndex::all(stage.source.frames().len()) {
            let Ok(key) = stage.source.key(position) else { continue };
            let frame = stage.reuse.plan(stage.graph, &sink, position, key);
            for (id, node) in NodeId::enumerate(&mut nodes) {
                let step = StepId::of_node(id);
                let runs = frame.steps[step] == StepAction::Run;
                node.fires += u64::from(runs);
                node.known += u64::from(runs && frame.is_known(step));
                node.taken += u64::from(matches!(frame.steps[step], StepAction::Reuse(..)));
            }
        }
        foreseen.push(nodes);
        ControlFlow::Continue(())
    })?;
    Ok(foreseen)
}

/// A stage run whose cache keys are known as far as the store has values.
pub(crate) struct KnownStage<'w> {
    pub(crate) run: RunId,
    pub(crate) source: &'w dyn Source,
    /// The frames that are processed.
    pub(crate) range: Range<usize>,
    pub(crate) graph: &'w FrameGraph,
    pub(crate) reuse: &'w Reuse<'w>,
    /// By node; of aggregate nodes only.
    nodes: Vec<Foreseen>,
    /// The keys of stored aggregate values.
    pub(crate) aggregates: BTreeMap<NodeId, Key>,
}

/// Derives the cache keys of a plan's stage runs in order, without running a node.
pub(crate) fn walk(
    ready: &Ready,
    sink: &Preview<'_>,
    host: &dyn Host,
    share: Option<&Share>,
    mut visit: impl FnMut(&KnownStage<'_>) -> ControlFlow<()>,
) -> Result<(), ErrorMessage> {
    let Ready { plan, runs, files, .. } = ready;
    let mut values = AggregateValues::new(files.clone());
    for (run, ReadyRun { source, .. }) in RunId::enumerate(runs) {
        let planned = &plan.runs[run];
        let (mut nodes, mut aggregates) = (vec![Foreseen::default(); planned.nodes.len()], BTreeMap::new());
        once(plan, run, (sink.store, share), &mut values, (&mut nodes, &mut aggregates), &HashMap::new());
        let range = Share::frames(share, run, source.as_ref());
        let omitted = share.map(|share| share.omitted(run, planned, &range, &values)).unwrap_or_default();
        let graph = FrameGraph::new(run, planned, sink, &omitted, |from| match values.find(from) {
            AggregateState::Pending => AggregateState::There(pending(from)),
            known => known,
        })?;
        let Some(reuse) = Reuse::new(run, planned, &graph, source.as_ref(), sink, host, range.start) else {
            continue;
        };
        let finished = NodeId::enumerate(&reuse.finished).filter_map(|(node, known)| Some((node, known.as_ref()?)));
        let finished = finished.map(|(node, known)| (node, (known.key, known.values.clone()))).collect();
        once(plan, run, (sink.store, share), &mut values, (&mut nodes, &mut aggregates), &finished);
        let source = source.as_ref();
        let stage = KnownStage { run, source, range, graph: &graph, reuse: &reuse, nodes, aggregates };
        if visit(&stage).is_break() {
            break;
        }
    }
    Ok(())
}

/// The stored aggregate values of ordered nodes: key and values.
type FinishedValues = HashMap<NodeId, (Key, Vec<Option<Value>>)>;

/// Finds the stored aggregate values of a stage run; nodes without them would run.
fn once(
    plan: &Plan,
    run: RunId,
    (store, share): (&dyn Store, Option<&Share>),
    values: &mut AggregateValues,
    (foreseen, aggregates): (&mut [Foreseen], &mut BTreeMap<NodeId, Key>),
    finished: &FinishedValues,
) {
    let planned = &plan.runs[run];
    if let Some(share) = share {
        share.find_aggregates(run, planned, store, values);
    }
    for (node, planned_node) in NodeId::enumerate(&planned.nodes) {
        let known = match planned_node.contract {
            Contract::Pure => continue,
            _ if share.is_some_and(|share| !share.computes(NodeRef { run, node })) => continue,
            Contract::Ordered => finished.get(&node).cloned(),
            Contract::Once => inputs_of(planned_node, values).and_then(|inputs| {
                let keys: Vec<Option<Key>> = inputs.iter().map(|input| input.as_ref().map(|once| once.key)).collect();
                let key = value_keys::once(&planned_node.node_hash, &keys);
                aggregate_values(store, planned, node, &key).map(|values| (key, values))
            }),
        };
        if planned_node.contract == Contract::Once {
            let (fires, taken) = (u64::from(known.is_none()), u64::from(known.is_some()));
            foreseen[node] = Foreseen { fires, taken, known: 0 };
        }
        if let Some((key, outputs)) = known {
            aggregates.insert(node, key);
            // A node after it may read them.
            values.make(NodeRef { run, node }, planned_node, Some(key), outputs);
        }
    }
}

/// A placeholder for an aggregate value, with a key that no store knows.
fn pending(from: &Origin) -> AggregateValue {
    let value = Value::from(depthloom_graphs::values::Curve::default());
    AggregateValue { value, key: Key::build("not made yet").text(&format!("{from:?}")).finish() }
}
