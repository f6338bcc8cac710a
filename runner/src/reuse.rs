//! Which steps run, and which values are reused: decided by cache keys before anything is computed.
//!
//! Before the frames of a stage run, their keys are derived once from the keys of the source. An ordered node with all
//! its values in the store does not run at all. When a frame is admitted, its keys are derived again: a step runs if
//! its values are neither stored nor derivable.

pub(crate) mod foresee;
pub(crate) mod recorded;

use std::sync::OnceLock;

use depthloom_graphs::contracts::{Contract, Sink, Slot, Store, StoredState};
use depthloom_graphs::plan::{FrameIndex, NodeId, PlannedNode, PortId, RunId, StageRun};
use depthloom_graphs::value_keys::{self, Observed};
use depthloom_graphs::{Frame, Host, Key, Port, Rate, Source, Value};

use crate::aggregate_values::is_once;
use crate::panics::guarded;
use crate::stage::frame_graph::{Feed, FrameGraph, OutputId, StepId, StepOutput};

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum StepAction {
    Run,
    /// A required input is absent.
    Skip,
    /// It does not run. With its key, and the outputs that are read from the store for nodes that run.
    Reuse(Key, Vec<OutputId>),
}

pub(crate) struct FramePlan {
    pub(crate) steps: Vec<StepAction>,
    /// By step, the key of its values in the store; and by output, whether the store has it.
    stored: Vec<Option<(Key, Vec<bool>)>>,
    /// The outputs without a value.
    pub(crate) absent: Vec<StepOutput>,
}

impl FramePlan {
    /// Whether values of a step are copied or read from the store.
    pub(crate) fn reuses(&self, step: StepId) -> bool {
        let is_stored = self.stored[step].as_ref().is_some_and(|(_, is_there)| is_there.contains(&true));
        is_stored
            || matches!(self.steps[step], StepAction::Reuse(..)) && self.absent.iter().any(|absent| absent.step == step)
    }

    /// Whether the store knows the step on this frame.
    pub(crate) fn is_known(&self, step: StepId) -> bool {
        self.stored[step].is_some()
    }

    /// The key of a value that the store has.
    pub(crate) fn stored(&self, output: StepOutput) -> Option<Key> {
        let (key, is_there) = self.stored[output.step].as_ref()?;
        is_there[output.output].then_some(*key)
    }
}

/// What is known of a step on a frame before it runs.
#[derive(Clone, Debug)]
enum StepState {
    /// Nothing.
    Unknown,
    /// A required input is absent.
    Absent,
    /// It ran before, with this key; by output.
    Stored(Key, Vec<OutputState>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OutputState {
    Stored,
    /// It had no value.
    Absent,
    /// It had a value, which the store does not have.
    NotStored,
    Unknown,
}

impl OutputState {
    /// Whether the value must be computed if it is needed.
    const fn must_be_computed(self) -> bool {
        matches!(self, Self::NotStored | Self::Unknown)
    }
}

/// The keys of an ordered node over a stage's frames.
#[derive(Default)]
struct Chain {
    /// By frame, the node's key before it; up to the first frame where it is unknown.
    before: Vec<Option<Key>>,
    /// Its key after the last frame; `None` if unknown.
    last: Option<Option<Key>>,
    runs: bool,
}

/// The aggregate values of an ordered node that does not run.
pub(crate) struct Finished {
    pub(crate) key: Key,
    /// By aggregate port.
    pub(crate) values: Vec<Option<Value>>,
}

/// What a stage run reuses.
pub(crate) struct Reuse<'a> {
    pub(crate) store: &'a dyn Store,
    plan: &'a StageRun,
    frames: &'a [Frame],
    run: RunId,
    /// By node; of ordered nodes only.
    chains: Vec<Option<Chain>>,
    /// By node; of ordered nodes that do not run.
    pub(crate) finished: Vec<Option<Finished>>,
    /// The position after the frames that an earlier process has written.
    pub(crate) written: usize,
}

impl<'a> Reuse<'a> {
    /// Derives the keys of a stage's frames, of which the first to be processed is at `start`. `None` if there is no
    /// store.
    pub(crate) fn new<T: Sink>(
        run: RunId,
        plan: &'a StageRun,
        graph: &FrameGraph,
        source: &'a dyn Source,
        sink: &'a T,
        host: &dyn Host,
        start: usize,
    ) -> Option<Self> {
        let store = sink.store()?;
        let chain = |(node, planned): (NodeId, &PlannedNode)| {
            let runs = planned.contract == Contract::Ordered && !graph.producers[StepId::of_node(node)].is_omitted;
            runs.then(Chain::default)
        };
        let chains = NodeId::enumerate(&plan.nodes).map(chain).collect();
        let finished = plan.nodes.iter().map(|_| None).collect();
        let mut reuse =
            Self { store, plan, frames: source.frames(), run, chains, finished, written: start + sink.written(run) };
        if reuse.chains.iter().any(Option::is_some) {
            let keys = source_keys(source, store, host);
            for (position, key) in FrameIndex::enumerate(&keys) {
                reuse.follow(graph, sink, position, *key);
            }
            reuse.finish();
            while reuse.runs_on_some_frame(graph, sink, &keys) {}
        }
        Some(reuse)
    }

    /// Adds a frame to the chains of keys.
    fn follow<T: Sink>(&mut self, graph: &FrameGraph, sink: &T, position: FrameIndex, source: Option<Key>) {
        for chain in self.chains.iter_mut().flatten() {
            if let (Some(last), true) = (chain.last, chain.before.len() == position.0) {
                chain.before.push(last);
            } else if position.0 == 0 {
                chain.before.push(None);
            }
        }
        let known = self.known(graph, position, source);
        for (node, chain) in NodeId::enumerate(&mut self.chains) {
            let Some(chain) = chain else { continue };
            let step = StepId::of_node(node);
            match &known[step] {
                StepState::Unknown => (chain.last, chain.runs) = (None, true),
                StepState::Absent => chain.last = chain.before.get(position.0).copied(),
                StepState::Stored(key, outputs) => {
                    chain.last = Some(Some(*key));
                    chain.runs |= OutputId::enumerate(outputs).any(|(output, state)| {
                        let id = StepOutput { step, output };
                        *state == OutputState::NotStored && is_recorded(sink, self.run, self.plan, id, position)
                    });
                }
            }
        }
    }

    /// Finds the aggregate values of the ordered nodes with all their frames in the store; the others run.
    fn finish(&mut self) {
        for (node, chain) in NodeId::enumerate(&mut self.chains) {
            let Some(chain) = chain.as_mut().filter(|chain| !chain.runs) else { continue };
            let last = chain.last.unwrap_or_default();
            let key = value_keys::finished(&self.plan.nodes[node].node_hash, last.as_ref());
            self.finished[node] =
                aggregate_values(self.store, self.plan, node, &key).map(|values| Finished { key, values });
            chain.runs = self.finished[node].is_none();
        }
    }

    /// Whether another ordered node has to run on some frame, for a value that was not kept: then it runs on all, since
    /// its state depends on the frames before.
    fn runs_on_some_frame<T: Sink>(&mut self, graph: &FrameGraph, sink: &T, keys: &[Option<Key>]) -> bool {
        let has_outputs = |node: &NodeId| !graph.producers[StepId::of_node(*node)].outputs.is_empty();
        let idle: Vec<NodeId> =
            NodeId::all(self.chains.len()).filter(|node| self.reuses_all_frames(*node) && has_outputs(node)).collect();
        for (position, key) in FrameIndex::enumerate(keys).filter(|_| !idle.is_empty()) {
            let Some(key) = *key else { continue };
            let steps = self.plan(graph, sink, position, key).steps;
            if let Some(&node) = idle.iter().find(|node| steps[StepId::of_node(**node)] == StepAction::Run) {
                self.finished[node] = None;
                self.chains[node].iter_mut().for_each(|chain| chain.runs = true);
                return true;
            }
        }
        false
    }

    /// The first frame to be admitted.
    pub(crate) fn first(&self) -> usize {
        let replays = self.chains.iter().flatten().any(|chain| chain.runs);
        if replays { 0 } else { self.written }
    }

    fn known(&self, graph: &FrameGraph, position: FrameIndex, source: Option<Key>) -> Vec<StepState> {
        let mut known = Vec::with_capacity(graph.producers.len());
        known.push(source.map_or(StepState::Unknown, |key| self.find(graph, StepId::SOURCE, key)));
        for (node, planned) in NodeId::enumerate(&self.plan.nodes) {
            let step = StepId::of_node(node);
            known.push(if planned.contract == Contract::Once || graph.producers[step].is_omitted {
                StepState::Absent
            } else {
                match self.key(graph, position, node, &known) {
                    Ok(Some(key)) => self.find(graph, step, key),
                    Ok(None) => StepState::Absent,
                    Err(Unknown) => StepState::Unknown,
                }
            });
        }
        known
    }

    /// The key of a node's values on a frame; `None` if a required input is absent.
    fn key(
        &self,
        graph: &FrameGraph,
        position: FrameIndex,
        node: NodeId,
        known: &[StepState],
    ) -> Result<Option<Key>, Unknown> {
        let producer = &graph.producers[StepId::of_node(node)];
        // A step that may fail counts, whether or not another input is absent: nodes after a failure report it.
        let is_unknown =
            |feed: &Feed| matches!(feed, Feed::Place { step, .. } if matches!(known[*step], StepState::Unknown));
        if producer.feeds.iter().any(is_unknown) {
            return Err(Unknown);
        }
        let mut keys = Vec::with_capacity(producer.inputs.len());
        for (port, feed) in producer.inputs.iter().zip(&producer.feeds) {
            let key = match feed {
                Feed::Unwired | Feed::Once(None) => None,
                Feed::Once(Some(once)) => Some(once.key),
                Feed::Place { place, step } => match &known[*step] {
                    StepState::Unknown => return Err(Unknown),
                    StepState::Absent => None,
                    StepState::Stored(key, outputs) => {
                        let output = graph.producers[*step].output_at(*place);
                        match outputs[output] {
                            OutputState::Unknown => return Err(Unknown),
                            OutputState::Absent => None,
                            OutputState::Stored | OutputState::NotStored => {
                                Some(value_keys::port(key, graph.producers[*step].outputs[output].name))
                            }
                        }
                    }
                },
            };
            if key.is_none() && !port.optional {
                return Ok(None);
            }
            keys.push(key);
        }
        let planned = &self.plan.nodes[node];
        let frame = &self.frames[position];
        // An unreadable file is reported when the node runs.
        let files = planned.files_content(frame).map_err(|_| Unknown)?;
        let observed = Observed { frame, files };
        match &self.chains[node] {
            None => {
                Ok(Some(value_keys::pure(&planned.node_hash, planned.observes.is_some().then_some(observed), &keys)))
            }
            Some(chain) => {
                let before = chain.before.get(position.0).ok_or(Unknown)?;
                Ok(Some(value_keys::ordered(&planned.node_hash, before.as_ref(), observed, &keys)))
            }
        }
    }

    fn find(&self, graph: &FrameGraph, step: StepId, key: Key) -> StepState {
        let Some(held) = self.store.find(&key) else { return StepState::Unknown };
        let state = |port: &Port| match held.iter().find(|held| held.port == port.name).map(|held| held.state) {
            Some(StoredState::Stored) => OutputState::Stored,
            Some(StoredState::Absent) if port.optional => OutputState::Absent,
            Some(StoredState::NotKept) => OutputState::NotStored,
            // It ran, so it had its required values.
            _ if !port.optional => OutputState::NotStored,
            _ => OutputState::Unknown,
        };
        StepState::Stored(key, graph.producers[step].outputs.iter().map(state).collect())
    }

    /// What to do on a frame, by its source's key.
    pub(crate) fn plan<T: Sink>(&self, graph: &FrameGraph, sink: &T, position: FrameIndex, source: Key) -> FramePlan {
        let known = self.known(graph, position, Some(source));
        let is_written = position.0 < self.written;
        let steps = graph.producers.len();
        let mut runs = vec![false; steps];
        let mut load: Vec<Vec<OutputId>> = vec![Vec::new(); steps];
        for step in StepId::all(steps).rev() {
            let chain = step.node().and_then(|node| self.chains[node].as_ref());
            let lacks = |(output, state): (OutputId, &OutputState)| {
                state.must_be_computed()
                    && is_recorded(sink, self.run, self.plan, StepOutput { step, output }, position)
            };
            runs[step] |= match &known[step] {
                StepState::Absent => false,
                StepState::Unknown => !is_written || chain.is_some(),
                StepState::Stored(_, outputs) => {
                    chain.is_some_and(|chain| chain.runs) || !is_written && OutputId::enumerate(outputs).any(lacks)
                }
            };
            if !runs[step] {
                continue;
            }
            for feed in &graph.producers[step].feeds {
                let Feed::Place { place, step: from } = feed else { continue };
                let output = graph.producers[*from].output_at(*place);
                match &known[*from] {
                    StepState::Unknown => runs[*from] = true,
                    StepState::Stored(_, outputs) if outputs[output].must_be_computed() => runs[*from] = true,
                    StepState::Stored(_, outputs) if outputs[output] == OutputState::Stored => load[*from].push(output),
                    StepState::Stored(..) | StepState::Absent => {}
                }
            }
        }
        let (mut actions, mut stored, mut absent) = (Vec::with_capacity(steps), Vec::with_capacity(steps), Vec::new());
        for (step, known) in StepId::enumerate(known) {
            let mut action = if runs[step] { StepAction::Run } else { StepAction::Skip };
            let mut own = None;
            if let StepState::Stored(key, outputs) = known {
                if !runs[step] {
                    let mut load = std::mem::take(&mut load[step]);
                    load.sort_unstable();
                    load.dedup();
                    action = StepAction::Reuse(key, load);
                    let without = OutputId::enumerate(&outputs).filter(|(_, state)| **state == OutputState::Absent);
                    absent.extend(without.map(|(output, _)| StepOutput { step, output }));
                }
                own = Some((key, outputs.iter().map(|state| *state == OutputState::Stored).collect()));
            }
            actions.push(action);
            stored.push(own);
        }
        FramePlan { steps: actions, stored, absent }
    }

    /// By step, the key of its values on a frame, if the store has them.
    pub(crate) fn keys(&self, graph: &FrameGraph, position: FrameIndex, source: Key) -> Vec<Option<Key>> {
        let key = |known: StepState| match known {
            StepState::Stored(key, _) => Some(key),
            StepState::Unknown | StepState::Absent => None,
        };
        self.known(graph, position, Some(source)).into_iter().map(key).collect()
    }

    /// Whether an ordered node does not run, since all its values are reused.
    pub(crate) fn reuses_all_frames(&self, node: NodeId) -> bool {
        self.chains[node].as_ref().is_some_and(|chain| !chain.runs)
    }
}

/// The key is unknown before a node has run.
struct Unknown;

/// Whether the sink takes a value.
fn is_recorded<T: Sink>(sink: &T, run: RunId, plan: &StageRun, output: StepOutput, position: FrameIndex) -> bool {
    slot_of(plan, output).is_some_and(|slot| sink.part(run, slot).is_some() && sink.keeps(run, slot, position))
}

/// The aggregate values of a node, by aggregate port, if the store has all that are recorded or read.
pub(crate) fn aggregate_values(
    store: &dyn Store,
    plan: &StageRun,
    node: NodeId,
    key: &Key,
) -> Option<Vec<Option<Value>>> {
    let planned = &plan.nodes[node];
    let mut outputs = planned.outputs.iter().filter(|output| is_once(planned, &output.port)).peekable();
    // An ordered node without aggregate outputs is known by its frames; an aggregate node is known by its values alone.
    if planned.contract == Contract::Ordered && outputs.peek().is_none() {
        return Some(Vec::new());
    }
    let ports = store.find(key)?;
    let value = |port: &str| {
        let stored = ports.iter().find(|stored| stored.port == port)?;
        // A damaged value is recomputed.
        match stored.state {
            StoredState::Stored => store.value(key, port).ok(),
            StoredState::Absent => Some(None),
            StoredState::NotKept => None,
        }
    };
    outputs.map(|output| value(output.port.name)).collect()
}

/// The keys of all frames of a source, on all workers, which also looks them up in the store. `None` for a frame that
/// cannot be read, which is reported when it is read.
fn source_keys(source: &dyn Source, store: &dyn Store, host: &dyn Host) -> Vec<Option<Key>> {
    let keys: Vec<OnceLock<Key>> = source.frames().iter().map(|_| OnceLock::new()).collect();
    host.tiles(keys.len(), &|frame| {
        if host.cancelled() {
            return;
        }
        if let Ok(key) = guarded(|| source.key(FrameIndex(frame))) {
            let _ = store.find(&key);
            let _ = keys[frame].set(key);
        }
    });
    keys.into_iter().map(OnceLock::into_inner).collect()
}

pub(crate) fn slot_of(plan: &StageRun, StepOutput { step, output }: StepOutput) -> Option<Slot> {
    let outputs = match step.node() {
        None => &plan.source.outputs,
        Some(node) => &plan.nodes[node].outputs,
    };
    let mut per_frame = PortId::enumerate(outputs).filter(|(_, output)| output.port.rate == Rate::Frame);
    let (port, _) = per_frame.nth(output.0)?;
    Some(match step.node() {
        None => Slot::Source { port },
        Some(node) => Slot::Node { node, port },
    })
}
