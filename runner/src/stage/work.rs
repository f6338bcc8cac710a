//! What a worker does: it takes tasks of the oldest frames, and queues the steps that become ready.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use crossbeam::channel::Sender;
use depthloom_graphs::contracts::Sink;

use super::steps::WorkerState;
use super::{EndAll, FrameNode, Stage, Task};
use crate::stage::frame_graph::Step;
use crate::stage::in_flight::InFlight;
use crate::stage::ordered::Ordered;

type FrameInFlight<T> = Arc<InFlight<<T as Sink>::Part>>;

impl<T: Sink> Stage<'_, T> {
    /// Works until the stage ends. Complete frames are sent to `done`, which is never full.
    pub(crate) fn work(&self, done: &Sender<FrameInFlight<T>>) {
        // A worker that ends in a panic ends all others, which would wait for it.
        let _end_all = EndAll(self);
        let mut worker = WorkerState::default();
        let mut own = None;
        while let Some(permit) = self.context.budget.permit_for(|| self.has_tasks(), || self.is_over()) {
            while !self.is_over() {
                let Some(task) = self.next(own.take()) else { break };
                own = self.perform(task, &mut worker, done);
            }
            worker.rest();
            permit.rest();
        }
    }

    /// The worker's own task, unless an older frame has one.
    fn next(&self, own: Option<Task<T::Part>>) -> Option<Task<T::Part>> {
        let Some(mine) = own else {
            return self.queues.pop().or_else(|| self.encode_queues.as_ref()?.pop());
        };
        let Some(older) = self.queues.pop_older_than(mine.frame.position) else { return Some(mine) };
        self.queues.push(mine.frame.position, mine);
        self.context.budget.wake(1);
        Some(older)
    }

    /// Runs a task. Returns one of the tasks that became ready, and queues the others.
    fn perform(
        &self,
        Task { frame, step }: Task<T::Part>,
        worker: &mut WorkerState,
        done: &Sender<FrameInFlight<T>>,
    ) -> Option<Task<T::Part>> {
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
            if let (Some(queues), Step::Encode(_)) = (&self.encode_queues, self.graph.step(step)) {
                queues.push(task.frame.position, task);
                queued += 1;
            } else if next.is_none() {
                next = Some(task);
            } else {
                self.queues.push(task.frame.position, task);
                queued += 1;
            }
        };
        let ordered = |step: Step| match step {
            Step::Node(node) => match &self.nodes[node] {
                FrameNode::Ordered(ordered) => Some(ordered),
                FrameNode::Pure(_) | FrameNode::Once | FrameNode::Omitted => None,
            },
            Step::Source | Step::Encode(_) => None,
        };
        let is_complete = frame.settle(step, settled, &self.graph, |then| {
            if ordered(self.graph.step(then)).is_none_or(|ordered| ordered.arrive(&frame)) {
                offer(Arc::clone(&frame), then);
            }
        });
        if let Some(next) = ordered(kind).and_then(Ordered::advance) {
            offer(next, step);
        }
        self.context.budget.wake(queued);
        if is_complete {
            self.processing.fetch_sub(1, Ordering::Relaxed);
            // Fails only if the writer has ended, and then the stage has ended too.
            let _ = done.send(frame);
        }
        next
    }
}
