//! Once-values: what ordered nodes give when they finish, what once-nodes make of it, and who finds it where.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use depthloom_graphs::contracts::{Contract, Slot, Tap, TapError};
use depthloom_graphs::plan::{From, Plan, PlannedNode};
use depthloom_graphs::{
    Context, Fault, Host as _, Inputs, Key, OnceNode, OrderedNode, Port, Rate, Scratch, Value, value_keys,
};

use crate::error::RunError;
use crate::host::TaskHost;
use crate::in_flight::locked;
use crate::panics::caught;
use crate::retire::Passage;
use crate::stage::Surroundings;
use crate::timing::{Phase, Spent, Stopwatch, Timing};
use crate::wiring::OnceValue;

/// The once-values there are so far.
pub(crate) struct OnceValues {
    files: BTreeMap<PathBuf, Value>,
    /// By stage run, node and port; `None` where the node left an optional output out.
    made: HashMap<(usize, usize, usize), Option<OnceValue>>,
}

impl OnceValues {
    pub(crate) fn new(files: BTreeMap<PathBuf, Value>) -> Self {
        Self { files, made: HashMap::new() }
    }

    /// What is wired to a once-input, if it is there yet.
    pub(crate) fn find(&self, from: &From) -> Option<Option<OnceValue>> {
        match from {
            From::Here(_) => None,
            From::Once { run, node, port } => self.made.get(&(*run, *node, *port)).cloned(),
            From::File(path) => {
                let value = self.files.get(path)?;
                Some(Some(OnceValue { value: value.clone(), key: content(value)? }))
            }
        }
    }
}

/// An artefact's content hash.
fn content(value: &Value) -> Option<Key> {
    match value {
        Value::Model(artifact) | Value::Samples(artifact) => Some(artifact.hash),
        Value::Image(_)
        | Value::Disparity(_)
        | Value::Depth(_)
        | Value::Weight(_)
        | Value::Mask(_)
        | Value::Calibration(_)
        | Value::Scores(_)
        | Value::Curve(_) => None,
    }
}

/// Work outside frames.
pub(crate) enum Job {
    /// A once-node, and what is at its inputs; `None` if a required one is absent.
    Fire(Box<dyn OnceNode>, Option<Vec<Option<OnceValue>>>),
    /// An ordered node after its last frame, and its key there.
    Finish(Box<dyn OrderedNode>, Option<Key>),
}

/// A stage run's work outside frames.
pub(crate) struct OnceWork<'a, T> {
    pub(crate) run: usize,
    pub(crate) plan: &'a Plan,
    pub(crate) around: &'a Surroundings<'a, T>,
    /// The once-nodes that have not fired yet, by index.
    pub(crate) waiting: BTreeMap<usize, Box<dyn OnceNode>>,
    /// The key of each node that gave once-values, by index.
    pub(crate) keys: BTreeMap<usize, Key>,
    pub(crate) timings: Vec<Timing>,
}

impl<T: Tap> OnceWork<'_, T> {
    /// Fires every once-node whose inputs are there, and those whose inputs these give, and so on.
    pub(crate) fn fire_all(&mut self, values: &mut OnceValues) -> Result<Passage, RunError> {
        loop {
            let nodes = &self.plan.runs[self.run].nodes;
            let ready = self.waiting.extract_if(.., |node, _| inputs_of(&nodes[*node], values).is_some());
            let ready: Vec<_> = ready.collect();
            if ready.is_empty() {
                return Ok(Passage::Whole);
            }
            let with_inputs = |(node, instance): (usize, Box<dyn OnceNode>)| {
                let inputs = inputs_of(&nodes[node], values).unwrap_or_default();
                let is_absent = inputs.iter().zip(&nodes[node].inputs).any(|(v, i)| v.is_none() && !i.port.optional);
                (node, Job::Fire(instance, (!is_absent).then_some(inputs)))
            };
            let jobs = ready.into_iter().map(with_inputs).collect();
            if self.do_all(jobs, values)? == Passage::Interrupted {
                return Ok(Passage::Interrupted);
            }
        }
    }

    /// Does jobs that do not depend on each other, as many at once as there are workers.
    pub(crate) fn do_all(&mut self, jobs: Vec<(usize, Job)>, values: &mut OnceValues) -> Result<Passage, RunError> {
        if jobs.is_empty() {
            return Ok(Passage::Whole);
        }
        if self.around.interrupt.stops_admission() {
            return Ok(Passage::Interrupted);
        }
        let nodes = &self.plan.runs[self.run].nodes;
        let jobs: Vec<_> =
            jobs.into_iter().map(|(node, job)| (node, Mutex::new(Some(job)), Mutex::new(None))).collect();
        let permit = self.around.budget.permit();
        self.host(None, None).tiles(jobs.len(), &|i| {
            let (node, job, done) = &jobs[i];
            if let Some(job) = locked(job).take() {
                *locked(done) = Some(self.perform(*node, &nodes[*node], job));
            }
        });
        drop(permit);
        if self.around.interrupt.aborts() {
            return Err(RunError::Aborted);
        }
        let mut passage = Passage::Whole;
        for (node, _, done) in jobs {
            let Some((made, spent)) = locked(&done).take() else { continue };
            if matches!(made, Err(Fault::Cancelled)) && self.around.interrupt.stops_admission() {
                // It was asked to, and put down where it is.
                passage = Passage::Interrupted;
                continue;
            }
            let planned = &nodes[node];
            let made = made.map_err(|fault| RunError::OnceFailed {
                stage: self.plan.runs[self.run].stage.clone(),
                node: planned.name.clone(),
                variants: planned.variant_names(self.plan).into_iter().map(str::to_owned).collect(),
                fault: Box::new(fault),
            })?;
            let fired = made.is_some();
            let (key, outputs) = made.map_or((None, Vec::new()), |(key, outputs)| (Some(key), outputs));
            let mut outputs = outputs.into_iter();
            for (port, output) in planned.outputs.iter().enumerate().filter(|(_, o)| is_once(planned, &o.port)) {
                let value = outputs.next().flatten();
                let keyed = value.zip(key).map(|(value, key)| {
                    let key = content(&value).unwrap_or_else(|| value_keys::port(&key, output.port.name));
                    OnceValue { value, key }
                });
                values.made.insert((self.run, node, port), keyed);
            }
            self.keys.extend(key.map(|key| (node, key)));
            if fired {
                let mut timing = Timing::new(self.run, planned.name.clone(), Phase::Once(node));
                timing.add(0, spent);
                self.timings.push(timing);
            }
        }
        Ok(passage)
    }

    /// Hands the once-values that are recorded to the tap, in plan order.
    pub(crate) fn hand_over(&self, values: &OnceValues) -> Result<(), RunError> {
        let run = &self.plan.runs[self.run];
        for (&node, key) in &self.keys {
            for (port, output) in run.nodes[node].outputs.iter().enumerate().filter(|(_, o)| o.recorded) {
                let Some(Some(once)) = values.made.get(&(self.run, node, port)) else { continue };
                caught(|| self.around.tap.once(self.run, Slot::Node { node, port }, key, &once.value))
                    .unwrap_or_else(|panic| Err(TapError::new(format!("panicked {}", panic.0))))
                    .map_err(|error| {
                        let what = format!("the once-value `{}/{}`", run.nodes[node].name, output.port.name);
                        RunError::Tap { stage: run.stage.clone(), what, error }
                    })?;
            }
        }
        Ok(())
    }

    fn host(&self, node: Option<usize>, key: Option<Key>) -> TaskHost<'_> {
        let Surroundings { budget, interrupt, observer, warnings, checkpoints, .. } = *self.around;
        let (run, helpers_cpu_ns) = (self.run, AtomicU64::new(0));
        let once = key.map(|key| (key, checkpoints));
        TaskHost { budget, interrupt, observer, warnings, run, node, once, helpers_cpu_ns }
    }

    /// The key and the once-values by port, or `None` if the node did not fire.
    #[expect(clippy::type_complexity, reason = "read in one place only")]
    fn perform(
        &self,
        node: usize,
        planned: &PlannedNode,
        job: Job,
    ) -> (Result<Option<(Key, Vec<Option<Value>>)>, Fault>, Spent) {
        let key = match &job {
            Job::Fire(_, inputs) => {
                let Some(inputs) = inputs else { return (Ok(None), Spent::default()) };
                let keys: Vec<_> = inputs.iter().map(|input| input.as_ref().map(|once| once.key)).collect();
                value_keys::once(&planned.recipe, &keys)
            }
            Job::Finish(_, last) => value_keys::finished(&planned.recipe, last.as_ref()),
        };
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
        };
        self.around.checkpoints.release(&key);
        let made = made.unwrap_or_else(|panic| Err(panic.into())).and_then(|given| given.in_order_of(&ports));
        let made = made.map(|values| (key, values));
        (made.map(Some), watch.stop(host.helpers_cpu_ns.into_inner()))
    }
}

/// Whether a node's output is a once-value.
fn is_once(node: &PlannedNode, port: &Port) -> bool {
    node.contract == Contract::Once || port.rate == Rate::Once
}

/// What is at a once-node's inputs; `None` while one of them is not there yet.
fn inputs_of(node: &PlannedNode, values: &OnceValues) -> Option<Vec<Option<OnceValue>>> {
    node.inputs.iter().map(|input| input.from.as_ref().map_or(Some(None), |from| values.find(from))).collect()
}
