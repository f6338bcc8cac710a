//! The audit of reuse: recomputes a sample of the values that a run reuses, and compares them with those that are stored.
//!
//! A cache key names what a value was computed from, as far as the engine can observe it. What it cannot observe (a file that a program reads
//! without declaring it, an implementation that changed under the same version, chance) is found here: some frames are computed once more
//! from the source on, and every value that would be reused on them must be equal to the last bit.
//!
//! Most of the sample is taken before the stage's first frame, so that a wrong value fails a run early. Nodes of which nothing was reused on
//! those frames are sampled after the last frame, on a random one of the frames on which they were reused.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{BuildHasher as _, RandomState};
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use depthloom_graphs::contracts::{Contract, Tap};
use depthloom_graphs::plan::StageRun;
use depthloom_graphs::ready::NodeBuilder;
use depthloom_graphs::values::Difference;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Key, Outputs, Port, Scratch, Value};
use depthloom_random::SplitMix64;
use depthloom_threads::caught;

use crate::error::RunError;
use crate::frame_graph::Feed;
use crate::host::TaskHost;
use crate::in_flight::locked;
use crate::observer::Unwatched;
use crate::once::is_once;
use crate::options::Audit;
use crate::panics::fault;
use crate::reuse::{FramePlan, Reuse};
use crate::stage::{FrameNode, Stage, process_pure};
use crate::warnings::Warnings;

/// How the kinds begin that run a program.
const PROGRAM: &str = "process";

/// One frame in so many is recomputed.
const FRAMES_PER_SAMPLE: usize = 50;

/// A reused value that differs from the recomputed one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a reused value is not what {producer} computes now{}: {what}{}", at_frame(.frame), in_recording(.stored_in))]
pub struct AuditFailure {
    /// The node, or the source, as it is named in the experiment.
    pub producer: String,
    /// The output port.
    pub port: String,
    /// The frame's id; `None` of an aggregate value.
    pub frame: Option<String>,
    /// The first difference.
    pub what: String,
    /// What may have changed although the cache key has not.
    pub cause: Cause,
    /// The recording that holds the value.
    pub stored_in: Option<String>,
}

/// What a cache key did not include.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The node gives other values each time.
    NotDeterministic,
    /// The node is a program, which may read what it does not declare.
    Program,
    /// The implementation of a kind, or a machine.
    Implementation,
    /// The data of a source.
    Data,
}

impl AuditFailure {
    /// How to proceed.
    #[must_use]
    pub fn remedy(&self) -> String {
        let cause = match self.cause {
            Cause::NotDeterministic => {
                "the node gives different values from equal inputs: make it deterministic (fix the seeds of its random numbers)"
            }
            Cause::Program => {
                "its cache key does not include what changed: declare the modules and files that the program reads (`code:`, `reads:`), pass \
                 environment variables in `env:`, or raise `version:`"
            }
            Cause::Implementation => {
                "its implementation changed without a new version of its kind, the machine computes differently, or the recording is damaged \
                 (`depthloom info --check`)"
            }
            Cause::Data => {
                "the data changed in a way that the cache key of a frame does not include, or the recording is damaged (`depthloom info --check`)"
            }
        };
        let stale = self
            .stored_in
            .as_ref()
            .map_or_else(String::new, |path| format!("; remove the run of {path}, so that no other run reuses it"));
        format!("{cause}; `--fresh` recomputes all values{stale}")
    }
}

fn at_frame(frame: &Option<String>) -> String {
    frame.as_ref().map_or_else(String::new, |frame| format!(" on frame {frame}"))
}

fn in_recording(path: &Option<String>) -> String {
    path.as_ref().map_or_else(String::new, |path| format!(" (stored in {path})"))
}

/// What of a stage run is audited, while its frames run.
pub(crate) struct Sampler {
    mode: Audit,
    state: Mutex<SamplerState>,
}

struct SamplerState {
    random: SplitMix64,
    /// By step, whether a reused value was compared.
    covered: Vec<bool>,
    /// By step that is not covered, on how many frames values were reused, and a random one of these.
    pending: BTreeMap<usize, (usize, usize)>,
}

impl Sampler {
    pub(crate) fn new(mode: Audit, steps: usize) -> Self {
        let seed = RandomState::new().hash_one(std::process::id());
        let state =
            SamplerState { random: SplitMix64::new(seed), covered: vec![false; steps], pending: BTreeMap::new() };
        Self { mode, state: Mutex::new(state) }
    }

    /// Whether anything is audited.
    pub(crate) fn is_on(&self) -> bool {
        self.mode != Audit::None
    }

    /// Notes on which frame which steps' values are reused.
    pub(crate) fn note(&self, position: usize, plan: &FramePlan) {
        if self.mode != Audit::Sample {
            return;
        }
        let SamplerState { random, covered, pending } = &mut *locked(&self.state);
        for step in (0..covered.len()).filter(|step| plan.reuses(*step)) {
            if covered[step] {
                continue;
            }
            let (seen, chosen) = pending.entry(step).or_insert((0, position));
            *seen += 1;
            if random.below(*seen) == 0 {
                *chosen = position;
            }
        }
    }

    /// The frames that are recomputed before the first one runs: `written` of them are kept from an interrupted run.
    fn early(&self, frames: usize, written: usize) -> Vec<usize> {
        match self.mode {
            Audit::None => Vec::new(),
            Audit::All => (0..frames).collect(),
            Audit::Sample => {
                let random = &mut locked(&self.state).random;
                let mut chosen = BTreeSet::new();
                for part in [0..written.min(frames), written.min(frames)..frames] {
                    if part.is_empty() {
                        continue;
                    }
                    let count = (part.len() / FRAMES_PER_SAMPLE).max(1);
                    chosen.extend((0..count).map(|_| part.start + random.below(part.len())));
                }
                chosen.into_iter().collect()
            }
        }
    }

    /// From how many first frames on an ordered node is recomputed.
    fn prefix(&self, frames: usize) -> usize {
        match self.mode {
            Audit::None => 0,
            Audit::All => frames,
            Audit::Sample => (1 + locked(&self.state).random.below((frames / FRAMES_PER_SAMPLE).max(1))).min(frames),
        }
    }

    fn cover(&self, step: usize) {
        let state = &mut *locked(&self.state);
        state.covered[step] = true;
        state.pending.remove(&step);
    }

    /// The frames on which the steps that are not covered were reused, each with its steps.
    fn late(&self) -> BTreeMap<usize, Vec<usize>> {
        let mut frames: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (step, (_, position)) in &locked(&self.state).pending {
            frames.entry(*position).or_default().push(*step);
        }
        frames
    }
}

/// Recomputes values of a stage run.
pub(crate) struct Auditor<'s, 'a, T: Tap> {
    stage: &'s Stage<'a, T>,
    reuse: &'s Reuse<'a>,
}

/// The values of one frame, as far as they were needed.
struct FrameValues {
    position: usize,
    plan: FramePlan,
    /// By step, its outputs once they were recomputed.
    computed: Vec<Option<Vec<Option<Value>>>>,
}

/// Why a step's values cannot be recomputed on a frame.
enum NotRecomputed {
    /// They depend on a node with memory whose values are not stored.
    NeedsOrderedNode,
    /// A required input is absent.
    Absent,
    /// Reading or computing failed.
    Failed(Fault),
}

impl<'s, 'a, T: Tap> Auditor<'s, 'a, T> {
    /// `None` if nothing is audited or reused.
    pub(crate) fn of(stage: &'s Stage<'a, T>) -> Option<Self> {
        let reuse = stage.reuse.as_ref().filter(|_| stage.sampler.is_on())?;
        Some(Self { stage, reuse })
    }

    /// The part of the audit before the stage's frames; gives how many values were compared.
    pub(crate) fn before_frames(&self, builders: &BTreeMap<(usize, usize), NodeBuilder>) -> Result<u64, RunError> {
        let frames = self.stage.source.frames().len();
        let mut compared = 0;
        for position in self.stage.sampler.early(frames, self.reuse.written) {
            if self.is_interrupted() {
                return Ok(compared);
            }
            compared += self.frame(position, |_| true)?;
        }
        for (node, planned) in self.stage.plan.nodes.iter().enumerate() {
            if planned.contract == Contract::Ordered
                && self.reuse.reuses_all_frames(node)
                && let Some(builder) = builders.get(&(self.stage.run, node))
            {
                compared += self.ordered(node, builder)?;
            }
        }
        Ok(compared)
    }

    /// The part behind them: the nodes of which nothing was reused on the frames of the first part.
    pub(crate) fn after_frames(&self) -> Result<u64, RunError> {
        let mut compared = 0;
        for (position, steps) in self.stage.sampler.late() {
            if self.is_interrupted() {
                break;
            }
            compared += self.frame(position, |step| steps.contains(&step))?;
        }
        Ok(compared)
    }

    fn is_interrupted(&self) -> bool {
        self.stage.interrupt.stops_admission()
    }

    /// Recomputes what is reused on a frame, of the source and of nodes without memory.
    fn frame(&self, position: usize, is_wanted: impl Fn(usize) -> bool) -> Result<u64, RunError> {
        // A frame whose key cannot be determined fails when it is read.
        let Some(mut values) = self.frame_values(position) else { return Ok(0) };
        let mut compared = 0;
        for step in 0..self.stage.graph.producers.len() {
            if !is_wanted(step) || !values.plan.reuses(step) || !self.is_recomputable(step) {
                continue;
            }
            match self.recompute(&mut values, step) {
                Ok(()) => {
                    let outputs = values.computed[step].take().unwrap_or_default();
                    let found = self.compare(&values, step, &outputs, || {
                        self.is_deterministic(&mut self.frame_values(position), step, &outputs)
                    });
                    compared += found?;
                    values.computed[step] = Some(outputs);
                    self.stage.sampler.cover(step);
                }
                Err(NotRecomputed::NeedsOrderedNode) => {}
                Err(NotRecomputed::Absent) => {
                    let what = "stored a value, and now a required input is absent".to_owned();
                    return Err(self.failure(&values, step, 0, what, None));
                }
                Err(NotRecomputed::Failed(_)) if self.is_interrupted() => return Ok(compared),
                Err(NotRecomputed::Failed(fault)) => {
                    let what = format!("stored a value, and now fails: {}", fault.chain());
                    return Err(self.failure(&values, step, 0, what, None));
                }
            }
        }
        Ok(compared)
    }

    /// Runs an ordered node that is reused again, from its first frame on.
    fn ordered(&self, node: usize, builder: &NodeBuilder) -> Result<u64, RunError> {
        let step = 1 + node;
        let Ok(Instance::Ordered(mut instance)) = builder.build() else { return Ok(0) };
        let (mut compared, mut scratch) = (0, Scratch::default());
        let frames = self.stage.source.frames();
        let prefix = self.stage.sampler.prefix(frames.len());
        for (position, frame) in frames[..prefix].iter().enumerate() {
            let Some(mut values) = self.frame_values(position).filter(|_| !self.is_interrupted()) else {
                return Ok(compared);
            };
            let inputs = match self.inputs(&mut values, step) {
                Ok(inputs) => inputs,
                Err(NotRecomputed::Absent) => continue,
                // Its memory is then another one than that of the run: nothing that follows can be compared.
                Err(NotRecomputed::NeedsOrderedNode | NotRecomputed::Failed(_)) => return Ok(compared),
            };
            let producer = &self.stage.graph.producers[step];
            let (warnings, host_of) = (Warnings::default(), position);
            let host = self.host(&warnings, Some(node), Some(host_of));
            let mut ctx = Context::new(&host, &mut scratch);
            let made = caught(|| instance.process(frame, &Inputs::new(&producer.inputs, &inputs), &mut ctx));
            let made =
                made.unwrap_or_else(|panic| Err(fault(panic))).and_then(|made| made.in_order_of(&producer.outputs));
            match made {
                Ok(outputs) => compared += self.compare(&values, step, &outputs, || None)?,
                Err(_) if self.is_interrupted() => return Ok(compared),
                Err(fault) => {
                    let what = format!("stored a value, and now fails: {}", fault.chain());
                    return Err(self.failure(&values, step, 0, what, None));
                }
            }
        }
        match &self.reuse.finished[node] {
            Some(stored) if prefix == frames.len() && !self.is_interrupted() => {
                let warnings = Warnings::default();
                let host = self.host(&warnings, Some(node), None);
                let made = caught(|| instance.finish(&mut Context::new(&host, &mut scratch)));
                let made = made.unwrap_or_else(|panic| Err(fault(panic)));
                compared += compare_aggregates(self.stage.plan, node, &stored.values, made)?;
            }
            _ => {}
        }
        Ok(compared)
    }

    /// Compares the outputs of an ordered node that ran although they are stored.
    pub(crate) fn ran_anyway(
        &self,
        position: usize,
        plan: &FramePlan,
        step: usize,
        outputs: &[Option<Value>],
    ) -> Result<(), Box<AuditFailure>> {
        self.differences(position, plan, step, outputs, || None).map(|_| ())
    }

    fn frame_values(&self, position: usize) -> Option<FrameValues> {
        let key = caught(|| self.stage.source.key(position)).ok()?.ok()?;
        let plan = self.reuse.plan(&self.stage.graph, self.stage.tap, position, key);
        Some(FrameValues { position, plan, computed: vec![None; self.stage.graph.producers.len()] })
    }

    fn is_recomputable(&self, step: usize) -> bool {
        step == 0 || matches!(self.stage.nodes[step - 1], FrameNode::Pure(_))
    }

    /// A step's outputs, from the stored or recomputed values of its inputs.
    fn recompute(&self, values: &mut FrameValues, step: usize) -> Result<(), NotRecomputed> {
        if values.computed[step].is_some() {
            return Ok(());
        }
        let inputs = self.inputs(values, step)?;
        let producer = &self.stage.graph.producers[step];
        let (warnings, mut scratch) = (Warnings::default(), Scratch::default());
        let host = self.host(&warnings, step.checked_sub(1), Some(values.position));
        let mut ctx = Context::new(&host, &mut scratch);
        let position = values.position;
        let made = caught(|| -> Result<Outputs, Fault> {
            match step.checked_sub(1).map(|node| (&self.stage.nodes[node], &self.stage.plan.nodes[node])) {
                None => Ok(self.stage.source.read(position, &mut ctx)?.outputs),
                Some((FrameNode::Pure(node), planned)) => {
                    let frame = &self.stage.source.frames()[position];
                    process_pure(&**node, planned, frame, &Inputs::new(&producer.inputs, &inputs), &mut ctx)
                }
                Some((FrameNode::Ordered(_) | FrameNode::Once, _)) => Err(Fault::new("it has memory")),
            }
        });
        let made = made.unwrap_or_else(|panic| Err(fault(panic))).and_then(|made| made.in_order_of(&producer.outputs));
        values.computed[step] = Some(made.map_err(NotRecomputed::Failed)?);
        Ok(())
    }

    /// The values at a step's inputs.
    fn inputs(&self, values: &mut FrameValues, step: usize) -> Result<Vec<Option<Value>>, NotRecomputed> {
        let producer = &self.stage.graph.producers[step];
        let mut inputs = Vec::with_capacity(producer.inputs.len());
        for (port, feed) in producer.inputs.iter().zip(&producer.feeds) {
            let value = match feed {
                Feed::Unwired | Feed::Once(None) => None,
                Feed::Once(Some(once)) => Some(once.value.clone()),
                Feed::Place { place, step: from } => {
                    self.output(values, *from, place - self.stage.graph.producers[*from].first_place)?
                }
            };
            if value.is_none() && !port.optional {
                return Err(NotRecomputed::Absent);
            }
            inputs.push(value);
        }
        Ok(inputs)
    }

    /// A value of a step: recomputed on this frame already, stored, or recomputed now.
    fn output(&self, values: &mut FrameValues, step: usize, output: usize) -> Result<Option<Value>, NotRecomputed> {
        if let Some(computed) = &values.computed[step] {
            return Ok(computed[output].clone());
        }
        if values.plan.nothing.contains(&(step, output)) {
            return Ok(None);
        }
        if let Some(key) = values.plan.stored(step, output) {
            let port = self.stage.graph.producers[step].outputs[output].name;
            let read = self.reuse.values(&[(key, port)]).map_err(NotRecomputed::Failed)?;
            return Ok(read.into_iter().next().flatten());
        }
        if !self.is_recomputable(step) {
            return Err(NotRecomputed::NeedsOrderedNode);
        }
        match self.recompute(values, step) {
            Ok(()) => Ok(values.computed[step].as_ref().and_then(|computed| computed[output].clone())),
            // Its outputs are absent, too.
            Err(NotRecomputed::Absent) => Ok(None),
            Err(other) => Err(other),
        }
    }

    /// Compares a step's outputs with those that are stored; gives how many values were compared.
    fn compare(
        &self,
        values: &FrameValues,
        step: usize,
        outputs: &[Option<Value>],
        cause: impl FnOnce() -> Option<Cause>,
    ) -> Result<u64, RunError> {
        self.differences(values.position, &values.plan, step, outputs, cause).map_err(RunError::Audit)
    }

    fn differences(
        &self,
        position: usize,
        plan: &FramePlan,
        step: usize,
        outputs: &[Option<Value>],
        cause: impl FnOnce() -> Option<Cause>,
    ) -> Result<u64, Box<AuditFailure>> {
        let ports = &self.stage.graph.producers[step].outputs;
        let mut compared = 0;
        for (output, now) in outputs.iter().enumerate() {
            let what = if let Some(key) = plan.stored(step, output) {
                compared += 1;
                self.difference(&key, &ports[output], now.as_ref())
            } else if plan.nothing.contains(&(step, output)) {
                now.as_ref().map(|_| "stored that there is no value, recomputed one".to_owned())
            } else {
                None
            };
            if let Some(what) = what {
                return Err(Box::new(self.audit_failure((position, plan), step, output, what, cause())));
            }
        }
        Ok(compared)
    }

    /// In what a value differs from the stored one.
    fn difference(&self, key: &Key, port: &Port, now: Option<&Value>) -> Option<String> {
        let stored = match self.reuse.values(&[(*key, port.name)]) {
            Ok(stored) => stored.into_iter().next().flatten(),
            Err(fault) => return Some(format!("the stored value cannot be read: {}", fault.chain())),
        };
        match (stored, now) {
            (Some(stored), Some(now)) => {
                let difference = Difference::between(&stored, now, 0.0);
                let first = difference.first?.text(port.value_type);
                Some(format!(
                    "`{}`, {first}; {} of {} numbers differ",
                    port.name, difference.different, difference.numbers
                ))
            }
            (None, None) => None,
            (Some(_), None) => Some(format!("stored a value of `{}`, recomputed none", port.name)),
            (None, Some(_)) => Some(format!("stored no value of `{}`, recomputed one", port.name)),
        }
    }

    /// Whether a step gives the same outputs once more.
    fn is_deterministic(
        &self,
        again: &mut Option<FrameValues>,
        step: usize,
        outputs: &[Option<Value>],
    ) -> Option<Cause> {
        let values = again.as_mut()?;
        self.recompute(values, step).ok()?;
        let others = values.computed[step].as_ref()?;
        let is_equal = outputs.iter().zip(others).all(|(a, b)| match (a, b) {
            (Some(a), Some(b)) => Difference::between(a, b, 0.0).different == 0,
            (a, b) => a.is_none() && b.is_none(),
        });
        (!is_equal).then_some(Cause::NotDeterministic)
    }

    fn failure(
        &self,
        values: &FrameValues,
        step: usize,
        output: usize,
        what: String,
        cause: Option<Cause>,
    ) -> RunError {
        RunError::Audit(Box::new(self.audit_failure((values.position, &values.plan), step, output, what, cause)))
    }

    fn audit_failure(
        &self,
        (position, plan): (usize, &FramePlan),
        step: usize,
        output: usize,
        what: String,
        cause: Option<Cause>,
    ) -> AuditFailure {
        let run = self.stage.plan;
        let ports = &self.stage.graph.producers[step].outputs;
        let port = ports.get(output).map_or("", |port| port.name);
        let is_program = match step.checked_sub(1) {
            None => run.source.parts.iter().any(|part| part.kind.starts_with(PROGRAM)),
            Some(node) => run.nodes[node].kind.starts_with(PROGRAM),
        };
        let kind_cause = match step {
            _ if is_program => Cause::Program,
            0 => Cause::Data,
            _ => Cause::Implementation,
        };
        AuditFailure {
            producer: match step.checked_sub(1) {
                None => format!("source `{}` of stage `{}`", run.source.name, run.stage),
                Some(node) => format!("node `{}.{}`", run.stage, run.nodes[node].name),
            },
            port: port.to_owned(),
            frame: Some(self.stage.source.frames()[position].id.to_string()),
            what,
            cause: cause.unwrap_or(kind_cause),
            stored_in: plan.stored(step, output).and_then(|key| self.reuse.origin(&key, port)),
        }
    }

    fn host<'h>(&'h self, warnings: &'h Warnings, node: Option<usize>, position: Option<usize>) -> TaskHost<'h> {
        TaskHost {
            budget: self.stage.budget,
            interrupt: self.stage.interrupt,
            observer: &Unwatched,
            warnings,
            run: self.stage.run,
            node,
            position,
            once: None,
            helpers_cpu_ns: AtomicU64::new(0),
            told: Mutex::default(),
            is_repeated: true,
        }
    }
}

/// Compares the aggregate values of a reused node with recomputed ones; gives how many were compared.
pub(crate) fn compare_aggregates(
    run: &StageRun,
    node: usize,
    stored: &[Option<Value>],
    made: Result<Outputs, Fault>,
) -> Result<u64, RunError> {
    let planned = &run.nodes[node];
    let ports: Vec<Port> =
        planned.outputs.iter().map(|output| &output.port).filter(|port| is_once(planned, port)).cloned().collect();
    let failure = |port: &str, what: String| {
        RunError::Audit(Box::new(AuditFailure {
            producer: format!("node `{}.{}`", run.stage, planned.name),
            port: port.to_owned(),
            frame: None,
            what,
            cause: if planned.kind.starts_with(PROGRAM) { Cause::Program } else { Cause::Implementation },
            stored_in: None,
        }))
    };
    let made = made.and_then(|made| made.in_order_of(&ports));
    let made = made.map_err(|fault| failure("", format!("stored a value, and now fails: {}", fault.chain())))?;
    for ((port, stored), now) in ports.iter().zip(stored).zip(&made) {
        let what = match (stored, now) {
            (Some(stored), Some(now)) => {
                let first = Difference::between(stored, now, 0.0).first;
                first.map(|first| format!("`{}`, {}", port.name, first.text(port.value_type)))
            }
            (None, None) => None,
            (Some(_), None) => Some(format!("stored a value of `{}`, recomputed none", port.name)),
            (None, Some(_)) => Some(format!("stored no value of `{}`, recomputed one", port.name)),
        };
        if let Some(what) = what {
            return Err(failure(port.name, what));
        }
    }
    Ok(stored.iter().flatten().count() as u64)
}
