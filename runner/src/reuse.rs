//! What need not be made again: found by the keys of values before any of them is computed.
//!
//! A frame's keys follow from the key of its source, which is known before the frame is read, and from what each node is known to have
//! given on it. So before a stage's frames run its keys are walked once, without a value: an ordered node whose every frame and whose
//! once-values are in the store does not fire at all. When a frame is let in, its own keys are walked again; what then is neither in
//! the store nor needed by what is not does not fire.

pub(crate) mod foresee;
pub(crate) mod kept;

use std::sync::OnceLock;

use depthloom_graphs::contracts::{Contract, Held, Holding, Slot, Store, Tap};
use depthloom_graphs::plan::{FrameIndex, NodeId, PortId, RunId, StageRun};
use depthloom_graphs::value_keys::{self, Observed};
use depthloom_graphs::{Fault, Frame, Host, Key, Port, Rate, Source, Value};

use crate::once_values::is_once;
use crate::stage::frame_graph::{Feed, FrameGraph, OutputId, StepId, StepOutput};
use depthloom_threads::caught;

/// What a step does on a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum StepAction {
    /// It runs, as it would without a store.
    Run,
    /// It does not run: a required input is absent.
    Skip,
    /// It need not run: this is its key, and these of its per-frame outputs are read from the store for nodes that run.
    Reuse(Key, Vec<OutputId>),
}

/// What is done on a frame.
pub(crate) struct FramePlan {
    /// By step: the source, then the nodes.
    pub(crate) steps: Vec<StepAction>,
    /// By step, the key under which the store has its values; and by per-frame output, whether it has that one.
    stored: Vec<Option<(Key, Vec<bool>)>>,
    /// The outputs that are known to have no value.
    pub(crate) absent: Vec<StepOutput>,
}

impl FramePlan {
    /// Whether values of a step are copied or read from the store.
    pub(crate) fn reuses(&self, step: StepId) -> bool {
        let is_stored = self.stored[step].as_ref().is_some_and(|(_, is_there)| is_there.contains(&true));
        is_stored
            || matches!(self.steps[step], StepAction::Reuse(..)) && self.absent.iter().any(|absent| absent.step == step)
    }

    /// Whether the store knows what a step gave on the frame.
    pub(crate) fn is_known(&self, step: StepId) -> bool {
        self.stored[step].is_some()
    }

    /// The key under which the store has a value, if it has.
    pub(crate) fn stored(&self, output: StepOutput) -> Option<Key> {
        let (key, is_there) = self.stored[output.step].as_ref()?;
        is_there[output.output].then_some(*key)
    }
}

/// What is known of a step on a frame before it runs.
#[derive(Clone, Debug)]
enum Known {
    /// Nothing: it fires.
    Fresh,
    /// A required input is absent.
    Absent,
    /// It gave these values before, by per-frame output.
    There(Key, Vec<Output>),
}

/// What is known of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Output {
    /// The store has its value.
    Held,
    /// It gave none.
    None,
    /// It gave a value, which the store does not have.
    NotHeld,
    /// The store does not say.
    Unknown,
}

/// An ordered node over a stage's frames.
#[derive(Default)]
struct Chain {
    /// By frame, the node's key before it; up to the first frame where it is not known.
    before: Vec<Option<Key>>,
    /// Its key after the last frame; `None` if not known.
    last: Option<Option<Key>>,
    /// Whether it fires.
    fires: bool,
}

/// The once-values of an ordered node that does not fire.
pub(crate) struct Finished {
    pub(crate) key: Key,
    /// By once-output.
    pub(crate) values: Vec<Option<Value>>,
}

/// What a stage run need not make again.
pub(crate) struct Reuse<'a> {
    store: &'a dyn Store,
    plan: &'a StageRun,
    frames: &'a [Frame],
    run: RunId,
    /// By node; of ordered nodes alone.
    chains: Vec<Option<Chain>>,
    /// By node, the once-values of ordered nodes that do not fire.
    pub(crate) finished: Vec<Option<Finished>>,
    /// How many frames are written already.
    pub(crate) written: usize,
}

impl<'a> Reuse<'a> {
    /// Walks the keys of a stage's frames. `None` if there is no store.
    pub(crate) fn new<T: Tap>(
        run: RunId,
        plan: &'a StageRun,
        graph: &FrameGraph,
        source: &'a dyn Source,
        tap: &'a T,
        host: &dyn Host,
    ) -> Option<Self> {
        let store = tap.store()?;
        let chains = plan.nodes.iter().map(|node| (node.contract == Contract::Ordered).then(Chain::default)).collect();
        let finished = plan.nodes.iter().map(|_| None).collect();
        let mut reuse = Self { store, plan, frames: source.frames(), run, chains, finished, written: tap.written(run) };
        if reuse.chains.iter().any(Option::is_some) {
            let keys = source_keys(source, store, host);
            for (position, key) in FrameIndex::enumerate(&keys) {
                reuse.follow(graph, tap, position, *key);
            }
            reuse.finish();
            while reuse.fires_on_some_frame(graph, tap, &keys) {}
        }
        Some(reuse)
    }

    /// Takes a frame into the chains of keys.
    fn follow<T: Tap>(&mut self, graph: &FrameGraph, tap: &T, position: FrameIndex, source: Option<Key>) {
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
                Known::Fresh => (chain.last, chain.fires) = (None, true),
                Known::Absent => chain.last = chain.before.get(position.0).copied(),
                Known::There(key, outputs) => {
                    chain.last = Some(Some(*key));
                    chain.fires |= OutputId::enumerate(outputs).any(|(output, known)| {
                        *known == Output::NotHeld
                            && slot_of(self.plan, StepOutput { step, output }).is_some_and(|slot| {
                                tap.part(self.run, slot).is_some() && tap.keeps(self.run, slot, position)
                            })
                    });
                }
            }
        }
    }

    /// Finds the once-values of the ordered nodes whose every frame is known; the others fire.
    fn finish(&mut self) {
        for (node, chain) in NodeId::enumerate(&mut self.chains) {
            let Some(chain) = chain.as_mut().filter(|chain| !chain.fires) else { continue };
            let last = chain.last.unwrap_or_default();
            let key = value_keys::finished(&self.plan.nodes[node].recipe, last.as_ref());
            self.finished[node] = once_values(self.store, self.plan, node, &key).map(|values| Finished { key, values });
            chain.fires = self.finished[node].is_none();
        }
    }

    /// Whether an ordered node that was not to fire has to on some frame, for a value that was not kept: then it fires on all, for
    /// what it remembers comes of those before.
    fn fires_on_some_frame<T: Tap>(&mut self, graph: &FrameGraph, tap: &T, keys: &[Option<Key>]) -> bool {
        let idle =
            NodeId::enumerate(&self.chains).filter(|(_, chain)| chain.as_ref().is_some_and(|chain| !chain.fires));
        let idle: Vec<NodeId> = idle
            .map(|(node, _)| node)
            .filter(|node| !graph.producers[StepId::of_node(*node)].outputs.is_empty())
            .collect();
        for (position, key) in FrameIndex::enumerate(keys).filter(|_| !idle.is_empty()) {
            let Some(key) = *key else { continue };
            let steps = self.plan(graph, tap, position, key).steps;
            if let Some(&node) = idle.iter().find(|node| steps[StepId::of_node(**node)] == StepAction::Run) {
                self.finished[node] = None;
                self.chains[node].iter_mut().for_each(|chain| chain.fires = true);
                return true;
            }
        }
        false
    }

    /// The first frame that has to be let in.
    pub(crate) fn first(&self) -> usize {
        let replays = self.chains.iter().flatten().any(|chain| chain.fires);
        if replays { 0 } else { self.written }
    }

    /// What is known of every step on a frame.
    fn known(&self, graph: &FrameGraph, position: FrameIndex, source: Option<Key>) -> Vec<Known> {
        let mut known = Vec::with_capacity(graph.producers.len());
        known.push(source.map_or(Known::Fresh, |key| self.find(graph, StepId::SOURCE, key)));
        for (node, planned) in NodeId::enumerate(&self.plan.nodes) {
            let step = StepId::of_node(node);
            known.push(if planned.contract == Contract::Once {
                Known::Absent
            } else {
                match self.key(graph, position, node, &known) {
                    Ok(Some(key)) => self.find(graph, step, key),
                    Ok(None) => Known::Absent,
                    Err(Unknown) => Known::Fresh,
                }
            });
        }
        known
    }

    /// The key of a node's values on a frame; `None` if it does not fire.
    fn key(
        &self,
        graph: &FrameGraph,
        position: FrameIndex,
        node: NodeId,
        known: &[Known],
    ) -> Result<Option<Key>, Unknown> {
        let producer = &graph.producers[StepId::of_node(node)];
        // What may fail is waited for, whether or not another input is absent: a failure is told of behind it.
        let is_fresh = |feed: &Feed| matches!(feed, Feed::Place { step, .. } if matches!(known[*step], Known::Fresh));
        if producer.feeds.iter().any(is_fresh) {
            return Err(Unknown);
        }
        let mut keys = Vec::with_capacity(producer.inputs.len());
        for (port, feed) in producer.inputs.iter().zip(&producer.feeds) {
            let key = match feed {
                Feed::Unwired | Feed::Once(None) => None,
                Feed::Once(Some(once)) => Some(once.key),
                Feed::Place { place, step } => match &known[*step] {
                    Known::Fresh => return Err(Unknown),
                    Known::Absent => None,
                    Known::There(key, outputs) => {
                        let output = graph.producers[*step].output_at(*place);
                        match outputs[output] {
                            Output::Unknown => return Err(Unknown),
                            Output::None => None,
                            Output::Held | Output::NotHeld => {
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
        // What cannot be read is reported when the node runs.
        let files = planned.files_content(frame).map_err(|_| Unknown)?;
        let observed = Observed { frame, files };
        match &self.chains[node] {
            None => Ok(Some(value_keys::pure(&planned.recipe, planned.observes.is_some().then_some(observed), &keys))),
            Some(chain) => {
                let before = chain.before.get(position.0).ok_or(Unknown)?;
                Ok(Some(value_keys::ordered(&planned.recipe, before.as_ref(), observed, &keys)))
            }
        }
    }

    /// What the store has under a key.
    fn find(&self, graph: &FrameGraph, step: StepId, key: Key) -> Known {
        let Some(held) = self.store.find(&key) else { return Known::Fresh };
        let output = |port: &Port| match held.iter().find(|held| held.port == port.name) {
            Some(Held { is: Holding::There, .. }) => Output::Held,
            Some(Held { is: Holding::Nothing, .. }) if port.optional => Output::None,
            Some(Held { is: Holding::NotKept, .. }) => Output::NotHeld,
            // It fired, so it gave what it must.
            _ if !port.optional => Output::NotHeld,
            _ => Output::Unknown,
        };
        Known::There(key, graph.producers[step].outputs.iter().map(output).collect())
    }

    /// What is done on a frame, by its source's key.
    pub(crate) fn plan<T: Tap>(&self, graph: &FrameGraph, tap: &T, position: FrameIndex, source: Key) -> FramePlan {
        let known = self.known(graph, position, Some(source));
        let is_written = position.0 < self.written;
        let steps = graph.producers.len();
        let mut fires = vec![false; steps];
        let mut load: Vec<Vec<OutputId>> = vec![Vec::new(); steps];
        for step in StepId::all(steps).rev() {
            let chain = step.node().and_then(|node| self.chains[node].as_ref());
            fires[step] |= match &known[step] {
                Known::Absent => false,
                Known::Fresh => !is_written || chain.is_some(),
                Known::There(_, outputs) => {
                    let lacks = || {
                        OutputId::enumerate(outputs).any(|(output, known)| {
                            matches!(known, Output::NotHeld | Output::Unknown)
                                && slot_of(self.plan, StepOutput { step, output }).is_some_and(|slot| {
                                    tap.part(self.run, slot).is_some() && tap.keeps(self.run, slot, position)
                                })
                        })
                    };
                    chain.is_some_and(|chain| chain.fires) || !is_written && lacks()
                }
            };
            if !fires[step] {
                continue;
            }
            for feed in &graph.producers[step].feeds {
                let Feed::Place { place, step: from } = feed else { continue };
                let output = graph.producers[*from].output_at(*place);
                match &known[*from] {
                    Known::Fresh => fires[*from] = true,
                    Known::There(_, outputs) if matches!(outputs[output], Output::NotHeld | Output::Unknown) => {
                        fires[*from] = true;
                    }
                    Known::There(_, outputs) if outputs[output] == Output::Held => load[*from].push(output),
                    Known::There(..) | Known::Absent => {}
                }
            }
        }
        let stored = known.iter().map(|known| match known {
            Known::There(key, outputs) => Some((*key, outputs.iter().map(|output| *output == Output::Held).collect())),
            Known::Fresh | Known::Absent => None,
        });
        let stored = stored.collect();
        let mut absent = Vec::new();
        for (step, known) in StepId::enumerate(&known) {
            if let (Known::There(_, outputs), false) = (known, fires[step]) {
                let none = OutputId::enumerate(outputs).filter(|(_, known)| **known == Output::None);
                absent.extend(none.map(|(output, _)| StepOutput { step, output }));
            }
        }
        let action = |(step, known): (StepId, Known)| match known {
            _ if fires[step] => StepAction::Run,
            Known::There(key, _) => {
                let mut load = std::mem::take(&mut load[step]);
                load.sort_unstable();
                load.dedup();
                StepAction::Reuse(key, load)
            }
            Known::Absent | Known::Fresh => StepAction::Skip,
        };
        FramePlan { steps: StepId::enumerate(known).map(action).collect(), stored, absent }
    }

    /// The key of every step's values on a frame, where the store has them; by step, the source first.
    pub(crate) fn keys(&self, graph: &FrameGraph, position: FrameIndex, source: Key) -> Vec<Option<Key>> {
        let key = |known: Known| match known {
            Known::There(key, _) => Some(key),
            Known::Fresh | Known::Absent => None,
        };
        self.known(graph, position, Some(source)).into_iter().map(key).collect()
    }

    /// Whether an ordered node's values are all reused, so that it does not run.
    pub(crate) fn reuses_all_frames(&self, node: NodeId) -> bool {
        self.chains[node].as_ref().is_some_and(|chain| !chain.fires)
    }

    /// The recording that holds a value, for messages.
    pub(crate) fn origin(&self, key: &Key, port: &str) -> Option<String> {
        self.store.origin(key, port)
    }

    /// The warnings of the computation that made the values of a key.
    pub(crate) fn warnings(&self, key: &Key) -> Vec<(String, u64)> {
        self.store.warnings(key)
    }

    /// Values from the store; what lies together is read once.
    pub(crate) fn values(&self, wanted: &[(Key, &str)]) -> Result<Vec<Option<Value>>, Fault> {
        self.store.values(wanted)
    }
}

/// What cannot be known before a node has fired.
struct Unknown;

/// The once-values of a node, in the order of its once-outputs, if the store has all that are recorded or read.
pub(crate) fn once_values(store: &dyn Store, plan: &StageRun, node: NodeId, key: &Key) -> Option<Vec<Option<Value>>> {
    let planned = &plan.nodes[node];
    let mut outputs = planned.outputs.iter().filter(|output| is_once(planned, &output.port)).peekable();
    // An ordered node without aggregate outputs is known by its frames; an aggregate node is known by its values alone.
    if planned.contract == Contract::Ordered && outputs.peek().is_none() {
        return Some(Vec::new());
    }
    let held = store.find(key)?;
    let value = |port: &str| {
        let held = held.iter().find(|held| held.port == port)?;
        // What turns out to be damaged is made afresh.
        match held.is {
            Holding::There => store.value(key, port).ok(),
            Holding::Nothing => Some(None),
            Holding::NotKept => None,
        }
    };
    outputs.map(|output| value(output.port.name)).collect()
}

/// The keys of all frames of a source, as many at once as there are workers; what the store has of them is checked on the way.
///
/// A frame whose key cannot be found out is not known; why is told when it is read.
fn source_keys(source: &dyn Source, store: &dyn Store, host: &dyn Host) -> Vec<Option<Key>> {
    let keys: Vec<OnceLock<Key>> = source.frames().iter().map(|_| OnceLock::new()).collect();
    host.tiles(keys.len(), &|frame| {
        if host.cancelled() {
            return;
        }
        if let Ok(Ok(key)) = caught(|| source.key(FrameIndex(frame))) {
            let _ = store.find(&key);
            let _ = keys[frame].set(key);
        }
    });
    keys.into_iter().map(OnceLock::into_inner).collect()
}

/// The slot of a step's per-frame output.
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
