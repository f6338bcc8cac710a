//! Why a run ended early.

use depthloom_graphs::contracts::ErrorMessage;
use depthloom_graphs::plan::{Plan, PlannedNode, RunId};
use depthloom_graphs::{Fault, Remedied};

use crate::audit::failure::{AuditFailure, on_frame};

/// Why a run ended early. What was written before stays written.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A node failed: on the first frame that failed, the first node in plan order; or outside frames.
    #[error("node `{stage}.{node}`{} failed{}", of_variants(.variants), on_frame(.frame))]
    NodeFailed {
        /// The stage.
        stage: String,
        /// The node.
        node: String,
        /// The variants it serves; empty if all.
        variants: Vec<String>,
        /// The frame's id; `None` for an aggregate node, and for an ordered node after its last frame.
        frame: Option<String>,
        /// The cause.
        #[source]
        fault: Box<Fault>,
    },
    /// A source could not read a frame.
    #[error("source `{source_name}` of stage `{stage}` failed on frame {frame}")]
    SourceFailed {
        /// The stage.
        stage: String,
        /// The source's name under `sources:`.
        source_name: String,
        /// The frame's id.
        frame: String,
        /// The cause.
        #[source]
        fault: Box<Fault>,
    },
    /// A stream ended with a failure.
    #[error("source `{source_name}` of stage `{stage}` failed after {frames} frames")]
    StreamFailed {
        /// The stage.
        stage: String,
        /// The source's name under `sources:`.
        source_name: String,
        /// How many frames were written.
        frames: u64,
        /// The cause.
        #[source]
        fault: Box<Fault>,
    },
    /// The sink refused a value.
    #[error("failed to record {what} of stage `{stage}`")]
    Sink {
        /// The stage.
        stage: String,
        /// A frame or an aggregate value.
        what: String,
        /// The cause.
        #[source]
        error: ErrorMessage,
    },
    /// The unfinished recording that a run resumes has an aggregate value that was computed from other inputs.
    #[error("the recorded aggregate value of node `{stage}.{node}` was computed from other inputs than today's")]
    OutdatedAggregate {
        /// The stage.
        stage: String,
        /// The node.
        node: String,
    },
    /// A reused value differs from the recomputed one.
    #[error(transparent)]
    Audit(Box<AuditFailure>),
    /// The plan contradicts itself: an error in the program that made it.
    #[error("the plan of stage `{stage}` cannot be run: {what}")]
    Unrunnable {
        /// The stage.
        stage: String,
        /// The contradiction.
        what: String,
    },
    /// The system refused a thread.
    #[error("failed to start a worker thread")]
    NoThread(#[source] std::io::Error),
    /// The run was interrupted twice and abandoned.
    #[error("aborted")]
    Aborted,
}

impl Remedied for RunError {
    fn remedy(&self) -> Option<String> {
        match self {
            Self::NodeFailed { fault, .. } | Self::SourceFailed { fault, .. } | Self::StreamFailed { fault, .. } => {
                fault.remedy_text().map(str::to_owned)
            }
            Self::NoThread(_) => {
                Some("raise the limit of threads (`ulimit -u`), or run with fewer --workers".to_owned())
            }
            Self::Sink { error, .. } => error.remedy.clone(),
            Self::OutdatedAggregate { .. } => {
                Some("recompute the run: --fresh --overwrite, with the same --out".to_owned())
            }
            Self::Audit(failure) => Some(failure.remedy()),
            Self::Unrunnable { .. } | Self::Aborted => None,
        }
    }
}

impl RunError {
    pub(crate) fn of_node(plan: &Plan, run: RunId, node: &PlannedNode, frame: Option<String>, fault: Fault) -> Self {
        Self::NodeFailed {
            stage: plan.runs[run].stage.clone(),
            node: node.name.clone(),
            variants: node.variant_names(plan).into_iter().map(str::to_owned).collect(),
            frame,
            fault: Box::new(fault),
        }
    }

    /// Whether frames of the data failed, not the engine, the disk or a training.
    pub const fn is_of_a_frame(&self) -> bool {
        matches!(self, Self::NodeFailed { frame: Some(_), .. } | Self::SourceFailed { .. } | Self::StreamFailed { .. })
    }
}

/// ` (variants a, b)`, or nothing.
fn of_variants(variants: &[String]) -> String {
    match variants {
        [] => String::new(),
        [only] => format!(" (variant {only})"),
        several => format!(" (variants {})", several.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::{Fault, Remedied as _};

    use super::RunError;

    #[test]
    fn the_message_names_node_variants_and_frame() {
        let error = RunError::NodeFailed {
            stage: "compare".into(),
            node: "merged".into(),
            variants: vec!["full".into(), "mean".into()],
            frame: Some("000150_10".into()),
            fault: Box::new(Fault::new("no pixel is valid").remedy("lower `threshold`")),
        };
        assert_eq!(error.to_string(), "node `compare.merged` (variants full, mean) failed on frame 000150_10");
        assert_eq!(error.remedy().as_deref(), Some("lower `threshold`"));
    }
}
