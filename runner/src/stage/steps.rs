//! The steps of a frame: reading it, running a node, encoding a part.

use std::sync::atomic::Ordering;

use depthloom_graphs::contracts::{Sink, Slot, StoredValue};
use depthloom_graphs::plan::{FrameIndex, NodeId, PartId, PlannedNode};
use depthloom_graphs::value_keys::{self, Observed};
use depthloom_graphs::{Context, Fault, Frame, Host as _, Inputs, Key, Outputs, Scratch, SourceOutputs, Value};
use depthloom_threads::locked;

use super::{FrameNode, Stage, process_pure};
use crate::host::TaskHost;
use crate::panics::{guarded, guarded_sink};
use crate::reuse::{FramePlan, Reuse, StepAction};
use crate::stage::frame_graph::{Feed, OutputId, StepId, StepOutput};
use crate::stage::in_flight::{InFlight, Outcome, Settled};
use crate::timing::{Spent, Stopwatch};

/// What a worker keeps between tasks.
#[derive(Default)]
pub(super) struct WorkerState {
    scratch: Scratch,
    inputs: Vec<Option<Value>>,
    keys: Vec<Option<Key>>,
    values: Vec<(Slot, Value)>,
    /// When the previous task ended, unless the worker rested since: the next one starts there. Reading a thread's CPU
    /// time is a system call, a good part of the engine's cost per task, so the work between two tasks counts with the
    /// second.
    since: Option<Stopwatch>,
}

impl WorkerState {
    fn start(&mut self) -> Stopwatch {
        self.since.take().unwrap_or_else(Stopwatch::start)
    }

    fn stop(&mut self, watch: Stopwatch, host: &TaskHost<'_>) -> Spent {
        let (spent, now) = watch.lap(host.helpers_cpu_ns.load(Ordering::Relaxed));
        self.since = Some(now);
        spent
    }

    pub(super) const fn rest(&mut self) {
        self.since = None;
    }
}

/// The remedy where the store cannot be read.
const FRESH: &str = "run with --fresh, which takes nothing from earlier runs";

impl<T: Sink> Stage<'_, T> {
    pub(super) fn read(&self, frame: &InFlight<T::Part>, worker: &mut WorkerState) -> Settled {
        let (watch, host) = (worker.start(), self.host(None, frame.position));
        let mut ctx = Context::new(&host, &mut worker.scratch);
        let read = guarded(|| {
            if let Some(arrival) = &frame.arrival {
                let read = locked(&arrival.read).take();
                let SourceOutputs { outputs, key } = read.ok_or_else(|| Fault::new("the frame was read before"))?;
                return Ok(Some((outputs.in_order_of(&self.graph.producers[StepId::SOURCE].outputs)?, key)));
            }
            // The key decides whether the frame is read at all. What was read must have the same key.
            let key = self.source.key(frame.position)?;
            if let Some(reuse) = &self.reuse {
                let plan = reuse.plan(&self.graph, self.context.sink, frame.position, key);
                let plan = frame.plan.get_or_init(|| plan);
                self.sampler.note(frame.position, plan);
                self.load(frame, plan, reuse)?;
                if plan.steps[StepId::SOURCE] != StepAction::Run {
                    return Ok(None);
                }
            }
            let read = self.source.read(frame.position, &mut ctx)?;
            if read.key != key {
                return Err(Fault::new("the frame's files changed while they were read").remedy("run again"));
            }
            Ok(Some((read.outputs.in_order_of(&self.graph.producers[StepId::SOURCE].outputs)?, read.key)))
        });
        let spent = worker.stop(watch, &host);
        match read.transpose() {
            // The time for looking up and loading belongs to no step.
            None => self.reuse(frame, StepId::SOURCE),
            Some(read) => {
                frame.add_warnings(host.into_warnings());
                self.close(frame, StepId::SOURCE, read, spent)
            }
        }
    }

    /// Reads the stored values that nodes need, all of a frame at once, so that neighbours are read once.
    fn load(&self, frame: &InFlight<T::Part>, plan: &FramePlan, reuse: &Reuse<'_>) -> Result<(), Fault> {
        let (mut wanted, mut places) = (Vec::new(), Vec::new());
        for (producer, action) in self.graph.producers.iter().zip(&plan.steps) {
            let StepAction::Reuse(key, load) = action else { continue };
            for &output in load {
                wanted.push((*key, producer.outputs[output].name));
                places.push(producer.place(output));
            }
        }
        let values = reuse.store.values(&wanted).map_err(|fault| fault.remedy(FRESH))?;
        let loaded = places.into_iter().zip(values).filter_map(|(place, value)| Some((place, value?)));
        locked(&frame.loaded).extend(loaded);
        for absent in &plan.absent {
            frame.add_absent(*absent);
        }
        Ok(())
    }

    /// Ends a step that does not run, with the values loaded from the store.
    fn reuse(&self, frame: &InFlight<T::Part>, step: StepId) -> Settled {
        let (StepAction::Reuse(key, load), Some(reuse)) = (frame.action(step), &self.reuse) else {
            return Settled::at_once(Outcome::Absent);
        };
        let host = self.host(step.node(), frame.position);
        for (what, count) in reuse.store.warnings(key) {
            host.warn_n(count, &what);
        }
        frame.add_warnings(host.into_warnings());
        let producer = &self.graph.producers[step];
        for &output in load {
            let place = producer.place(output);
            if let Some(value) = locked(&frame.loaded).remove(&place) {
                frame.put(place, value, Some(value_keys::port(key, producer.outputs[output].name)));
            }
        }
        Settled::at_once(Outcome::Reused(*key))
    }

    pub(super) fn run_node(&self, frame: &InFlight<T::Part>, node: NodeId, worker: &mut WorkerState) -> Settled {
        let step = StepId::of_node(node);
        if matches!(self.nodes[node], FrameNode::Omitted) {
            return Settled::at_once(Outcome::Absent);
        }
        if *frame.action(step) != StepAction::Run {
            self.drop_inputs(frame, step);
            return self.reuse(frame, step);
        }
        if let Some(outcome) = self.gather(frame, step, worker) {
            worker.inputs.clear();
            return Settled::at_once(outcome);
        }
        let producer = &self.graph.producers[step];
        let planned = &self.plan.nodes[node];
        let (node_hash, instant) = (&planned.node_hash, &frame.frame);
        let (watch, host) = (worker.start(), self.host(Some(node), frame.position));
        let inputs = Inputs::new(&producer.inputs, &worker.inputs);
        let mut ctx = Context::new(&host, &mut worker.scratch);
        let in_order = |outputs: Outputs| outputs.in_order_of(&producer.outputs);
        let result = match &self.nodes[node] {
            FrameNode::Pure(pure) => {
                let process = || guarded(|| process_pure(&**pure, planned, instant, &inputs, &mut ctx));
                with_files(planned, instant, process).and_then(|(outputs, files)| {
                    let observed = planned.observes.as_ref().map(|_| Observed { frame: instant, files });
                    let key = value_keys::pure(node_hash, observed, &worker.keys);
                    let key =
                        locked(&host.observed).take().map_or(key, |observed| value_keys::disturbed(&key, &observed));
                    Ok((in_order(outputs)?, key))
                })
            }
            FrameNode::Ordered(ordered) => {
                let mut state = locked(&ordered.state);
                let result = match state.node.as_mut() {
                    Some(node) => with_files(planned, instant, || guarded(|| node.process(instant, &inputs, &mut ctx))),
                    None => Err(Fault::new("not run: failed on an earlier frame")),
                };
                let result = result.and_then(|(outputs, files)| Ok((in_order(outputs)?, files)));
                match result {
                    Err(fault) => {
                        state.node = None;
                        Err(fault)
                    }
                    Ok((values, files)) => {
                        self.audit_again(frame, step, &values);
                        let observed = Observed { frame: instant, files };
                        let key = value_keys::ordered(node_hash, state.last_key.as_ref(), observed, &worker.keys);
                        // Whatever else decided the values must differ in a run that reuses them.
                        let key = locked(&host.observed)
                            .take()
                            .map_or(key, |observed| value_keys::disturbed(&key, &observed));
                        state.last_key = Some(key);
                        Ok((values, key))
                    }
                }
            }
            FrameNode::Once | FrameNode::Omitted => Err(Fault::new("an aggregate node does not see frames")),
        };
        let spent = worker.stop(watch, &host);
        frame.add_warnings(host.into_warnings());
        worker.inputs.clear();
        self.close(frame, step, result, spent)
    }

    /// Drops the inputs of a node that does not run.
    fn drop_inputs(&self, frame: &InFlight<T::Part>, step: StepId) {
        for feed in &self.graph.producers[step].feeds {
            if let Feed::Place { place, .. } = feed {
                drop(frame.take(*place));
            }
        }
    }

    /// Compares the outputs of an ordered node that ran again with the stored ones under their key.
    fn audit_again(&self, frame: &InFlight<T::Part>, step: StepId, outputs: &[Option<Value>]) {
        let (Some(plan), Some(comparison)) = (frame.plan.get(), self.comparison()) else { return };
        if let Err(failure) = comparison.differences(frame.position, plan, step, outputs, || None) {
            frame.add_audit_failure(failure);
            self.end_after(frame.position);
        }
    }

    /// Takes the inputs of a node. Returns why it cannot run, if so.
    fn gather(&self, frame: &InFlight<T::Part>, step: StepId, worker: &mut WorkerState) -> Option<Outcome> {
        let producer = &self.graph.producers[step];
        worker.inputs.clear();
        worker.keys.clear();
        let (mut failed, mut is_absent) = (None, false);
        for (port, feed) in producer.inputs.iter().zip(&producer.feeds) {
            let (value, key) = match feed {
                Feed::Unwired | Feed::Once(None) => (None, None),
                Feed::Once(Some(once)) => (Some(once.value.clone()), Some(once.key)),
                Feed::Place { place, step } => {
                    if failed.is_none() && frame.is_without_values(*step) {
                        failed = Some(*step);
                    }
                    frame.take(*place).map_or((None, None), |(value, key)| (Some(value), key))
                }
            };
            is_absent |= value.is_none() && !port.optional;
            worker.inputs.push(value);
            worker.keys.push(key);
        }
        failed.map(Outcome::Skipped).or(is_absent.then_some(Outcome::Absent))
    }

    /// Puts the values of a step where others take them, or notes its failure.
    fn close(
        &self,
        frame: &InFlight<T::Part>,
        step: StepId,
        result: Result<(Vec<Option<Value>>, Key), Fault>,
        spent: Spent,
    ) -> Settled {
        let outcome = match result {
            Ok((values, key)) => {
                let producer = &self.graph.producers[step];
                for (output, (value, port)) in OutputId::enumerate(values.into_iter().zip(&producer.outputs)) {
                    let place = producer.place(output);
                    let Some(value) = value else {
                        frame.add_absent(StepOutput { step, output });
                        continue;
                    };
                    let is_keyed = self.graph.places[place].keyed;
                    frame.put(place, value, is_keyed.then(|| value_keys::port(&key, port.name)));
                }
                Outcome::Ran(Some(key))
            }
            Err(fault) => {
                frame.add_fault(step, fault);
                if self.is_fatal(step) {
                    self.end_after(frame.position);
                }
                Outcome::Failed
            }
        };
        Settled { outcome, spent }
    }

    pub(super) fn encode(&self, frame: &InFlight<T::Part>, part: PartId, worker: &mut WorkerState) -> Settled {
        worker.values.clear();
        let mut stored = Vec::new();
        for &(slot, place) in &self.graph.parts[part] {
            let value = frame.take(place).map(|(value, _)| value);
            let key = frame.plan.get().and_then(|plan| {
                let step = StepId::of_slot(slot);
                let output = self.graph.producers[step].output_at(place);
                plan.stored(StepOutput { step, output })
            });
            match (key, value) {
                (Some(key), value) => {
                    let port = self.plan.output(slot).port.name;
                    stored.push(StoredValue { slot, key, port, value });
                }
                (None, Some(value)) => worker.values.push((slot, value)),
                (None, None) => {}
            }
        }
        // A frame that ends the stage is not written, nor one that is written already.
        let ends = self.is_past_the_last(FrameIndex(frame.position.0.saturating_add(1))) && frame.has_failed();
        if ends || frame.position.0 < self.written() {
            worker.values.clear();
            return Settled::at_once(Outcome::Absent);
        }
        let (watch, host) = (worker.start(), self.host(None, frame.position));
        let (sink, position, values) = (self.context.sink, (frame.position, &frame.frame), &worker.values);
        let encoded = guarded_sink(|| {
            if stored.is_empty() {
                return sink.encode(self.run, position, part, values);
            }
            sink.encode_stored(self.run, position, part, values, &stored).map_err(|error| match error.remedy {
                None => error.remedy(FRESH),
                Some(_) => error,
            })
        });
        let spent = worker.stop(watch, &host);
        worker.values.clear();
        match encoded {
            Ok(encoded) => frame.put_part(part, encoded),
            Err(error) => {
                frame.add_sink_error(part, error);
                self.end_after(frame.position);
            }
        }
        Settled { outcome: Outcome::Ran(None), spent }
    }
}

/// Runs a node on a frame, and hashes the files that it reads itself before and after.
fn with_files(
    planned: &PlannedNode,
    frame: &Frame,
    process: impl FnOnce() -> Result<Outputs, Fault>,
) -> Result<(Outputs, Option<Key>), Fault> {
    let files = planned.files_content(frame)?;
    let outputs = process()?;
    if planned.files_content(frame)? != files {
        return Err(Fault::new("a file that `reads` names changed while the node ran").remedy("run again"));
    }
    Ok((outputs, files))
}
