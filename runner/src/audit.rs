//! The audit of reuse: recomputes a sample of the values that a run reuses, and compares them with those that are stored.
//!
//! A cache key names what a value was computed from, as far as the engine can observe it. What it cannot observe (a file that a program reads
//! without declaring it, an implementation that changed under the same version, chance) is found here: some frames are computed once more
//! from the source on, and every value that would be reused on them must be equal to the last bit.
//!
//! Most of the sample is taken before the stage's first frame, so that a wrong value fails a run early. Nodes of which nothing was reused on
//! those frames are sampled after the last frame, on a random one of the frames on which they were reused.

pub(crate) mod comparison;
pub(crate) mod failure;
pub(crate) mod sample;

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use depthloom_graphs::contracts::{Contract, Tap};
use depthloom_graphs::plan::{FrameIndex, NodeId, NodeRef};
use depthloom_graphs::ready::NodeBuilder;
use depthloom_graphs::values::ValueDifference;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Outputs, Scratch, Value};
use depthloom_threads::caught;

use self::comparison::{Comparison, compare_aggregates};
use self::failure::Cause;
use crate::error::RunError;
use crate::host::TaskHost;
use crate::observer::Unwatched;
use crate::panics::fault;
use crate::reuse::{FramePlan, Reuse};
use crate::stage::frame_graph::{Feed, OutputId, StepId, StepOutput};
use crate::stage::{FrameNode, Stage, process_pure};
use crate::warnings::Warnings;

/// Recomputes values of a stage run.
pub(crate) struct Auditor<'s, 'a, T: Tap> {
    stage: &'s Stage<'a, T>,
    reuse: &'s Reuse<'a>,
    comparison: Comparison<'s>,
}

/// The values of one frame, as far as they were needed.
struct FrameValues {
    position: FrameIndex,
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
        Some(Self { stage, reuse: stage.reuse.as_ref()?, comparison: stage.comparison()? })
    }

    /// The part of the audit before the stage's frames; gives how many values were compared.
    pub(crate) fn before_frames(&self, builders: &BTreeMap<NodeRef, NodeBuilder>) -> Result<u64, RunError> {
        let frames = self.stage.source.frames().len();
        let mut compared = 0;
        for position in self.stage.sampler.early(frames, self.reuse.written) {
            if self.is_interrupted() {
                return Ok(compared);
            }
            compared += self.frame(position, |_| true)?;
        }
        for (node, planned) in NodeId::enumerate(&self.stage.plan.nodes) {
            if planned.contract == Contract::Ordered
                && self.reuse.reuses_all_frames(node)
                && let Some(builder) = builders.get(&NodeRef { run: self.stage.run, node })
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
    fn frame(&self, position: FrameIndex, is_wanted: impl Fn(StepId) -> bool) -> Result<u64, RunError> {
        // A frame whose key cannot be determined fails when it is read.
        let Some(mut values) = self.frame_values(position) else { return Ok(0) };
        let mut compared = 0;
        for step in StepId::all(self.stage.graph.producers.len()) {
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
                    return Err(self.failure(&values, step, what));
                }
                Err(NotRecomputed::Failed(_)) if self.is_interrupted() => return Ok(compared),
                Err(NotRecomputed::Failed(fault)) => {
                    let what = format!("stored a value, and now fails: {}", fault.chain());
                    return Err(self.failure(&values, step, what));
                }
            }
        }
        Ok(compared)
    }

    /// Runs an ordered node that is reused again, from its first frame on.
    fn ordered(&self, node: NodeId, builder: &NodeBuilder) -> Result<u64, RunError> {
        let step = StepId::of_node(node);
        let Ok(Instance::Ordered(mut instance)) = builder.build() else { return Ok(0) };
        let (mut compared, mut scratch) = (0, Scratch::default());
        let frames = self.stage.source.frames();
        let prefix = self.stage.sampler.prefix(frames.len());
        for (position, frame) in FrameIndex::enumerate(&frames[..prefix]) {
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
            let warnings = Warnings::default();
            let host = self.host(&warnings, Some(node), Some(position));
            let mut ctx = Context::new(&host, &mut scratch);
            let made = caught(|| instance.process(frame, &Inputs::new(&producer.inputs, &inputs), &mut ctx));
            let made =
                made.unwrap_or_else(|panic| Err(fault(panic))).and_then(|made| made.in_order_of(&producer.outputs));
            match made {
                Ok(outputs) => compared += self.compare(&values, step, &outputs, || None)?,
                Err(_) if self.is_interrupted() => return Ok(compared),
                Err(fault) => {
                    let what = format!("stored a value, and now fails: {}", fault.chain());
                    return Err(self.failure(&values, step, what));
                }
            }
        }
        match &self.reuse.finished[node] {
            Some(stored) if prefix == frames.len() && !self.is_interrupted() => {
                let warnings = Warnings::default();
                let host = TaskHost { key: Some(stored.key), ..self.host(&warnings, Some(node), None) };
                let made = caught(|| instance.finish(&mut Context::new(&host, &mut scratch)));
                let made = made.unwrap_or_else(|panic| Err(fault(panic)));
                compared += compare_aggregates(self.stage.plan, node, &stored.values, made)?;
            }
            _ => {}
        }
        Ok(compared)
    }

    fn frame_values(&self, position: FrameIndex) -> Option<FrameValues> {
        let key = caught(|| self.stage.source.key(position)).ok()?.ok()?;
        let plan = self.reuse.plan(&self.stage.graph, self.stage.tap, position, key);
        Some(FrameValues { position, plan, computed: vec![None; self.stage.graph.producers.len()] })
    }

    fn is_recomputable(&self, step: StepId) -> bool {
        step.node().is_none_or(|node| matches!(self.stage.nodes[node], FrameNode::Pure(_)))
    }

    /// A step's outputs, from the stored or recomputed values of its inputs.
    fn recompute(&self, values: &mut FrameValues, step: StepId) -> Result<(), NotRecomputed> {
        if values.computed[step].is_some() {
            return Ok(());
        }
        let inputs = self.inputs(values, step)?;
        let producer = &self.stage.graph.producers[step];
        let (warnings, mut scratch) = (Warnings::default(), Scratch::default());
        let host = self.host(&warnings, step.node(), Some(values.position));
        let mut ctx = Context::new(&host, &mut scratch);
        let position = values.position;
        let made = caught(|| -> Result<Outputs, Fault> {
            match step.node().map(|node| (&self.stage.nodes[node], &self.stage.plan.nodes[node])) {
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
    fn inputs(&self, values: &mut FrameValues, step: StepId) -> Result<Vec<Option<Value>>, NotRecomputed> {
        let producer = &self.stage.graph.producers[step];
        let mut inputs = Vec::with_capacity(producer.inputs.len());
        for (port, feed) in producer.inputs.iter().zip(&producer.feeds) {
            let value = match feed {
                Feed::Unwired | Feed::Once(None) => None,
                Feed::Once(Some(once)) => Some(once.value.clone()),
                Feed::Place { place, step: from } => {
                    let output = self.stage.graph.producers[*from].output_at(*place);
                    self.output(values, StepOutput { step: *from, output })?
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
    fn output(&self, values: &mut FrameValues, of_step: StepOutput) -> Result<Option<Value>, NotRecomputed> {
        let StepOutput { step, output } = of_step;
        if let Some(computed) = &values.computed[step] {
            return Ok(computed[output].clone());
        }
        if values.plan.absent.contains(&of_step) {
            return Ok(None);
        }
        if let Some(key) = values.plan.stored(of_step) {
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
        step: StepId,
        outputs: &[Option<Value>],
        cause: impl FnOnce() -> Option<Cause>,
    ) -> Result<u64, RunError> {
        self.comparison.differences(values.position, &values.plan, step, outputs, cause).map_err(RunError::Audit)
    }

    /// Whether a step gives the same outputs once more.
    fn is_deterministic(
        &self,
        again: &mut Option<FrameValues>,
        step: StepId,
        outputs: &[Option<Value>],
    ) -> Option<Cause> {
        let values = again.as_mut()?;
        self.recompute(values, step).ok()?;
        let others = values.computed[step].as_ref()?;
        let is_equal = outputs.iter().zip(others).all(|(a, b)| match (a, b) {
            (Some(a), Some(b)) => ValueDifference::between(a, b, 0.0).different == 0,
            (a, b) => a.is_none() && b.is_none(),
        });
        (!is_equal).then_some(Cause::NotDeterministic)
    }

    fn failure(&self, values: &FrameValues, step: StepId, what: String) -> RunError {
        let first = StepOutput { step, output: OutputId(0) };
        RunError::Audit(Box::new(self.comparison.failure((values.position, &values.plan), first, what, None)))
    }

    fn host<'h>(&'h self, warnings: &'h Warnings, node: Option<NodeId>, position: Option<FrameIndex>) -> TaskHost<'h> {
        TaskHost {
            budget: self.stage.budget,
            interrupt: self.stage.interrupt,
            observer: &Unwatched,
            warnings,
            run: self.stage.run,
            node,
            position,
            key: None,
            checkpoints: None,
            helpers_cpu_ns: AtomicU64::new(0),
            reported: Mutex::default(),
            is_repeated: true,
        }
    }
}
