//! One frame on its way through a stage: what has settled, the values still needed, the parts encoded.

use depthloom_graphs::plan::{FrameIndex, PartId};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, OnceLock};

use depthloom_graphs::contracts::{ErrorMessage, Warned};
use depthloom_graphs::{Fault, Key, Value};
use depthloom_threads::locked;

use crate::audit::failure::AuditFailure;
use crate::reuse::{FramePlan, StepAction};
use crate::stage::frame_graph::{FrameGraph, Place, PlaceId, StepId, StepOutput};
use crate::timing::Spent;

/// How a step ended on a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Outcome {
    /// It fired; of the source and of nodes, the key of its values.
    Fired(Option<Key>),
    /// It need not fire: its values, of this key, are in the store.
    Taken(Key),
    /// A required input was absent: so are its outputs. That is no failure.
    Absent,
    /// It failed.
    Failed,
    /// It did not run because that other step failed.
    Skipped(StepId),
}

/// A step that is over.
pub(crate) struct Settled {
    pub(crate) outcome: Outcome,
    pub(crate) spent: Spent,
}

struct Progress {
    pending: AtomicU32,
    settled: OnceLock<Settled>,
}

/// A value, its key and how many still take it.
struct Cell {
    value: Option<Value>,
    key: Option<Key>,
    uses: u32,
}

/// A frame in flight; `P` is an encoded part.
pub(crate) struct InFlight<P> {
    pub(crate) position: FrameIndex,
    /// What need not be made again; set by the source's step, if there is a store.
    pub(crate) plan: OnceLock<FramePlan>,
    /// The values from the store that nodes need, by place, until their steps lay them there.
    pub(crate) loaded: Mutex<BTreeMap<PlaceId, Value>>,
    /// The outputs without a value although their step ran, in no order.
    absent: Mutex<Vec<StepOutput>>,
    steps: Box<[Progress]>,
    cells: Box<[Mutex<Cell>]>,
    parts: Box<[Mutex<Option<P>>]>,
    remaining: AtomicU32,
    /// What failed, by step, in no order.
    faults: Mutex<Vec<(StepId, Fault)>>,
    tap_errors: Mutex<Vec<(PartId, ErrorMessage)>>,
    audit_failure: Mutex<Option<Box<AuditFailure>>>,
    /// The warnings, in no order.
    warnings: Mutex<Vec<Warned>>,
}

impl<P> InFlight<P> {
    pub(crate) fn new(position: FrameIndex, graph: &FrameGraph) -> Self {
        let progress = |waits_for| Progress { pending: AtomicU32::new(waits_for), settled: OnceLock::new() };
        let cell = |place: &Place| Mutex::new(Cell { value: None, key: None, uses: place.uses });
        Self {
            position,
            plan: OnceLock::new(),
            loaded: Mutex::default(),
            absent: Mutex::default(),
            steps: graph.order.iter().map(|o| progress(o.waits_for)).collect(),
            cells: graph.places.iter().map(cell).collect(),
            parts: graph.parts.iter().map(|_| Mutex::new(None)).collect(),
            remaining: AtomicU32::new(graph.steps_per_frame),
            faults: Mutex::default(),
            tap_errors: Mutex::default(),
            audit_failure: Mutex::default(),
            warnings: Mutex::default(),
        }
    }

    /// Puts a value where its takers look for it; drops it if there are none.
    pub(crate) fn put(&self, place: PlaceId, value: Value, key: Option<Key>) {
        let mut cell = locked(&self.cells[place]);
        if cell.uses > 0 {
            (cell.value, cell.key) = (Some(value), key);
        }
    }

    /// Takes a value, if it is there, and its key. The last to take it takes it out.
    pub(crate) fn take(&self, place: PlaceId) -> Option<(Value, Option<Key>)> {
        let mut cell = locked(&self.cells[place]);
        cell.uses -= 1;
        let value = if cell.uses == 0 { cell.value.take() } else { cell.value.clone() };
        value.map(|value| (value, cell.key))
    }

    /// What a step does on this frame.
    pub(crate) fn action(&self, step: StepId) -> &StepAction {
        self.plan.get().map_or(&StepAction::Run, |plan| &plan.steps[step])
    }

    /// How a step ended; `None` while it has not.
    pub(crate) fn settled(&self, step: StepId) -> Option<&Settled> {
        self.steps[step].settled.get()
    }

    /// Whether a step has ended without values because something failed.
    pub(crate) fn is_without_values(&self, step: StepId) -> bool {
        self.settled(step).is_some_and(|s| matches!(s.outcome, Outcome::Failed | Outcome::Skipped(_)))
    }

    /// Ends a step; tells whether it was the frame's last. `ready` is called with the steps that waited for nothing else.
    pub(crate) fn settle(
        &self,
        step: StepId,
        settled: Settled,
        graph: &FrameGraph,
        mut ready: impl FnMut(StepId),
    ) -> bool {
        let fresh = self.steps[step].settled.set(settled).is_ok();
        debug_assert!(fresh, "a step ends once");
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

    /// The encoded parts in order.
    pub(crate) fn take_parts(&self) -> Vec<P> {
        self.parts.iter().filter_map(|part| locked(part).take()).collect()
    }

    pub(crate) fn add_fault(&self, step: StepId, fault: Fault) {
        locked(&self.faults).push((step, fault));
    }

    /// Notes that an output has no value although its step ran.
    pub(crate) fn add_absent(&self, output: StepOutput) {
        locked(&self.absent).push(output);
    }

    /// The outputs without a value although their step ran, in order.
    pub(crate) fn take_absent(&self) -> Vec<StepOutput> {
        let mut absent = std::mem::take(&mut *locked(&self.absent));
        absent.sort_unstable();
        absent
    }

    pub(crate) fn add_warnings(&self, warnings: impl Iterator<Item = Warned>) {
        locked(&self.warnings).extend(warnings);
    }

    /// The warnings, in the order of the nodes.
    pub(crate) fn take_warnings(&self) -> Vec<Warned> {
        let mut warnings = std::mem::take(&mut *locked(&self.warnings));
        warnings.sort();
        warnings
    }

    pub(crate) fn add_tap_error(&self, part: PartId, error: ErrorMessage) {
        locked(&self.tap_errors).push((part, error));
    }

    pub(crate) fn add_audit_failure(&self, failure: Box<AuditFailure>) {
        locked(&self.audit_failure).get_or_insert(failure);
    }

    /// A stored value that differs from the one that was computed again, if there is one.
    pub(crate) fn take_audit_failure(&self) -> Option<Box<AuditFailure>> {
        locked(&self.audit_failure).take()
    }

    /// Whether something has failed so far.
    pub(crate) fn has_failed(&self) -> bool {
        !locked(&self.faults).is_empty()
    }

    /// What failed, in the order of the steps.
    pub(crate) fn take_faults(&self) -> Vec<(StepId, Fault)> {
        let mut faults = std::mem::take(&mut *locked(&self.faults));
        faults.sort_by_key(|(step, _)| *step);
        faults
    }

    /// Why the tap refused the frame, if it did: the error of its first part.
    pub(crate) fn take_tap_error(&self) -> Option<ErrorMessage> {
        let errors = std::mem::take(&mut *locked(&self.tap_errors));
        errors.into_iter().min_by_key(|(part, _)| *part).map(|(_, error)| error)
    }
}
