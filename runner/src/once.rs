//! What ordered nodes compute when they finish, and what aggregate nodes compute.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use depthloom_graphs::contracts::{Contract, ErrorMessage, Slot, Tap, Warned};
use depthloom_graphs::plan::{NodeId, NodeRef, Plan, PlannedNode, PortId, RunId};
use depthloom_graphs::ready::NodeBuilder;
use depthloom_graphs::{
    Context, Fault, Host as _, Inputs, Instance, Key, OnceNode, OrderedNode, Port, Scratch, Source, Value, value_keys,
};
use depthloom_threads::{caught, locked};

use crate::audit::comparison::compare_aggregates;
use crate::error::RunError;
use crate::host::TaskHost;
use crate::once_values::{OnceValue, OnceValues, inputs_of, is_once};
use crate::options::Audit;
use crate::panics::fault;
use crate::reuse::{Finished, Reuse, once_values};
use crate::stage::Common;
use crate::stage::frame_graph::FrameGraph;
use crate::stage::retire::Completion;
use crate::timing::{Phase, Spent, Stopwatch, Timing};

/// Work outside frames.
pub(crate) enum Job {
    /// A once-node, and what is at its inputs; `None` if a required one is absent.
    Fire(Box<dyn OnceNode>, Option<Vec<Option<OnceValue>>>),
    /// An ordered node after its last frame, and its key there.
    Finish(Box<dyn OrderedNode>, Option<Key>),
    /// Nothing: these values are known.
    Known(Finished),
}

impl Job {
    /// The key of the values it gives; `None` if it gives none, for a required input is absent.
    fn key(&self, planned: &PlannedNode) -> Option<Key> {
        match self {
            Self::Fire(_, inputs) => {
                let keys: Vec<_> = inputs.as_ref()?.iter().map(|input| input.as_ref().map(|once| once.key)).collect();
                Some(value_keys::once(&planned.recipe, &keys))
            }
            Self::Finish(_, last) => Some(value_keys::finished(&planned.recipe, last.as_ref())),
            Self::Known(known) => Some(known.key),
        }
    }
}

/// What a job came to: the once-values by port, what making them took (`None` where they were known), and what was told of.
type Done = (Result<Vec<Option<Value>>, Fault>, Option<Spent>, Vec<Warned>);

/// A stage run's work outside frames.
pub(crate) struct OnceWork<'a, T> {
    pub(crate) run: RunId,
    pub(crate) plan: &'a Plan,
    pub(crate) common: &'a Common<'a, T>,
    /// The once-nodes that have not fired yet, by index.
    pub(crate) waiting: BTreeMap<NodeId, Box<dyn OnceNode>>,
    /// The key of each node that gave once-values, by index.
    pub(crate) keys: BTreeMap<NodeId, Key>,
    /// What they told of, by index.
    pub(crate) reported: BTreeMap<NodeId, Vec<Warned>>,
    /// The once-nodes that fired: not those whose values an equal one gave.
    pub(crate) fired: BTreeSet<NodeId>,
    /// The nodes whose once-values the tap's store had.
    pub(crate) reused: BTreeSet<NodeId>,
    pub(crate) timings: Vec<Timing>,
}

impl<T: Tap> OnceWork<'_, T> {
    /// Fires every once-node whose inputs are there, and those whose inputs these give, and so on.
    pub(crate) fn fire_all(&mut self, values: &mut OnceValues) -> Result<Completion, RunError> {
        loop {
            let nodes = &self.plan.runs[self.run].nodes;
            let ready = self.waiting.extract_if(.., |node, _| inputs_of(&nodes[*node], values).is_some());
            let ready: Vec<_> = ready.collect();
            if ready.is_empty() {
                return Ok(Completion::Whole);
            }
            let with_inputs = |(node, instance): (NodeId, Box<dyn OnceNode>)| {
                let inputs = inputs_of(&nodes[node], values).unwrap_or_default();
                let is_absent = inputs.iter().zip(&nodes[node].inputs).any(|(v, i)| v.is_none() && !i.port.optional);
                (node, Job::Fire(instance, (!is_absent).then_some(inputs)))
            };
            let jobs = ready.into_iter().map(with_inputs).collect();
            if self.do_all(jobs, values)? == Completion::Interrupted {
                return Ok(Completion::Interrupted);
            }
        }
    }

    /// Does jobs that do not depend on each other, as many at once as there are workers.
    pub(crate) fn do_all(&mut self, jobs: Vec<(NodeId, Job)>, values: &mut OnceValues) -> Result<Completion, RunError> {
        if jobs.is_empty() {
            return Ok(Completion::Whole);
        }
        if self.common.interrupt.stops_admission() {
            return Ok(Completion::Interrupted);
        }
        let nodes = &self.plan.runs[self.run].nodes;
        let mut fires: HashSet<Key> = HashSet::new();
        let jobs: Vec<_> = jobs
            .into_iter()
            .map(|(node, job)| {
                let key = job.key(&nodes[node]);
                let job = self.known(node, key, job, values);
                let is_first = |key: &Key| !values.given.contains_key(key) && fires.insert(*key);
                let runs = match nodes[node].contract {
                    Contract::Once => key.as_ref().is_some_and(is_first),
                    Contract::Ordered | Contract::Pure => true,
                };
                (node, key, Mutex::new(runs.then_some(job)), Mutex::new(None))
            })
            .collect();
        let permit = self.common.budget.permit();
        self.host(None, None).tiles(jobs.len(), &|i| {
            let (node, key, job, done) = &jobs[i];
            if let (Some(job), Some(key)) = (locked(job).take(), key) {
                *locked(done) = Some(self.perform(*node, &nodes[*node], *key, job));
            }
        });
        drop(permit);
        if self.common.interrupt.aborts() {
            return Err(RunError::Aborted);
        }
        let mut completion = Completion::Whole;
        for (node, key, _, done) in jobs {
            let planned = &nodes[node];
            let outputs = match locked(&done).take() {
                Some((Ok(outputs), None, warnings)) => {
                    self.reported.insert(node, warnings);
                    self.reused.insert(node);
                    if let (Contract::Once, Some(key)) = (planned.contract, key) {
                        values.given.insert(key, outputs.clone());
                    }
                    outputs
                }
                Some((Err(Fault::Cancelled), ..)) if self.common.interrupt.stops_admission() => {
                    // It was asked to, and put down where it is.
                    completion = Completion::Interrupted;
                    continue;
                }
                Some((Err(fault), ..)) => {
                    return Err(RunError::OnceFailed {
                        stage: self.plan.runs[self.run].stage.clone(),
                        node: planned.name.clone(),
                        variants: planned.variant_names(self.plan).into_iter().map(str::to_owned).collect(),
                        fault: Box::new(fault),
                    });
                }
                Some((Ok(outputs), Some(spent), warnings)) => {
                    self.reported.insert(node, warnings);
                    let mut timing = Timing::new(self.run, planned.name.clone(), Phase::Once(node));
                    timing.add(0, spent);
                    self.timings.push(timing);
                    if let (Contract::Once, Some(key)) = (planned.contract, key) {
                        self.fired.insert(node);
                        values.given.insert(key, outputs.clone());
                    }
                    outputs
                }
                None => match key {
                    // A required input is absent: so are its outputs.
                    None => Vec::new(),
                    // An equal node fired; unless it was put down, as above.
                    Some(key) => match values.given.get(&key) {
                        Some(outputs) => outputs.clone(),
                        None => continue,
                    },
                },
            };
            values.make(self.node_ref(node), planned, key, outputs);
            self.keys.extend(key.map(|key| (node, key)));
        }
        Ok(completion)
    }

    /// What of the stage's frames need not be made again.
    pub(crate) fn reuse<'s>(&'s self, graph: &FrameGraph, source: &'s dyn Source) -> Option<Reuse<'s>> {
        let permit = self.common.budget.permit();
        let reuse =
            Reuse::new(self.run, &self.plan.runs[self.run], graph, source, self.common.tap, &self.host(None, None));
        drop(permit);
        reuse
    }

    /// A job, or its outcome where the tap's store has it.
    fn known(&self, node: NodeId, key: Option<Key>, job: Job, values: &OnceValues) -> Job {
        let (Job::Fire(..), Some(key), Some(store)) = (&job, key, self.common.tap.store()) else { return job };
        if values.given.contains_key(&key) {
            return job;
        }
        match once_values(store, &self.plan.runs[self.run], node, &key) {
            Some(values) => Job::Known(Finished { key, values }),
            None => job,
        }
    }

    /// Hands the once-values that are recorded to the tap, in plan order.
    pub(crate) fn hand_over(&self, values: &OnceValues) -> Result<(), RunError> {
        let run = &self.plan.runs[self.run];
        for (&node, key) in &self.keys {
            let warnings = self.reported.get(&node).map_or(&[][..], Vec::as_slice);
            for (port, output) in PortId::enumerate(&run.nodes[node].outputs).filter(|(_, o)| o.recorded) {
                let Some(Some(once)) = values.made.get(&(self.node_ref(node), port)) else { continue };
                match self.common.tap.written_aggregate(self.run, Slot::Node { node, port }) {
                    Some(written) if written == *key => continue,
                    Some(_) => {
                        return Err(RunError::OutdatedAggregate {
                            stage: run.stage.clone(),
                            node: run.nodes[node].name.clone(),
                        });
                    }
                    None => {}
                }
                caught(|| self.common.tap.once(self.run, Slot::Node { node, port }, key, &once.value, warnings))
                    .unwrap_or_else(|panic| Err(ErrorMessage::new(format!("panicked {}", panic.0))))
                    .map_err(|error| {
                        let what = format!("the once-value `{}/{}`", run.nodes[node].name, output.port.name);
                        RunError::Tap { stage: run.stage.clone(), what, error }
                    })?;
            }
        }
        Ok(())
    }

    /// Recomputes the reused values of aggregate nodes, where all reused values are audited: a training may take hours. Gives how many were compared.
    pub(crate) fn audit(
        &self,
        builders: &BTreeMap<NodeRef, NodeBuilder>,
        values: &OnceValues,
    ) -> Result<u64, RunError> {
        let run = &self.plan.runs[self.run];
        let mut compared = 0;
        for &node in &self.reused {
            let planned = &run.nodes[node];
            let (Audit::All, Contract::Once) = (self.common.audit, planned.contract) else { continue };
            let (Some(inputs), Some(builder)) = (inputs_of(planned, values), builders.get(&self.node_ref(node))) else {
                continue;
            };
            if self.common.interrupt.stops_admission() {
                break;
            }
            let ports: Vec<Port> = planned.inputs.iter().map(|input| input.port.clone()).collect();
            let inputs: Vec<_> = inputs.into_iter().map(|input| input.map(|once| once.value)).collect();
            let host = TaskHost { key: self.keys.get(&node).copied(), ..self.host(Some(node), None) };
            let mut scratch = Scratch::default();
            let made = match builder.build() {
                Ok(Instance::Once(instance)) => {
                    let mut ctx = Context::new(&host, &mut scratch);
                    caught(|| instance.run(&Inputs::new(&ports, &inputs), &mut ctx))
                        .unwrap_or_else(|panic| Err(fault(panic)))
                }
                Ok(Instance::Pure(_) | Instance::Ordered(_)) => continue,
                Err(fault) => Err(fault),
            };
            let stored: Vec<Option<Value>> = PortId::all(planned.outputs.len())
                .map(|port| values.made.get(&(self.node_ref(node), port)).cloned().flatten().map(|once| once.value))
                .collect();
            compared += compare_aggregates(run, node, &stored, made)?;
        }
        Ok(compared)
    }

    const fn node_ref(&self, node: NodeId) -> NodeRef {
        NodeRef { run: self.run, node }
    }

    fn host(&self, node: Option<NodeId>, key: Option<Key>) -> TaskHost<'_> {
        let Common { budget, interrupt, observer, warnings, checkpoints, .. } = *self.common;
        let (run, helpers_cpu_ns) = (self.run, AtomicU64::new(0));
        let checkpoints = key.is_some().then_some(checkpoints);
        let (reported, is_repeated) = (Mutex::default(), false);
        let position = None;
        TaskHost {
            budget,
            interrupt,
            observer,
            warnings,
            run,
            node,
            position,
            key,
            checkpoints,
            helpers_cpu_ns,
            reported,
            is_repeated,
        }
    }

    /// Does a job.
    fn perform(&self, node: NodeId, planned: &PlannedNode, key: Key, job: Job) -> Done {
        let (watch, host, mut scratch) = (Stopwatch::start(), self.host(Some(node), Some(key)), Scratch::default());
        let mut ctx = Context::new(&host, &mut scratch);
        let ports: Vec<Port> =
            planned.outputs.iter().map(|o| &o.port).filter(|p| is_once(planned, p)).cloned().collect();
        let made = match job {
            Job::Fire(instance, inputs) => {
                let in_ports: Vec<Port> = planned.inputs.iter().map(|i| i.port.clone()).collect();
                let values: Vec<_> = inputs.into_iter().flatten().map(|i| i.map(|once| once.value)).collect();
                caught(|| instance.run(&Inputs::new(&in_ports, &values), &mut ctx))
            }
            Job::Finish(instance, _) => caught(|| instance.finish(&mut ctx)),
            Job::Known(Finished { values, .. }) => {
                for (what, count) in self.common.tap.store().map(|store| store.warnings(&key)).unwrap_or_default() {
                    host.warn_n(count, &what);
                }
                return (Ok(values), None, host.into_warnings().collect());
            }
        };
        self.common.checkpoints.release(&key);
        let made = made.unwrap_or_else(|panic| Err(fault(panic))).and_then(|given| given.in_order_of(&ports));
        let spent = watch.stop(host.helpers_cpu_ns.load(Ordering::Relaxed));
        (made, Some(spent), host.into_warnings().collect())
    }
}
