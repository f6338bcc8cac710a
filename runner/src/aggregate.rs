//! Work outside frames: aggregate nodes, and what ordered nodes compute when they finish.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::Mutex;
use std::sync::atomic::Ordering;

use depthloom_graphs::contracts::{Contract, NodeWarning, Sink, Slot};
use depthloom_graphs::plan::{NodeId, NodeRef, Plan, PlannedNode, PortId, RunId};
use depthloom_graphs::ready::NodeBuilder;
use depthloom_graphs::{
    AggregateNode, Context, Fault, Host as _, Inputs, Instance, Key, OrderedNode, Outputs, Port, Scratch, Source,
    Value, value_keys,
};
use depthloom_threads::locked;

use crate::aggregate_values::{AggregateValue, AggregateValues, aggregate_ports, inputs_of};
use crate::audit::comparison::compare_aggregates;
use crate::error::RunError;
use crate::host::TaskHost;
use crate::options::Audit;
use crate::panics::{guarded, guarded_sink};
use crate::reuse::{Finished, Reuse, aggregate_values};
use crate::run_context::RunContext;
use crate::stage::frame_graph::FrameGraph;
use crate::stage::retire::Completion;
use crate::timing::{Phase, Spent, Stopwatch, Timing};

pub(crate) enum Job {
    /// An aggregate node and its inputs; `None` if a required one is absent.
    Run(Box<dyn AggregateNode>, Option<Vec<Option<AggregateValue>>>),
    /// An ordered node after its last frame, and its key there.
    Finish(Box<dyn OrderedNode>, Option<Key>),
    /// Nothing to do: these values are stored.
    Known(Finished),
}

impl Job {
    /// The key of its values; `None` if a required input is absent.
    fn key(&self, planned: &PlannedNode) -> Option<Key> {
        match self {
            Self::Run(_, inputs) => {
                let keys: Vec<_> = inputs.as_ref()?.iter().map(|input| input.as_ref().map(|once| once.key)).collect();
                Some(value_keys::once(&planned.node_hash, &keys))
            }
            Self::Finish(_, last) => Some(value_keys::finished(&planned.node_hash, last.as_ref())),
            Self::Known(known) => Some(known.key),
        }
    }
}

struct Done {
    /// By aggregate port.
    outputs: Result<Vec<Option<Value>>, Fault>,
    /// `None` if the values were stored.
    spent: Option<Spent>,
    warnings: Vec<NodeWarning>,
}

/// The work of a stage run outside frames.
pub(crate) struct AggregateWork<'a, T> {
    pub(crate) run: RunId,
    pub(crate) plan: &'a Plan,
    pub(crate) context: &'a RunContext<'a, T>,
    /// The aggregate nodes that have not run yet.
    pub(crate) waiting: BTreeMap<NodeId, Box<dyn AggregateNode>>,
    /// The keys of the nodes with aggregate values.
    pub(crate) keys: BTreeMap<NodeId, Key>,
    pub(crate) reported: BTreeMap<NodeId, Vec<NodeWarning>>,
    /// The aggregate nodes that ran: not those whose values come from an equal node.
    pub(crate) ran: BTreeSet<NodeId>,
    /// The nodes whose aggregate values were stored.
    pub(crate) reused: BTreeSet<NodeId>,
    pub(crate) timings: Vec<Timing>,
}

impl<T: Sink> AggregateWork<'_, T> {
    /// Leaves nodes to other processes, whose values are used where the store has them.
    pub(crate) fn leave_to_others(&mut self, values: &mut AggregateValues) {
        let Some(share) = self.context.share else { return };
        let run = self.run;
        self.waiting.retain(|node, _| share.computes(NodeRef { run, node: *node }));
        if let Some(store) = self.context.sink.store() {
            share.find_aggregates(run, &self.plan.runs[run], store, values);
        }
    }

    /// Runs every aggregate node whose inputs are there, then those that read them, and so on.
    pub(crate) fn run_all(&mut self, values: &mut AggregateValues) -> Result<Completion, RunError> {
        loop {
            let nodes = &self.plan.runs[self.run].nodes;
            let ready = self.waiting.extract_if(.., |node, _| inputs_of(&nodes[*node], values).is_some());
            let ready: Vec<_> = ready.collect();
            if ready.is_empty() {
                return Ok(Completion::Complete);
            }
            let with_inputs = |(node, instance): (NodeId, Box<dyn AggregateNode>)| {
                let inputs = inputs_of(&nodes[node], values).unwrap_or_default();
                let is_absent = inputs.iter().zip(&nodes[node].inputs).any(|(v, i)| v.is_none() && !i.port.optional);
                (node, Job::Run(instance, (!is_absent).then_some(inputs)))
            };
            let jobs = ready.into_iter().map(with_inputs).collect();
            if self.do_all(jobs, values)? == Completion::Interrupted {
                return Ok(Completion::Interrupted);
            }
        }
    }

    /// Does jobs that do not depend on each other, on all workers.
    pub(crate) fn do_all(
        &mut self,
        jobs: Vec<(NodeId, Job)>,
        values: &mut AggregateValues,
    ) -> Result<Completion, RunError> {
        if jobs.is_empty() {
            return Ok(Completion::Complete);
        }
        if self.context.interrupt.stops_admission() {
            return Ok(Completion::Interrupted);
        }
        let nodes = &self.plan.runs[self.run].nodes;
        let mut own: HashSet<Key> = HashSet::new();
        let jobs: Vec<_> = jobs
            .into_iter()
            .map(|(node, job)| {
                let key = job.key(&nodes[node]);
                let job = self.known(node, key, job, values);
                let is_first = |key: &Key| !values.given.contains_key(key) && own.insert(*key);
                let runs = match nodes[node].contract {
                    Contract::Once => key.as_ref().is_some_and(is_first),
                    Contract::Ordered | Contract::Pure => true,
                };
                (node, key, Mutex::new(runs.then_some(job)), Mutex::new(None))
            })
            .collect();
        let permit = self.context.budget.permit();
        self.host(None, None).tiles(jobs.len(), &|i| {
            let (node, key, job, done) = &jobs[i];
            if let (Some(job), Some(key)) = (locked(job).take(), key) {
                *locked(done) = Some(self.perform(*node, &nodes[*node], *key, job));
            }
        });
        drop(permit);
        if self.context.interrupt.aborts() {
            return Err(RunError::Aborted);
        }
        let mut completion = Completion::Complete;
        for (node, key, _, done) in jobs {
            let planned = &nodes[node];
            let outputs = match locked(&done).take() {
                Some(Done { outputs: Err(Fault::Cancelled), .. }) if self.context.interrupt.stops_admission() => {
                    // It stored a checkpoint.
                    completion = Completion::Interrupted;
                    continue;
                }
                Some(Done { outputs: Err(fault), .. }) => {
                    return Err(RunError::of_node(self.plan, self.run, planned, None, fault));
                }
                Some(Done { outputs: Ok(outputs), spent, warnings }) => {
                    self.reported.insert(node, warnings);
                    let is_aggregate = planned.contract == Contract::Once;
                    if let Some(spent) = spent {
                        let mut timing = Timing::new(self.run, planned.name.clone(), Phase::Once(node));
                        timing.add(0, spent);
                        self.timings.push(timing);
                        if is_aggregate {
                            self.ran.insert(node);
                        }
                    } else {
                        self.reused.insert(node);
                    }
                    if let Some(key) = key.filter(|_| is_aggregate) {
                        values.given.insert(key, outputs.clone());
                    }
                    outputs
                }
                None => match key {
                    // A required input is absent: so are its outputs.
                    None => Vec::new(),
                    // An equal node ran, unless it was interrupted as above.
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

    /// Which values of the stage's frames are reused.
    pub(crate) fn reuse<'s>(&'s self, graph: &FrameGraph, source: &'s dyn Source, start: usize) -> Option<Reuse<'s>> {
        let permit = self.context.budget.permit();
        let (run, host) = (&self.plan.runs[self.run], self.host(None, None));
        let reuse = Reuse::new(self.run, run, graph, source, self.context.sink, &host, start);
        drop(permit);
        reuse
    }

    /// The job, or its stored values.
    fn known(&self, node: NodeId, key: Option<Key>, job: Job, values: &AggregateValues) -> Job {
        let (Job::Run(..), Some(key), Some(store)) = (&job, key, self.context.sink.store()) else { return job };
        if values.given.contains_key(&key) {
            return job;
        }
        match aggregate_values(store, &self.plan.runs[self.run], node, &key) {
            Some(values) => Job::Known(Finished { key, values }),
            None => job,
        }
    }

    /// Writes the recorded aggregate values, in plan order.
    pub(crate) fn write(&self, values: &AggregateValues) -> Result<(), RunError> {
        let run = &self.plan.runs[self.run];
        for (&node, key) in &self.keys {
            let warnings = self.reported.get(&node).map_or(&[][..], Vec::as_slice);
            for (port, output) in PortId::enumerate(&run.nodes[node].outputs).filter(|(_, o)| o.recorded) {
                let Some(Some(once)) = values.made.get(&(self.node_ref(node), port)) else { continue };
                match self.context.sink.written_aggregate(self.run, Slot::Node { node, port }) {
                    Some(written) if written == *key => continue,
                    Some(_) => {
                        return Err(RunError::OutdatedAggregate {
                            stage: run.stage.clone(),
                            node: run.nodes[node].name.clone(),
                        });
                    }
                    None => {}
                }
                let slot = Slot::Node { node, port };
                guarded_sink(|| self.context.sink.once(self.run, slot, key, &once.value, warnings)).map_err(
                    |error| {
                        let what = format!("the aggregate value `{}/{}`", run.nodes[node].name, output.port.name);
                        RunError::Sink { stage: run.stage.clone(), what, error }
                    },
                )?;
            }
        }
        Ok(())
    }

    /// Recomputes the reused values of aggregate nodes, but only if all reused values are audited: a training may take
    /// hours. Returns how many were compared.
    pub(crate) fn audit(
        &self,
        builders: &BTreeMap<NodeRef, NodeBuilder>,
        values: &AggregateValues,
    ) -> Result<u64, RunError> {
        let run = &self.plan.runs[self.run];
        let mut compared = 0;
        for &node in &self.reused {
            let planned = &run.nodes[node];
            let (Audit::All, Contract::Once) = (self.context.audit, planned.contract) else { continue };
            let (Some(inputs), Some(builder)) = (inputs_of(planned, values), builders.get(&self.node_ref(node))) else {
                continue;
            };
            if self.context.interrupt.stops_admission() {
                break;
            }
            let host = TaskHost { key: self.keys.get(&node).copied(), ..self.host(Some(node), None) };
            let recomputed = match builder.build() {
                Ok(Instance::Once(instance)) => run_aggregate(&*instance, planned, inputs, &host),
                Ok(Instance::Pure(_) | Instance::Ordered(_)) => continue,
                Err(fault) => Err(fault),
            };
            let stored: Vec<Option<Value>> = PortId::all(planned.outputs.len())
                .map(|port| values.made.get(&(self.node_ref(node), port)).cloned().flatten().map(|once| once.value))
                .collect();
            compared += compare_aggregates(run, node, &stored, recomputed)?;
        }
        Ok(compared)
    }

    const fn node_ref(&self, node: NodeId) -> NodeRef {
        NodeRef { run: self.run, node }
    }

    fn host(&self, node: Option<NodeId>, key: Option<Key>) -> TaskHost<'_> {
        let checkpoints = key.is_some().then_some(self.context.checkpoints);
        TaskHost { key, checkpoints, ..TaskHost::new(self.context, self.run, node) }
    }

    fn perform(&self, node: NodeId, planned: &PlannedNode, key: Key, job: Job) -> Done {
        let (watch, host) = (Stopwatch::start(), self.host(Some(node), Some(key)));
        let outputs = match job {
            Job::Run(instance, inputs) => run_aggregate(&*instance, planned, inputs.unwrap_or_default(), &host),
            Job::Finish(instance, _) => {
                let mut scratch = Scratch::default();
                guarded(|| instance.finish(&mut Context::new(&host, &mut scratch)))
            }
            Job::Known(Finished { values, .. }) => {
                for (what, count) in self.context.sink.store().map(|store| store.warnings(&key)).unwrap_or_default() {
                    host.warn_n(count, &what);
                }
                return Done { outputs: Ok(values), spent: None, warnings: host.into_warnings().collect() };
            }
        };
        self.context.checkpoints.release(&key);
        let outputs = outputs.and_then(|outputs| outputs.in_order_of(&aggregate_ports(planned)));
        let spent = watch.stop(host.helpers_cpu_ns.load(Ordering::Relaxed));
        Done { outputs, spent: Some(spent), warnings: host.into_warnings().collect() }
    }
}

fn run_aggregate(
    instance: &dyn AggregateNode,
    planned: &PlannedNode,
    inputs: Vec<Option<AggregateValue>>,
    host: &TaskHost<'_>,
) -> Result<Outputs, Fault> {
    let ports: Vec<Port> = planned.inputs.iter().map(|input| input.port.clone()).collect();
    let values: Vec<_> = inputs.into_iter().map(|input| input.map(|once| once.value)).collect();
    let mut scratch = Scratch::default();
    guarded(|| instance.run(&Inputs::new(&ports, &values), &mut Context::new(host, &mut scratch)))
}
