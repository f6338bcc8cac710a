//! Why a run ended before its end.

use depthloom_graphs::contracts::ErrorMessage;
use depthloom_graphs::{Fault, Remedied};

use crate::audit::failure::AuditFailure;

/// Why a run ended before its end. What was written before stays written.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A node failed on a frame: of the frames that failed the first, and of its nodes the first in plan order.
    #[error("node `{stage}.{node}`{} failed on frame {frame}", of_variants(.variants))]
    NodeFailed {
        /// The stage.
        stage: String,
        /// The node.
        node: String,
        /// The variants it serves; empty if all.
        variants: Vec<String>,
        /// The frame's id.
        frame: String,
        /// What failed.
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
        /// What failed.
        #[source]
        fault: Box<Fault>,
    },
    /// A node failed outside any frame: a once-node, or an ordered node when it finished.
    #[error("node `{stage}.{node}`{} failed", of_variants(.variants))]
    OnceFailed {
        /// The stage.
        stage: String,
        /// The node.
        node: String,
        /// The variants it serves; empty if all.
        variants: Vec<String>,
        /// What failed.
        #[source]
        fault: Box<Fault>,
    },
    /// The tap refused a frame or a once-value.
    #[error("failed to record {what} of stage `{stage}`")]
    Tap {
        /// The stage.
        stage: String,
        /// Which frame or once-value.
        what: String,
        /// Why.
        #[source]
        error: ErrorMessage,
    },
    /// The unfinished recording that a run resumes holds an aggregate value that was computed from something else.
    #[error("the recorded aggregate value of node `{stage}.{node}` was computed from other inputs than today's")]
    OutdatedAggregate {
        /// The stage.
        stage: String,
        /// The node.
        node: String,
    },
    /// A value that was reused is not what its node computes now.
    #[error(transparent)]
    Audit(Box<AuditFailure>),
    /// The plan asks for what cannot be run: an error of whoever made it.
    #[error("the plan of stage `{stage}` cannot be run: {what}")]
    Unrunnable {
        /// The stage.
        stage: String,
        /// What contradicts what.
        what: String,
    },
    /// The machine gave no thread.
    #[error("failed to start a worker thread")]
    NoThread(#[source] std::io::Error),
    /// The run was interrupted twice and abandoned.
    #[error("aborted")]
    Aborted,
}

impl Remedied for RunError {
    fn remedy(&self) -> Option<String> {
        match self {
            Self::NodeFailed { fault, .. } | Self::SourceFailed { fault, .. } | Self::OnceFailed { fault, .. } => {
                fault.remedy_text().map(str::to_owned)
            }
            Self::NoThread(_) => {
                Some("raise the limit of threads (`ulimit -u`), or run with fewer --workers".to_owned())
            }
            Self::Tap { error, .. } => error.remedy.clone(),
            Self::OutdatedAggregate { .. } => {
                Some("recompute the run: --fresh --overwrite, with the same --out".to_owned())
            }
            Self::Audit(failure) => Some(failure.remedy()),
            Self::Unrunnable { .. } | Self::Aborted => None,
        }
    }
}

impl RunError {
    /// Whether it is frames of the data that failed, and not the engine, the disk or learning.
    #[must_use]
    pub const fn is_of_a_frame(&self) -> bool {
        matches!(self, Self::NodeFailed { .. } | Self::SourceFailed { .. })
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
            frame: "000150_10".into(),
            fault: Box::new(Fault::new("no pixel was answered").remedy("lower `threshold`")),
        };
        assert_eq!(error.to_string(), "node `compare.merged` (variants full, mean) failed on frame 000150_10");
        assert_eq!(error.remedy().as_deref(), Some("lower `threshold`"));
    }
}
