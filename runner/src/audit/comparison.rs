//! Compares recomputed values with those that are stored.

use depthloom_graphs::plan::{FrameIndex, NodeId, StageRun};
use depthloom_graphs::values::ValueDifference;
use depthloom_graphs::{Fault, Frame, Key, Outputs, Port, Value};

use super::failure::{AuditFailure, Cause};
use crate::error::RunError;
use crate::once_values::is_once;
use crate::reuse::{FramePlan, Reuse};
use crate::stage::frame_graph::{FrameGraph, OutputId, StepId, StepOutput};

/// How the kinds begin that run a program.
const PROGRAM: &str = "process";

/// The stored values of a stage run, to compare recomputed ones with.
pub(crate) struct Comparison<'s> {
    pub(crate) run: &'s StageRun,
    pub(crate) graph: &'s FrameGraph,
    pub(crate) frames: &'s [Frame],
    pub(crate) reuse: &'s Reuse<'s>,
}

impl Comparison<'_> {
    /// Compares the outputs of a step with those that are stored: how many values were compared.
    ///
    /// # Errors
    /// The first difference; `cause` is asked for what caused it.
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
            let of_step = StepOutput { step, output };
            let what = if let Some(key) = plan.stored(of_step) {
                compared += 1;
                self.difference(&key, &ports[output], now.as_ref())
            } else if plan.absent.contains(&of_step) {
                now.as_ref().map(|_| "stored that there is no value, recomputed one".to_owned())
            } else {
                None
            };
            if let Some(what) = what {
                return Err(Box::new(self.failure((position, plan), of_step, what, cause())));
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
                let difference = ValueDifference::between(&stored, now, 0.0);
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

    /// A failure of the audit.
    pub(crate) fn failure(
        &self,
        (position, plan): (FrameIndex, &FramePlan),
        StepOutput { step, output }: StepOutput,
        what: String,
        cause: Option<Cause>,
    ) -> AuditFailure {
        let run = self.run;
        let ports = &self.graph.producers[step].outputs;
        let port = ports.get(output.0).map_or("", |port| port.name);
        let is_program = match step.node() {
            None => run.source.parts.iter().any(|part| part.kind.starts_with(PROGRAM)),
            Some(node) => run.nodes[node].kind.starts_with(PROGRAM),
        };
        let kind_cause = match step {
            _ if is_program => Cause::Program,
            StepId::SOURCE => Cause::Data,
            _ => Cause::Implementation,
        };
        AuditFailure {
            producer: match step.node() {
                None => format!("source `{}` of stage `{}`", run.source.name, run.stage),
                Some(node) => format!("node `{}.{}`", run.stage, run.nodes[node].name),
            },
            port: port.to_owned(),
            frame: Some(self.frames[position].id.to_string()),
            what,
            cause: cause.unwrap_or(kind_cause),
            stored_in: plan.stored(StepOutput { step, output }).and_then(|key| self.reuse.origin(&key, port)),
        }
    }
}

/// Compares the aggregate values of a reused node with recomputed ones; gives how many were compared.
pub(crate) fn compare_aggregates(
    run: &StageRun,
    node: NodeId,
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
                let first = ValueDifference::between(stored, now, 0.0).first;
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
