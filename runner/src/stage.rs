//! The frames of a stage run on the workers.

pub(crate) mod frame_graph;
pub(crate) mod in_flight;
pub(crate) mod ordered;
pub(crate) mod queues;
pub(crate) mod retire;

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use crossbeam::channel::Sender;
use depthloom_graphs::contracts::{ErrorMessage, Slot, StoredValue, Tap, Warned};
use depthloom_graphs::plan::{FrameIndex, NodeId, PartId, PlannedNode, RunId, StageRun};
use depthloom_graphs::value_keys::{self, Observed};
use depthloom_graphs::{Context, Fault, Frame, Host as _, Inputs, Key, Outputs, PureNode, Scratch, Source, Value};

use crate::audit::comparison::Comparison;
use crate::audit::sample::Sampler;
use crate::checkpoints::Checkpoints;
use crate::host::TaskHost;
use crate::interrupt::Interrupt;
use crate::observer::Observer;
use crate::once_values::is_once;
use crate::options::Audit;
use crate::panics::fault;
use crate::reuse::{FramePlan, Reuse, StepAction};
use crate::stage::frame_graph::{Feed, FrameGraph, OutputId, Step, StepId, StepOutput};
use crate::stage::in_flight::{InFlight, Outcome, Settled};
use crate::stage::ordered::Ordered;
use crate::stage::queues::Queues;
use crate::timing::{Spent, Stopwatch};
use crate::warnings::Warnings;
use depthloom_threads::{Budget, caught, locked};

/// A node as the frames see it.
pub(crate) enum FrameNode<P> {
    Pure(Box<dyn PureNode>),
    Ordered(Ordered<P>),
    /// A once-node: no frame comes by it.
    Once,
}

/// A step of a frame that can run now.
pub(crate) struct Task<P> {
    frame: Arc<InFlight<P>>,
    step: StepId,
}

/// A frame on its way.
type FrameInFlight<T> = Arc<InFlight<<T as Tap>::Part>>;

/// A stage run while its frames run.
pub(crate) struct Stage<'a, T: Tap> {
    pub(crate) run: RunId,
    pub(crate) plan: &'a StageRun,
    pub(crate) graph: FrameGraph,
    pub(crate) source: &'a dyn Source,
    pub(crate) nodes: Vec<FrameNode<T::Part>>,
    pub(crate) tap: &'a T,
    pub(crate) budget: &'a Budget,
    pub(crate) observer: &'a dyn Observer,
    pub(crate) interrupt: &'a Interrupt,
    warnings: &'a Warnings,
    /// What need not be made again.
    pub(crate) reuse: Option<Reuse<'a>>,
    pub(crate) sampler: Sampler,
    pub(crate) window: usize,
    pub(crate) keep_going: bool,
    queues: Queues<Task<T::Part>>,
    /// The lowest position that ends the stage: frames after it are dropped where they are.
    last: AtomicUsize,
    ended: AtomicBool,
}

/// What a worker keeps between tasks.
#[derive(Default)]
struct WorkerState {
    scratch: Scratch,
    inputs: Vec<Option<Value>>,
    keys: Vec<Option<Key>>,
    taken: Vec<(Slot, Value)>,
    /// When the task before ended, if no rest came between: there this one starts. Reading a thread's processor time is a
    /// system call, a good part of what the engine spends on a task; so its own work counts with the task it leads to.
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
}

/// What a node found at its inputs.
enum Gathered {
    Complete,
    Absent,
    Without(StepId),
}

/// Ends a stage when dropped, be it by a panic.
pub(crate) struct EndAll<'s, 'a, T: Tap>(pub(crate) &'s Stage<'a, T>);

impl<T: Tap> Drop for EndAll<'_, '_, T> {
    fn drop(&mut self) {
        self.0.end();
    }
}

/// What the runs have in common.
pub(crate) struct Common<'a, T> {
    pub(crate) tap: &'a T,
    pub(crate) budget: &'a Budget,
    pub(crate) observer: &'a dyn Observer,
    pub(crate) interrupt: &'a Interrupt,
    pub(crate) warnings: &'a Warnings,
    pub(crate) window: usize,
    pub(crate) keep_going: bool,
    pub(crate) checkpoints: &'a Checkpoints,
    pub(crate) audit: Audit,
}

impl<'a, T: Tap> Stage<'a, T> {
    pub(crate) fn new(
        run: RunId,
        plan: &'a StageRun,
        graph: FrameGraph,
        source: &'a dyn Source,
        nodes: Vec<FrameNode<T::Part>>,
        reuse: Option<Reuse<'a>>,
        common: &Common<'a, T>,
    ) -> Self {
        let sampler = Sampler::new(common.audit, graph.producers.len());
        Self {
            run,
            plan,
            graph,
            source,
            nodes,
            tap: common.tap,
            budget: common.budget,
            observer: common.observer,
            interrupt: common.interrupt,
            warnings: common.warnings,
            reuse,
            sampler,
            window: common.window,
            keep_going: common.keep_going,
            queues: Queues::new(common.window),
            last: AtomicUsize::new(usize::MAX),
            ended: AtomicBool::new(false),
        }
    }

    /// Lets a frame in.
    pub(crate) fn admit(&self, position: FrameIndex) {
        self.queues
            .push(position, Task { frame: Arc::new(InFlight::new(position, &self.graph)), step: StepId::SOURCE });
        self.budget.wake(1);
    }

    /// Says which frame is let in first.
    pub(crate) fn start_at(&self, position: FrameIndex) {
        self.queues.set_oldest(position);
        for node in &self.nodes {
            if let FrameNode::Ordered(ordered) = node {
                ordered.start_at(position);
            }
        }
    }

    /// Reports the warnings of the frames that are already written.
    pub(crate) fn repeat_warnings(&self) {
        for Warned { node, what, count } in self.tap.told(self.run).into_iter().flatten() {
            if self.warnings.add(self.run, node, &what, count, true) {
                self.observer.warned(self.run, node, &what);
            }
        }
    }

    /// How many frames an earlier process has written.
    pub(crate) fn written(&self) -> usize {
        self.reuse.as_ref().map_or(0, |reuse| reuse.written)
    }

    /// Says which frame is the oldest in flight.
    pub(crate) fn set_oldest(&self, position: FrameIndex) {
        self.queues.set_oldest(position);
    }

    /// Whether a frame comes after one that ends the stage.
    pub(crate) fn is_past_the_last(&self, position: FrameIndex) -> bool {
        position.0 > self.last.load(Ordering::Relaxed)
    }

    /// Whether what failed at a step ends the stage.
    ///
    /// With `keep_going` only an ordered node with aggregate outputs does: it cannot finish, and other nodes need what it would give.
    pub(crate) fn is_fatal(&self, step: StepId) -> bool {
        let has_aggregates = |node: NodeId| {
            let planned = &self.plan.nodes[node];
            matches!(self.nodes[node], FrameNode::Ordered(_))
                && planned.outputs.iter().any(|output| is_once(planned, &output.port))
        };
        !self.keep_going || matches!(self.graph.step(step), Step::Node(node) if has_aggregates(node))
    }

    /// Sends the workers home.
    pub(crate) fn end(&self) {
        self.ended.store(true, Ordering::SeqCst);
        self.budget.wake_all();
    }

    fn is_over(&self) -> bool {
        self.ended.load(Ordering::Relaxed) || self.interrupt.aborts()
    }

    /// Works until the stage is over. Frames whose last step is done go to `done`, which never is full.
    pub(crate) fn work(&self, done: &Sender<FrameInFlight<T>>) {
        // Whatever ends one worker ends all: nobody waits for who is gone.
        let _end_all = EndAll(self);
        let mut worker = WorkerState::default();
        let mut own = None;
        while let Some(permit) = self.budget.permit_for(|| !self.queues.is_empty(), || self.is_over()) {
            while !self.is_over() {
                let Some(task) = self.next(own.take()) else { break };
                own = self.perform(task, &mut worker, done);
            }
            worker.since = None;
            permit.rest();
        }
    }

    /// The task to do next: the worker's own, unless an older frame has one.
    fn next(&self, own: Option<Task<T::Part>>) -> Option<Task<T::Part>> {
        let Some(mine) = own else { return self.queues.pop() };
        let Some(older) = self.queues.pop_older_than(mine.frame.position) else { return Some(mine) };
        self.queues.push(mine.frame.position, mine);
        self.budget.wake(1);
        Some(older)
    }

    /// Does a task; gives back one that it made ready, if any, and queues the others.
    fn perform(
        &self,
        task: Task<T::Part>,
        worker: &mut WorkerState,
        done: &Sender<FrameInFlight<T>>,
    ) -> Option<Task<T::Part>> {
        let Task { frame, step } = task;
        if self.is_past_the_last(frame.position) {
            return None;
        }
        let kind = self.graph.step(step);
        let settled = match kind {
            Step::Source => self.read(&frame, worker),
            Step::Node(node) => self.run_node(&frame, node, worker),
            Step::Encode(part) => self.encode(&frame, part, worker),
        };
        let (mut next, mut queued) = (None, 0);
        let mut offer = |frame: FrameInFlight<T>, step| {
            let task = Task { frame, step };
            if next.is_none() {
                next = Some(task);
            } else {
                self.queues.push(task.frame.position, task);
                queued += 1;
            }
        };
        let is_complete = frame.settle(step, settled, &self.graph, |then| {
            let may_run = match self.graph.step(then) {
                Step::Node(node) => match &self.nodes[node] {
                    FrameNode::Ordered(ordered) => ordered.arrive(&frame),
                    FrameNode::Pure(_) | FrameNode::Once => true,
                },
                Step::Source | Step::Encode(_) => true,
            };
            if may_run {
                offer(Arc::clone(&frame), then);
            }
        });
        if let Step::Node(node) = kind
            && let FrameNode::Ordered(ordered) = &self.nodes[node]
            && let Some(next) = ordered.advance()
        {
            offer(next, step);
        }
        self.budget.wake(queued);
        if is_complete {
            // Fails only if the writer is gone, and then the stage is over.
            let _ = done.send(frame);
        }
        next
    }

    fn host(&self, node: Option<NodeId>, position: FrameIndex) -> TaskHost<'a> {
        let (budget, interrupt, observer) = (self.budget, self.interrupt, self.observer);
        TaskHost {
            budget,
            interrupt,
            observer,
            warnings: self.warnings,
            run: self.run,
            node,
            position: Some(position),
            key: None,
            checkpoints: None,
            helpers_cpu_ns: AtomicU64::new(0),
            reported: Mutex::default(),
            is_repeated: position.0 < self.written(),
        }
    }

    fn read(&self, frame: &InFlight<T::Part>, worker: &mut WorkerState) -> Settled {
        let (watch, host) = (worker.start(), self.host(None, frame.position));
        let mut ctx = Context::new(&host, &mut worker.scratch);
        let read = || {
            // Asked for first, as by whoever looks up whether the frame has to be read at all; and what was read must be what it names.
            let key = self.source.key(frame.position)?;
            if let Some(reuse) = &self.reuse {
                let plan = reuse.plan(&self.graph, self.tap, frame.position, key);
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
            Ok(Some(read))
        };
        let read = match caught(read).unwrap_or_else(|panic| Err(fault(panic))) {
            Ok(None) => {
                // What looking and loading took is nobody's.
                let _ = worker.stop(watch, &host);
                return self.reuse(frame, StepId::SOURCE);
            }
            Ok(Some(read)) => Ok(read),
            Err(fault) => Err(fault),
        };
        let read = read
            .and_then(|read| Ok((read.outputs.in_order_of(&self.graph.producers[StepId::SOURCE].outputs)?, read.key)));
        let spent = worker.stop(watch, &host);
        frame.add_warnings(host.into_warnings());
        self.close(frame, StepId::SOURCE, read, spent)
    }

    /// Reads what nodes need of the values in the store: all of a frame at once, for what lies together is read once.
    fn load(&self, frame: &InFlight<T::Part>, plan: &FramePlan, reuse: &Reuse<'_>) -> Result<(), Fault> {
        let (mut wanted, mut places) = (Vec::new(), Vec::new());
        for (producer, action) in self.graph.producers.iter().zip(&plan.steps) {
            let StepAction::Reuse(key, load) = action else { continue };
            for &output in load {
                wanted.push((*key, producer.outputs[output].name));
                places.push(producer.place(output));
            }
        }
        let values = reuse.values(&wanted).map_err(|fault| fault.remedy(FRESH))?;
        let loaded = places.into_iter().zip(values).filter_map(|(place, value)| Some((place, value?)));
        locked(&frame.loaded).extend(loaded);
        for absent in &plan.absent {
            frame.add_absent(*absent);
        }
        Ok(())
    }

    /// Ends a step that does not run: what nodes need of its values was read from the store.
    fn reuse(&self, frame: &InFlight<T::Part>, step: StepId) -> Settled {
        let (StepAction::Reuse(key, load), Some(reuse)) = (frame.action(step), &self.reuse) else {
            return Settled { outcome: Outcome::Absent, spent: Spent::default() };
        };
        let host = self.host(step.node(), frame.position);
        for (what, count) in reuse.warnings(key) {
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
        Settled { outcome: Outcome::Taken(*key), spent: Spent::default() }
    }

    /// Takes a node's inputs out of the way of a node that does not fire.
    fn pass_by(&self, frame: &InFlight<T::Part>, step: StepId) {
        for feed in &self.graph.producers[step].feeds {
            if let Feed::Place { place, .. } = feed {
                drop(frame.take(*place));
            }
        }
    }

    fn run_node(&self, frame: &InFlight<T::Part>, node: NodeId, worker: &mut WorkerState) -> Settled {
        let step = StepId::of_node(node);
        if *frame.action(step) != StepAction::Run {
            self.pass_by(frame, step);
            return self.reuse(frame, step);
        }
        let outcome = match self.gather(frame, step, worker) {
            Gathered::Complete => None,
            Gathered::Absent => Some(Outcome::Absent),
            Gathered::Without(failed) => Some(Outcome::Skipped(failed)),
        };
        if let Some(outcome) = outcome {
            worker.inputs.clear();
            return Settled { outcome, spent: Spent::default() };
        }
        let producer = &self.graph.producers[step];
        let planned = &self.plan.nodes[node];
        let (recipe, instant) = (&planned.recipe, &self.source.frames()[frame.position]);
        let (watch, host) = (worker.start(), self.host(Some(node), frame.position));
        let inputs = Inputs::new(&producer.inputs, &worker.inputs);
        let mut ctx = Context::new(&host, &mut worker.scratch);
        let in_order = |given: Outputs| given.in_order_of(&producer.outputs);
        let fired = match &self.nodes[node] {
            FrameNode::Pure(pure) => {
                let process = || process_pure(&**pure, planned, instant, &inputs, &mut ctx);
                let processed = with_files(planned, instant, || caught(process).unwrap_or_else(|p| Err(fault(p))));
                processed.and_then(|(given, files)| {
                    let observed = planned.observes.as_ref().map(|_| Observed { frame: instant, files });
                    Ok((in_order(given)?, value_keys::pure(recipe, observed, &worker.keys)))
                })
            }
            FrameNode::Ordered(ordered) => {
                let mut state = locked(&ordered.state);
                let fired = match state.node.as_mut() {
                    Some(node) => with_files(planned, instant, || {
                        caught(|| node.process(instant, &inputs, &mut ctx)).unwrap_or_else(|p| Err(fault(p)))
                    }),
                    None => Err(Fault::new("not run: failed on an earlier frame")),
                };
                let fired = fired.and_then(|(given, files)| Ok((in_order(given)?, files)));
                if fired.is_err() {
                    state.node = None;
                }
                if let Ok((values, _)) = &fired {
                    self.audit_again(frame, step, values);
                }
                fired.map(|(values, files)| {
                    let observed = Observed { frame: instant, files };
                    let key = value_keys::ordered(recipe, state.last_key.as_ref(), observed, &worker.keys);
                    state.last_key = Some(key);
                    (values, key)
                })
            }
            FrameNode::Once => Err(Fault::new("a once-node does not see frames")),
        };
        let spent = worker.stop(watch, &host);
        frame.add_warnings(host.into_warnings());
        worker.inputs.clear();
        self.close(frame, step, fired, spent)
    }

    /// Compares the outputs of an ordered node that ran with those that are stored, and recorded again, under their key.
    fn audit_again(&self, frame: &InFlight<T::Part>, step: StepId, outputs: &[Option<Value>]) {
        let (Some(plan), Some(comparison)) = (frame.plan.get(), self.comparison()) else { return };
        if let Err(failure) = comparison.differences(frame.position, plan, step, outputs, || None) {
            frame.add_audit_failure(failure);
            self.last.fetch_min(frame.position.0, Ordering::Relaxed);
        }
    }

    /// The stored values to compare recomputed ones with; `None` if nothing is audited or reused.
    pub(crate) fn comparison(&self) -> Option<Comparison<'_>> {
        let reuse = self.reuse.as_ref().filter(|_| self.sampler.is_on())?;
        Some(Comparison { run: self.plan, graph: &self.graph, frames: self.source.frames(), reuse })
    }

    /// Takes a node's inputs from where they lie, whether it is going to fire or not.
    fn gather(&self, frame: &InFlight<T::Part>, step: StepId, worker: &mut WorkerState) -> Gathered {
        let producer = &self.graph.producers[step];
        worker.inputs.clear();
        worker.keys.clear();
        let (mut without, mut is_absent) = (None, false);
        for (port, feed) in producer.inputs.iter().zip(&producer.feeds) {
            let (value, key) = match feed {
                Feed::Unwired | Feed::Once(None) => (None, None),
                Feed::Once(Some(once)) => (Some(once.value.clone()), Some(once.key)),
                Feed::Place { place, step } => {
                    if without.is_none() && frame.is_without_values(*step) {
                        without = Some(*step);
                    }
                    frame.take(*place).map_or((None, None), |(value, key)| (Some(value), key))
                }
            };
            is_absent |= value.is_none() && !port.optional;
            worker.inputs.push(value);
            worker.keys.push(key);
        }
        match without {
            Some(step) => Gathered::Without(step),
            None if is_absent => Gathered::Absent,
            None => Gathered::Complete,
        }
    }

    /// Lays a producer's values where others find them, or takes down what failed.
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
                Outcome::Fired(Some(key))
            }
            Err(fault) => {
                frame.add_fault(step, fault);
                if self.is_fatal(step) {
                    self.last.fetch_min(frame.position.0, Ordering::Relaxed);
                }
                Outcome::Failed
            }
        };
        Settled { outcome, spent }
    }

    fn encode(&self, frame: &InFlight<T::Part>, part: PartId, worker: &mut WorkerState) -> Settled {
        worker.taken.clear();
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
                (None, Some(value)) => worker.taken.push((slot, value)),
                (None, None) => {}
            }
        }
        // A frame that ends the stage is not written, nor one that is written already.
        let ends = self.is_past_the_last(FrameIndex(frame.position.0.saturating_add(1))) && frame.has_failed();
        if ends || frame.position.0 < self.written() {
            worker.taken.clear();
            return Settled { outcome: Outcome::Absent, spent: Spent::default() };
        }
        let (watch, host) = (worker.start(), self.host(None, frame.position));
        let instant = &self.source.frames()[frame.position];
        let encoded = || {
            let (run, frame, values) = (self.run, (frame.position, instant), &worker.taken);
            if stored.is_empty() {
                return self.tap.encode(run, frame, part, values);
            }
            let encoded = self.tap.encode_stored(run, frame, part, values, &stored);
            encoded.map_err(|error| ErrorMessage { remedy: error.remedy.or_else(|| Some(FRESH.to_owned())), ..error })
        };
        let encoded = caught(encoded).unwrap_or_else(|panic| Err(ErrorMessage::new(format!("panicked {}", panic.0))));
        let spent = worker.stop(watch, &host);
        worker.taken.clear();
        match encoded {
            Ok(encoded) => frame.put_part(part, encoded),
            Err(error) => {
                frame.add_tap_error(part, error);
                self.last.fetch_min(frame.position.0, Ordering::Relaxed);
            }
        }
        Settled { outcome: Outcome::Fired(None), spent }
    }
}

/// Runs a pure node, which is told the frame only if it observes it.
pub(crate) fn process_pure(
    node: &dyn PureNode,
    planned: &PlannedNode,
    frame: &Frame,
    inputs: &Inputs<'_>,
    ctx: &mut Context<'_>,
) -> Result<Outputs, Fault> {
    match planned.observes {
        Some(_) => node.process_frame(frame, inputs, ctx),
        None => node.process(inputs, ctx),
    }
}

/// Runs a node on a frame, and hashes the files that it reads by itself before and after.
fn with_files(
    planned: &PlannedNode,
    frame: &Frame,
    process: impl FnOnce() -> Result<Outputs, Fault>,
) -> Result<(Outputs, Option<Key>), Fault> {
    let files = planned.files_content(frame)?;
    let given = process()?;
    if planned.files_content(frame)? != files {
        return Err(Fault::new("a file that `reads` names changed while the node ran").remedy("run again"));
    }
    Ok((given, files))
}

/// What helps where the store cannot be read.
const FRESH: &str = "run with --fresh, which takes nothing from earlier runs";
