//! How a command ends.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::io::{self, ErrorKind};

use depthloom_durable::remedy_of_writing;
use depthloom_graphs::language::Diagnostic;
use depthloom_graphs::ready::NotReady;
use depthloom_graphs::{ErrorMessage, Remedied, chain};

/// The meaning of an exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExitCode {
    /// The command succeeded.
    Success = 0,
    /// The engine, the disk or learning failed.
    Engine = 1,
    /// An argument, the experiment or a file is wrong: found before any frame was admitted.
    Usage = 2,
    /// Frames failed or were dropped, values differ, a limit was exceeded, no pixel was scored, or a recording is
    /// damaged.
    FrameFailures = 3,
    /// Interrupted.
    Interrupted = 130,
}

impl ExitCode {
    /// All exit codes, with their meanings.
    pub const ALL: [(Self, &str); 5] = [
        (Self::Success, "success; there may be warnings"),
        (Self::Engine, "the engine, the analysis, learning or the disk failed, or the output could not be written"),
        (
            Self::Usage,
            "an argument, the experiment or a file is wrong or missing; no frame was run and nothing was removed",
        ),
        (
            Self::FrameFailures,
            "frames failed or were dropped, values differ, a limit of --fail-if was exceeded, no pixel was scored, or a recording is damaged",
        ),
        (Self::Interrupted, "interrupted; complete frames and files stay readable"),
    ];
}

/// An error, and the exit code that it ends the program with.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct CliError {
    /// The exit code.
    pub exit: ExitCode,
    /// What went wrong, with everything beneath, joined by colons; and what helps.
    pub message: ErrorMessage,
    /// The problems one by one, where the message only counts them.
    pub problems: Vec<Problem>,
}

/// One of several things that are wrong.
#[derive(Debug)]
pub enum Problem {
    /// At a place in the experiment.
    Placed(Diagnostic),
    /// On this machine.
    Here(ErrorMessage),
}

impl CliError {
    /// Ends with this code and message.
    pub fn new(exit: ExitCode, what: impl Into<String>) -> Self {
        Self { exit, message: ErrorMessage::new(what), problems: Vec::new() }
    }

    /// Something that is wrong before any frame is admitted, and what helps.
    pub fn usage(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(ExitCode::Usage, what).remedy(remedy)
    }

    /// A name that does not exist: suggests the nearest one, or `otherwise`.
    pub fn unknown(what: impl Into<String>, nearest: Option<&str>, otherwise: impl Into<String>) -> Self {
        Self::usage(what, nearest.map_or_else(|| otherwise.into(), |near| format!("did you mean `{near}`?")))
    }

    /// Ends with this code, an intent ("failed to ...") and the error beneath.
    pub fn because(exit: ExitCode, intent: impl Display, error: &dyn std::error::Error) -> Self {
        Self::new(exit, format!("{intent}: {}", chain(error)))
    }

    /// As [`CliError::because`], with the remedy that the error knows.
    pub fn remedied(exit: ExitCode, intent: impl Display, error: &impl Remedied) -> Self {
        Self::because(exit, intent, error).with_remedy(error.remedy())
    }

    /// Ends with this code and error, and the remedy that it knows.
    pub fn from_error(exit: ExitCode, error: &impl Remedied) -> Self {
        Self::new(exit, chain(error)).with_remedy(error.remedy())
    }

    /// As [`CliError::because`], with what helps where a folder of ours cannot be written. Without permission or space,
    /// the code is [`ExitCode::Engine`] at any moment: the arguments are right.
    pub fn of_writing(exit: ExitCode, intent: impl Display, error: &io::Error) -> Self {
        let exit = if is_refused(error) { ExitCode::Engine } else { exit };
        Self::because(exit, intent, error).with_remedy(remedy_of_writing(error).map(ToOwned::to_owned))
    }

    /// What this machine or this data lacks: one thing as it is, several one by one.
    #[must_use]
    pub fn of_missing(missing: &[NotReady]) -> Self {
        // Variants of one node lack the same.
        let mut seen = BTreeSet::new();
        let messages = missing.iter().map(|error| (chain(error), error.fault().remedy_text().map(ToOwned::to_owned)));
        let messages: Vec<ErrorMessage> = messages
            .filter(|message| seen.insert(message.clone()))
            .map(|(what, remedy)| ErrorMessage { what, remedy, source: None })
            .collect();
        Self::missing(messages)
    }

    /// What is missing: one thing as it is, several one by one.
    #[must_use]
    pub fn missing(mut messages: Vec<ErrorMessage>) -> Self {
        if messages.len() == 1 {
            return Self { exit: ExitCode::Usage, message: messages.remove(0), problems: Vec::new() };
        }
        Self::new(ExitCode::Usage, format!("{} things are missing", messages.len()))
            .problems(messages.into_iter().map(Problem::Here))
    }

    /// Adds the problems one by one.
    pub fn problems(self, problems: impl IntoIterator<Item = Problem>) -> Self {
        Self { problems: problems.into_iter().collect(), ..self }
    }

    /// Adds what the person can do about it.
    pub fn remedy(self, remedy: impl Into<String>) -> Self {
        self.with_remedy(Some(remedy.into()))
    }

    fn with_remedy(self, remedy: Option<String>) -> Self {
        Self { message: ErrorMessage { remedy, ..self.message }, ..self }
    }

    /// Extends what the person can do about it.
    pub fn also(self, more: impl Into<String>) -> Self {
        let more = more.into();
        let remedy = match &self.message.remedy {
            Some(remedy) => format!("{remedy}; {more}"),
            None => more,
        };
        self.remedy(remedy)
    }
}

/// Whether the system refused to write where the arguments say: no permission, or no space.
pub fn is_refused(error: &(dyn std::error::Error + 'static)) -> bool {
    use ErrorKind::{PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull};
    let mut causes = std::iter::successors(Some(error), |error| error.source());
    causes.any(|cause| {
        let kind = cause.downcast_ref::<io::Error>().map(io::Error::kind);
        matches!(kind, Some(PermissionDenied | ReadOnlyFilesystem | StorageFull | QuotaExceeded))
    })
}

/// What helps against an error: the known remedy, and one for what the system reports in the message.
pub fn help_of(message: &ErrorMessage) -> Option<String> {
    let remedy = message.remedy.as_deref();
    let of_the_system =
        remedy_of_the_system(&message.what).filter(|_| !remedy.is_some_and(|text| text.contains("`ulimit -n`")));
    let remedies: Vec<&str> = of_the_system.into_iter().chain(remedy).collect();
    (!remedies.is_empty()).then(|| remedies.join("; "))
}

/// The remedy for what the system refuses anywhere.
fn remedy_of_the_system(message: &str) -> Option<&'static str> {
    let too_many = message.contains("Too many open files") && !message.contains("open files in system");
    too_many.then_some("raise the limit of open files (`ulimit -n`)")
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Fault;
    use depthloom_graphs::ready::NotReady;

    use super::CliError;

    fn refusal(name: &str) -> NotReady {
        let fault = Fault::new("it would start a program").remedy("allow it");
        NotReady::Node { stage: "look".to_owned(), name: name.to_owned(), kind: "process".to_owned(), fault }
    }

    #[test]
    fn what_all_variants_of_a_node_lack_is_reported_once() {
        let one = CliError::of_missing(&[refusal("own"), refusal("own"), refusal("own")]);
        assert!(one.problems.is_empty() && one.message.what.contains("`look.own`"), "{}", one.message);
        assert_eq!(one.message.remedy.as_deref(), Some("allow it"));
        let two = CliError::of_missing(&[refusal("own"), refusal("own"), refusal("other")]);
        assert_eq!((two.problems.len(), two.message.what.as_str()), (2, "2 things are missing"));
    }
}
