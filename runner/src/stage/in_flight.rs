//! One frame in flight: its finished steps, the values still needed, its encoded parts.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, OnceLock};
use std::time::Instant;

use depthloom_graphs::contracts::{Drops, ErrorMessage, Frame, NodeWarning};
use depthloom_graphs::plan::{FrameIndex, PartId};
use depthloom_graphs::{Fault, Key, SourceOutputs, Value};
use depthloom_threads::locked;

use crate::audit::failure::AuditFailure;
use crate::reuse::{FramePlan, StepAction};
use crate::stage::frame_graph::{FrameGraph, Place, PlaceId, StepId, StepOutput};
use crate::timing::Spent;

/// How a step ended on a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Outcome {
    /// With the key of its values, unless it encoded a part.
    Ran(Option<Key>),
    /// Its values, of this key, are in the store.
    Reused(Key),
    /// A required input was absent, and so are its outputs. That is not a failure.
    Absent,
    Failed,
    /// It did not run because this other step failed.
    Skipped(StepId),
}

/// A step that has ended.
pub(crate) struct Settled {
    pub(crate) outcome: Outcome,
    pub(crate) spent: Spent,
}

impl Settled {
    pub(crate) fn at_once(outcome: Outcome) -> Self {
        Self { outcome, spent: Spent::default() }
    }
}

/// How a frame of a live stage arrived.
pub(crate) struct LiveArrival {
    /// Its values, until the source's step takes them.
    pub(crate) read: Mutex<Option<SourceOutputs>>,
    pub(crate) captured: Instant,
    /// The frames dropped before it.
    pub(crate) drops: Drops,
}

struct Progress {
    pending: AtomicU32,
    settled: OnceLock<Settled>,
}

/// A value, its key and how many steps still need it.
struct Cell {
    value: Option<Value>,
    key: Option<Key>,
    uses: u32,
}

/// A frame in flight; `P` is an encoded part.
pub(crate) struct InFlight<P> {
    pub(crate) position: FrameIndex,
    pub(crate) frame: Frame,
    /// Of a live stage.
    pub(crate) arrival: Option<LiveArrival>,
    /// Set by the source's step if there is a store.
    pub(crate) plan: OnceLock<FramePlan>,
    /// Stored values that nodes need, until their steps put them into their places.
    pub(crate) loaded: Mutex<BTreeMap<PlaceId, Value>>,
    /// The outputs without a value although their step ran, unordered.
    absent: Mutex<Vec<StepOutput>>,
    steps: Box<[Progress]>,
    cells: Box<[Mutex<Cell>]>,
    parts: Box<[Mutex<Option<P>>]>,
    remaining: AtomicU32,
    faults: Mutex<Vec<(StepId, Fault)>>,
    sink_errors: Mutex<Vec<(PartId, ErrorMessage)>>,
    audit_failure: Mutex<Option<Box<AuditFailure>>>,
    warnings: Mutex<Vec<NodeWarning>>,
}

impl<P> InFlight<P> {
    pub(crate) fn new(position: FrameIndex, frame: Frame, arrival: Option<LiveArrival>, graph: &FrameGraph) -> Self {
        let progress = |waits_for| Progress { pending: AtomicU32::new(waits_for), settled: OnceLock::new() };
        let cell = |place: &Place| Mutex::new(Cell { value: None, key: None, uses: place.uses });
        Self {
            position,
            frame,
            arrival,
            plan: OnceLock::new(),
            loaded: Mutex::default(),
            absent: Mutex::default(),
            steps: graph.order.iter().map(|o| progress(o.waits_for)).collect(),
            cells: graph.places.iter().map(cell).collect(),
            parts: graph.parts.iter().map(|_| Mutex::new(None)).collect(),
            remaining: AtomicU32::new(graph.steps_per_frame),
            faults: Mutex::default(),
            sink_errors: Mutex::default(),
            audit_failure: Mutex::default(),
            warnings: Mutex::default(),
        }
    }

    /// Stores a value for the steps that need it, if there are any.
    pub(crate) fn put(&self, place: PlaceId, value: Value, key: Option<Key>) {
        let mut cell = locked(&self.cells[place]);
        if cell.uses > 0 {
            (cell.value, cell.key) = (Some(value), key);
        }
    }

    /// Takes a value with its key. The last of its uses removes it.
    pub(crate) fn take(&self, place: PlaceId) -> Option<(Value, Option<Key>)> {
        let mut cell = locked(&self.cells[place]);
        cell.uses -= 1;
        let value = if cell.uses == 0 { cell.value.take() } else { cell.value.clone() };
        value.map(|value| (value, cell.key))
    }

    pub(crate) fn action(&self, step: StepId) -> &StepAction {
        self.plan.get().map_or(&StepAction::Run, |plan| &plan.steps[step])
    }

    pub(crate) fn settled(&self, step: StepId) -> Option<&Settled> {
        self.steps[step].settled.get()
    }

    /// Whether a step ended without values because of a failure.
    pub(crate) fn is_without_values(&self, step: StepId) -> bool {
        self.settled(step).is_some_and(|s| matches!(s.outcome, Outcome::Failed | Outcome::Skipped(_)))
    }

    /// Ends a step; returns whether it was the frame's last. Calls `ready` with the steps that waited for nothing else.
    pub(crate) fn settle(
        &self,
        step: StepId,
        settled: Settled,
        graph: &FrameGraph,
        mut ready: impl FnMut(StepId),
    ) -> bool {
        let is_first = self.steps[step].settled.set(settled).is_ok();
        debug_assert!(is_first, "a step ends once");
        for &then in &graph.order[step].then {
            if self.steps[then].pending.fetch_sub(1, Ordering::AcqRel) == 1 {
                ready(then);
            }
        }
        self.remaining.fetch_sub(1, Ordering::AcqRel) == 1
    }

    pub(crate) fn put_part(&self, part: PartId, encoded: P) {
        *locked(&self.parts[part]) = Some(encoded);
    }

    pub(crate) fn take_parts(&self) -> Vec<P> {
        self.parts.iter().filter_map(|part| locked(part).take()).collect()
    }

    pub(crate) fn add_fault(&self, step: StepId, fault: Fault) {
        locked(&self.faults).push((step, fault));
    }

    pub(crate) fn add_absent(&self, output: StepOutput) {
        locked(&self.absent).push(output);
    }

    pub(crate) fn take_absent(&self) -> Vec<StepOutput> {
        let mut absent = std::mem::take(&mut *locked(&self.absent));
        absent.sort_unstable();
        absent
    }

    pub(crate) fn add_warnings(&self, warnings: impl Iterator<Item = NodeWarning>) {
        locked(&self.warnings).extend(warnings);
    }

    /// In the order of the nodes.
    pub(crate) fn take_warnings(&self) -> Vec<NodeWarning> {
        let mut warnings = std::mem::take(&mut *locked(&self.warnings));
        warnings.sort();
        warnings
    }

    pub(crate) fn add_sink_error(&self, part: PartId, error: ErrorMessage) {
        locked(&self.sink_errors).push((part, error));
    }

    pub(crate) fn add_audit_failure(&self, failure: Box<AuditFailure>) {
        locked(&self.audit_failure).get_or_insert(failure);
    }

    pub(crate) fn take_audit_failure(&self) -> Option<Box<AuditFailure>> {
        locked(&self.audit_failure).take()
    }

    pub(crate) fn has_failed(&self) -> bool {
        !locked(&self.faults).is_empty()
    }

    /// In the order of the steps.
    pub(crate) fn take_faults(&self) -> Vec<(StepId, Fault)> {
        let mut faults = std::mem::take(&mut *locked(&self.faults));
        faults.sort_by_key(|(step, _)| *step);
        faults
    }

    /// The error of the first part that the sink refused.
    pub(crate) fn take_sink_error(&self) -> Option<ErrorMessage> {
        let errors = std::mem::take(&mut *locked(&self.sink_errors));
        errors.into_iter().min_by_key(|(part, _)| *part).map(|(_, error)| error)
    }
}
