//! The audit of reuse: recomputes a sample of the reused values and compares them bit for bit.
//!
//! It finds what a cache key cannot observe: undeclared files of a program, an implementation that changed under the
//! same version, chance. Most of the sample is taken before the stage's first frame, so that a wrong value fails a run
//! early. Nodes without reused values on those frames are sampled after the last frame.

pub(crate) mod comparison;
pub(crate) mod failure;
pub(crate) mod sample;

use std::collections::BTreeMap;

use depthloom_graphs::contracts::{Contract, Sink};
use depthloom_graphs::plan::{FrameIndex, NodeId, NodeRef};
use depthloom_graphs::ready::NodeBuilder;
use depthloom_graphs::values::ValueDifference;
use depthloom_graphs::{Context, Fault, Inputs, Instance, Scratch, Value};

use self::comparison::{Comparison, compare_aggregates, now_fails};
use self::failure::Cause;
use crate::error::RunError;
use crate::host::TaskHost;
use crate::observer::Unwatched;
use crate::panics::guarded;
use crate::reuse::{FramePlan, Reuse};
use crate::stage::frame_graph::{Feed, OutputId, StepId, StepOutput};
use crate::stage::{FrameNode, Stage, process_pure};
use crate::warnings::Warnings;

pub(crate) struct Auditor<'s, 'a, T: Sink> {
    stage: &'s Stage<'a, T>,
    reuse: &'s Reuse<'a>,
    comparison: Comparison<'s>,
}

struct FrameValues {
    position: FrameIndex,
    plan: FramePlan,
    /// By step, its outputs if they were recomputed.
    computed: Vec<Option<Vec<Option<Value>>>>,
}

/// Why a step's values cannot be recomputed on a frame.
enum NotRecomputed {
    /// They depend on an ordered node whose values are not stored.
    NeedsOrderedNode,
    /// A required input is absent.
    Absent,
    Failed(Fault),
}

impl<'s, 'a, T: Sink> Auditor<'s, 'a, T> {
    /// `None` if nothing is audited or reused.
    pub(crate) fn new(stage: &'s Stage<'a, T>) -> Option<Self> {
        Some(Self { stage, reuse: stage.reuse.as_ref()?, comparison: stage.comparison()? })
    }

    /// Returns how many values were compared.
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

    /// Audits the nodes without reused values on the frames sampled before.
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
        self.stage.context.interrupt.stops_admission()
    }

    /// Recomputes the reused values of a frame: of the source and of pure nodes.
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
                    compared +=
                        self.compare(&values, step, &outputs, || self.recompute_again(position, step, &outputs))?;
                    values.computed[step] = Some(outputs);
                    self.stage.sampler.cover(step);
                }
                Err(NotRecomputed::NeedsOrderedNode) => {}
                Err(NotRecomputed::Absent) => {
                    let what = "stored a value, and now a required input is absent".to_owned();
                    return Err(self.failure(&values, step, what));
                }
                Err(NotRecomputed::Failed(_)) if self.is_interrupted() => return Ok(compared),
                Err(NotRecomputed::Failed(fault)) => return Err(self.failure(&values, step, now_fails(&fault))),
            }
        }
        Ok(compared)
    }

    /// Runs a reused ordered node again, from its first frame.
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
                // Its state then differs from that of the run: nothing that follows can be compared.
                Err(NotRecomputed::NeedsOrderedNode | NotRecomputed::Failed(_)) => return Ok(compared),
            };
            let producer = &self.stage.graph.producers[step];
            let warnings = Warnings::default();
            let host = self.host(&warnings, Some(node), Some(position));
            let mut ctx = Context::new(&host, &mut scratch);
            let outputs = guarded(|| instance.process(frame, &Inputs::new(&producer.inputs, &inputs), &mut ctx));
            match outputs.and_then(|outputs| outputs.in_order_of(&producer.outputs)) {
                Ok(outputs) => compared += self.compare(&values, step, &outputs, || None)?,
                Err(_) if self.is_interrupted() => return Ok(compared),
                Err(fault) => return Err(self.failure(&values, step, now_fails(&fault))),
            }
        }
        match &self.reuse.finished[node] {
            Some(stored) if prefix == frames.len() && !self.is_interrupted() => {
                let warnings = Warnings::default();
                let host = TaskHost { key: Some(stored.key), ..self.host(&warnings, Some(node), None) };
                let outputs = guarded(|| instance.finish(&mut Context::new(&host, &mut scratch)));
                compared += compare_aggregates(self.stage.plan, node, &stored.values, outputs)?;
            }
            _ => {}
        }
        Ok(compared)
    }

    fn frame_values(&self, position: FrameIndex) -> Option<FrameValues> {
        let key = guarded(|| self.stage.source.key(position)).ok()?;
        let plan = self.reuse.plan(&self.stage.graph, self.stage.context.sink, position, key);
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
        let outputs =
            guarded(|| match step.node().map(|node| (&self.stage.nodes[node], &self.stage.plan.nodes[node])) {
                None => Ok(self.stage.source.read(position, &mut ctx)?.outputs),
                Some((FrameNode::Pure(node), planned)) => {
                    let frame = &self.stage.source.frames()[position];
                    process_pure(&**node, planned, frame, &Inputs::new(&producer.inputs, &inputs), &mut ctx)
                }
                Some((FrameNode::Ordered(_) | FrameNode::Once | FrameNode::Omitted, _)) => {
                    Err(Fault::new("it is not a pure node"))
                }
            });
        let outputs = outputs.and_then(|outputs| outputs.in_order_of(&producer.outputs));
        values.computed[step] = Some(outputs.map_err(NotRecomputed::Failed)?);
        Ok(())
    }

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

    /// A value of a step: recomputed before, stored, or recomputed now.
    fn output(&self, values: &mut FrameValues, id: StepOutput) -> Result<Option<Value>, NotRecomputed> {
        let StepOutput { step, output } = id;
        if let Some(computed) = &values.computed[step] {
            return Ok(computed[output].clone());
        }
        if values.plan.absent.contains(&id) {
            return Ok(None);
        }
        if let Some(key) = values.plan.stored(id) {
            let port = self.stage.graph.producers[step].outputs[output].name;
            let read = self.reuse.store.values(&[(key, port)]).map_err(NotRecomputed::Failed)?;
            return Ok(read.into_iter().next().flatten());
        }
        if !self.is_recomputable(step) {
            return Err(NotRecomputed::NeedsOrderedNode);
        }
        match self.recompute(values, step) {
            Ok(()) => Ok(values.computed[step].as_ref().and_then(|computed| computed[output].clone())),
            Err(NotRecomputed::Absent) => Ok(None),
            Err(other) => Err(other),
        }
    }

    fn compare(
        &self,
        values: &FrameValues,
        step: StepId,
        outputs: &[Option<Value>],
        cause: impl FnOnce() -> Option<Cause>,
    ) -> Result<u64, RunError> {
        self.comparison.differences(values.position, &values.plan, step, outputs, cause).map_err(RunError::Audit)
    }

    /// Whether a step is not deterministic.
    fn recompute_again(&self, position: FrameIndex, step: StepId, outputs: &[Option<Value>]) -> Option<Cause> {
        let mut values = self.frame_values(position)?;
        self.recompute(&mut values, step).ok()?;
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
        let host = TaskHost::new(self.stage.context, self.stage.run, node);
        TaskHost { observer: &Unwatched, warnings, position, is_repeated: true, ..host }
    }
}
