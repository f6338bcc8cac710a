//! A stage run while its frames run: its state, and how it ends.

pub(crate) mod frame_graph;
pub(crate) mod in_flight;
pub(crate) mod ordered;
pub(crate) mod queues;
pub(crate) mod retire;
pub(crate) mod retire_live;
mod steps;
mod work;

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use depthloom_graphs::contracts::{NodeWarning, Sink};
use depthloom_graphs::plan::{FrameIndex, NodeId, PlannedNode, RunId, StageRun};
use depthloom_graphs::{Context, Fault, Frame, Inputs, Outputs, PureNode, Source};

use crate::aggregate_values::is_once;
use crate::audit::comparison::Comparison;
use crate::audit::sample::Sampler;
use crate::host::TaskHost;
use crate::reuse::Reuse;
use crate::run_context::RunContext;
use crate::stage::frame_graph::{FrameGraph, Step, StepId};
use crate::stage::in_flight::{InFlight, LiveArrival};
use crate::stage::ordered::Ordered;
use crate::stage::queues::Queues;

pub(crate) enum FrameNode<P> {
    Pure(Box<dyn PureNode>),
    Ordered(Ordered<P>),
    /// An aggregate node, which no frame reaches.
    Once,
    /// A node that is not in this process's share.
    Omitted,
}

/// A step of a frame that is ready to run.
struct Task<P> {
    frame: Arc<InFlight<P>>,
    step: StepId,
}

pub(crate) struct Stage<'a, T: Sink> {
    pub(crate) context: &'a RunContext<'a, T>,
    pub(crate) run: RunId,
    pub(crate) plan: &'a StageRun,
    pub(crate) graph: FrameGraph,
    pub(crate) source: &'a dyn Source,
    /// The frames of the source that are processed.
    pub(crate) range: Range<usize>,
    pub(crate) nodes: Vec<FrameNode<T::Part>>,
    pub(crate) reuse: Option<Reuse<'a>>,
    pub(crate) sampler: Sampler,
    /// The frames whose steps have not all ended.
    pub(crate) processing: Arc<AtomicUsize>,
    queues: Queues<Task<T::Part>>,
    /// Of a live stage: its encoding tasks, which wait until no node is ready.
    encode_queues: Option<Queues<Task<T::Part>>>,
    /// The lowest position that ends the stage; later frames are dropped.
    last: AtomicUsize,
    ended: AtomicBool,
}

/// Ends a stage when dropped, also by a panic.
pub(crate) struct EndAll<'s, 'a, T: Sink>(pub(crate) &'s Stage<'a, T>);

impl<T: Sink> Drop for EndAll<'_, '_, T> {
    fn drop(&mut self) {
        self.0.ended.store(true, Ordering::SeqCst);
        self.0.context.budget.wake_all();
    }
}

impl<'a, T: Sink> Stage<'a, T> {
    pub(crate) fn new(
        context: &'a RunContext<'a, T>,
        run: RunId,
        plan: &'a StageRun,
        graph: FrameGraph,
        (source, range): (&'a dyn Source, Range<usize>),
        nodes: Vec<FrameNode<T::Part>>,
        reuse: Option<Reuse<'a>>,
    ) -> Self {
        Self {
            sampler: Sampler::new(context.audit, graph.producers.len()),
            queues: Queues::new(context.window),
            processing: Arc::default(),
            encode_queues: None,
            last: AtomicUsize::new(usize::MAX),
            ended: AtomicBool::new(false),
            context,
            run,
            plan,
            graph,
            source,
            range,
            nodes,
            reuse,
        }
    }

    /// Its frames arrive by themselves: what nodes need goes before what the recording needs.
    pub(crate) fn live(self) -> Self {
        Self { encode_queues: Some(Queues::new(self.context.window)), ..self }
    }

    pub(crate) fn admit(&self, position: FrameIndex, frame: Frame, arrival: Option<LiveArrival>) {
        let frame = Arc::new(InFlight::new(position, frame, arrival, &self.graph));
        self.processing.fetch_add(1, Ordering::Relaxed);
        self.queues.push(position, Task { frame, step: StepId::SOURCE });
        self.context.budget.wake(1);
    }

    /// Sets the first frame to be admitted.
    pub(crate) fn start_at(&self, position: FrameIndex) {
        self.set_oldest(position);
        for node in &self.nodes {
            if let FrameNode::Ordered(ordered) = node {
                ordered.start_at(position);
            }
        }
    }

    /// Reports the warnings of the frames that are already written.
    pub(crate) fn repeat_warnings(&self) {
        for NodeWarning { node, what, count } in self.context.sink.recorded_warnings(self.run).into_iter().flatten() {
            if self.context.warnings.add(self.run, node, &what, count, true) {
                self.context.observer.warned(self.run, node, &what);
            }
        }
    }

    /// The position after the frames that an earlier process has written.
    pub(crate) fn written(&self) -> usize {
        self.reuse.as_ref().map_or(self.range.start, |reuse| reuse.written)
    }

    pub(crate) fn set_oldest(&self, position: FrameIndex) {
        self.queues.set_oldest(position);
        if let Some(queues) = &self.encode_queues {
            queues.set_oldest(position);
        }
    }

    fn has_tasks(&self) -> bool {
        !self.queues.is_empty() || self.encode_queues.as_ref().is_some_and(|queues| !queues.is_empty())
    }

    pub(crate) const fn is_live(&self) -> bool {
        self.encode_queues.is_some()
    }

    /// Whether an earlier frame ends the stage.
    pub(crate) fn is_past_the_last(&self, position: FrameIndex) -> bool {
        position.0 > self.last.load(Ordering::Relaxed)
    }

    /// Drops the frames after this one.
    fn end_after(&self, position: FrameIndex) {
        self.last.fetch_min(position.0, Ordering::Relaxed);
    }

    /// Whether a failure of this step ends the stage.
    ///
    /// With `keep_going` only that of an ordered node with aggregate outputs does: it cannot finish, and other nodes
    /// need its values.
    pub(crate) fn is_fatal(&self, step: StepId) -> bool {
        let has_aggregates = |node: NodeId| {
            let planned = &self.plan.nodes[node];
            matches!(self.nodes[node], FrameNode::Ordered(_))
                && planned.outputs.iter().any(|output| is_once(planned, &output.port))
        };
        !self.context.keep_going || matches!(self.graph.step(step), Step::Node(node) if has_aggregates(node))
    }

    fn is_over(&self) -> bool {
        self.ended.load(Ordering::Relaxed) || self.context.interrupt.aborts()
    }

    fn host(&self, node: Option<NodeId>, position: FrameIndex) -> TaskHost<'a> {
        let is_repeated = position.0 < self.written();
        let is_live = self.is_live();
        TaskHost { position: Some(position), is_repeated, is_live, ..TaskHost::new(self.context, self.run, node) }
    }

    /// `None` if nothing is audited or reused.
    pub(crate) fn comparison(&self) -> Option<Comparison<'_>> {
        let reuse = self.reuse.as_ref().filter(|_| self.sampler.is_on())?;
        Some(Comparison { run: self.plan, graph: &self.graph, frames: self.source.frames(), reuse })
    }
}

/// Runs a pure node, which sees the frame only if it observes it.
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
