//! Compares recomputed values with stored ones.

use depthloom_graphs::plan::{FrameIndex, NodeId, StageRun};
use depthloom_graphs::values::ValueDifference;
use depthloom_graphs::{Fault, Frame, Key, Outputs, Port, Value};

use super::failure::{AuditFailure, Cause};
use crate::aggregate_values::aggregate_ports;
use crate::error::RunError;
use crate::reuse::{FramePlan, Reuse};
use crate::stage::frame_graph::{FrameGraph, OutputId, StepId, StepOutput};

/// The stored values of a stage run.
pub(crate) struct Comparison<'s> {
    pub(crate) run: &'s StageRun,
    pub(crate) graph: &'s FrameGraph,
    pub(crate) frames: &'s [Frame],
    pub(crate) reuse: &'s Reuse<'s>,
}

impl Comparison<'_> {
    /// Compares the outputs of a step with the stored ones. Returns how many values were compared.
    ///
    /// # Errors
    /// The first difference, with its `cause` if that is known.
    pub(crate) fn differences(
        &self,
        position: FrameIndex,
        plan: &FramePlan,
        step: StepId,
        outputs: &[Option<Value>],
        cause: impl FnOnce() -> Option<Cause>,
    ) -> Result<u64, Box<AuditFailure>> {
        let ports = &self.graph.producers[step].outputs;
        let mut compared = 0;
        for (output, now) in OutputId::enumerate(outputs) {
            let id = StepOutput { step, output };
            let what = if let Some(key) = plan.stored(id) {
                compared += 1;
                self.stored_difference(&key, &ports[output], now.as_ref())
            } else if plan.absent.contains(&id) {
                now.as_ref().map(|_| "stored that there is no value, recomputed one".to_owned())
            } else {
                None
            };
            if let Some(what) = what {
                return Err(Box::new(self.failure((position, plan), id, what, cause())));
            }
        }
        Ok(compared)
    }

    fn stored_difference(&self, key: &Key, port: &Port, now: Option<&Value>) -> Option<String> {
        match self.reuse.store.values(&[(*key, port.name)]) {
            Ok(stored) => difference(port, stored.into_iter().next().flatten().as_ref(), now),
            Err(fault) => Some(format!("the stored value cannot be read: {}", fault.chain())),
        }
    }

    pub(crate) fn failure(
        &self,
        (position, plan): (FrameIndex, &FramePlan),
        StepOutput { step, output }: StepOutput,
        what: String,
        cause: Option<Cause>,
    ) -> AuditFailure {
        let run = self.run;
        let port = self.graph.producers[step].outputs.get(output.0).map_or("", |port| port.name);
        let (producer, kind_cause) = match step.node() {
            Some(node) => node_and_cause(run, node),
            None => {
                let is_program = run.source.parts.iter().any(|part| part.kind.starts_with(PROGRAM));
                let producer = format!("source `{}` of stage `{}`", run.source.name, run.stage);
                (producer, if is_program { Cause::Program } else { Cause::Data })
            }
        };
        AuditFailure {
            producer,
            port: port.to_owned(),
            frame: Some(self.frames[position].id.to_string()),
            what,
            cause: cause.unwrap_or(kind_cause),
            stored_in: plan.stored(StepOutput { step, output }).and_then(|key| self.reuse.store.origin(&key, port)),
        }
    }
}

/// The beginning of the kinds that run a program.
const PROGRAM: &str = "process";

fn node_and_cause(run: &StageRun, node: NodeId) -> (String, Cause) {
    let node = &run.nodes[node];
    let cause = if node.kind.starts_with(PROGRAM) { Cause::Program } else { Cause::Implementation };
    (format!("node `{}.{}`", run.stage, node.name), cause)
}

/// The first difference between a stored value and the recomputed one.
fn difference(port: &Port, stored: Option<&Value>, now: Option<&Value>) -> Option<String> {
    let name = port.name;
    match (stored, now) {
        (Some(stored), Some(now)) => {
            let ValueDifference { numbers, different, first, .. } = ValueDifference::between(stored, now, 0.0);
            let first = first?.text(port.value_type);
            Some(format!("`{name}`, {first}; {different} of {numbers} numbers differ"))
        }
        (None, None) => None,
        (Some(_), None) => Some(format!("stored a value of `{name}`, recomputed none")),
        (None, Some(_)) => Some(format!("stored no value of `{name}`, recomputed one")),
    }
}

/// Compares the aggregate values of a reused node with recomputed ones. Returns how many were compared.
pub(crate) fn compare_aggregates(
    run: &StageRun,
    node: NodeId,
    stored: &[Option<Value>],
    recomputed: Result<Outputs, Fault>,
) -> Result<u64, RunError> {
    let ports = aggregate_ports(&run.nodes[node]);
    let failure = |port: &str, what: String| {
        let (producer, cause) = node_and_cause(run, node);
        let port = port.to_owned();
        RunError::Audit(Box::new(AuditFailure { producer, port, frame: None, what, cause, stored_in: None }))
    };
    let recomputed = recomputed.and_then(|outputs| outputs.in_order_of(&ports));
    let recomputed = recomputed.map_err(|fault| failure("", now_fails(&fault)))?;
    for ((port, stored), now) in ports.iter().zip(stored).zip(&recomputed) {
        if let Some(what) = difference(port, stored.as_ref(), now.as_ref()) {
            return Err(failure(port.name, what));
        }
    }
    Ok(stored.iter().flatten().count() as u64)
}

pub(crate) fn now_fails(fault: &Fault) -> String {
    format!("stored a value, and now fails: {}", fault.chain())
}
