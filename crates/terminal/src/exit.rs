//! How a command ends.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::io;

use depthloom_durable::remedy_of_writing;
use depthloom_graphs::Remedied;
use depthloom_graphs::language::Diagnostic;
use depthloom_graphs::ready::NotReady;

/// The meaning of an exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Everything asked for was done.
    Whole = 0,
    /// The engine, the disk or learning failed.
    Engine = 1,
    /// Found before any frame was admitted: the file, the arguments, missing data.
    Before = 2,
    /// Frames failed or were dropped, not one pixel could be scored, or a recording is damaged.
    Frames = 3,
    /// Interrupted.
    Interrupted = 130,
}

/// An error with its remedy and the exit code it ends the program with.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Stop {
    /// The exit code.
    pub exit: Exit,
    /// What went wrong, with everything beneath, joined by colons.
    pub message: String,
    /// What the person can do about it.
    pub remedy: Option<String>,
    /// What was found one by one, where the message only counts it.
    pub problems: Vec<Problem>,
}

/// One of several things that are wrong.
#[derive(Debug)]
pub enum Problem {
    /// At a place in the experiment.
    Placed(Diagnostic),
    /// On this machine: what it is, and what can be done about it.
    Here(String, Option<String>),
}

impl Stop {
    /// Ends with this code and message.
    pub fn new(exit: Exit, message: impl Into<String>) -> Self {
        Self { exit, message: message.into(), remedy: None, problems: Vec::new() }
    }

    /// Ends with this code, an intent ("failed to ...") and the error beneath.
    pub fn because(exit: Exit, intent: impl Display, error: &dyn std::error::Error) -> Self {
        Self::new(exit, format!("{intent}: {}", chain(error)))
    }

    /// As [`Stop::because`], with the remedy that the error knows.
    pub fn remedied(exit: Exit, intent: impl Display, error: &impl Remedied) -> Self {
        Self { remedy: error.remedy(), ..Self::because(exit, intent, error) }
    }

    /// As [`Stop::because`], with what helps where a folder of ours cannot be written.
    pub fn of_writing(exit: Exit, intent: impl Display, error: &io::Error) -> Self {
        Self { remedy: remedy_of_writing(error).map(ToOwned::to_owned), ..Self::because(exit, intent, error) }
    }

    /// What this machine or this data lacks: itself where it is one thing, else these one by one.
    #[must_use]
    pub fn of_missing(missing: &[NotReady]) -> Self {
        let told = |error: &NotReady| (chain(error), error.fault().remedy_text().map(ToOwned::to_owned));
        match missing {
            [only] => {
                let (message, remedy) = told(only);
                Self { remedy, ..Self::new(Exit::Before, message) }
            }
            several => {
                // Variants of one node lack the same.
                let mut problems: Vec<_> = several.iter().map(told).collect();
                let mut seen = BTreeSet::new();
                problems.retain(|problem| seen.insert(problem.clone()));
                match problems.len() {
                    1 => Self::of_missing(&several[..1]),
                    count => Self::new(Exit::Before, format!("{count} things are missing"))
                        .problems(problems.into_iter().map(|(message, remedy)| Problem::Here(message, remedy))),
                }
            }
        }
    }

    /// Says what was found one by one.
    pub fn problems(self, problems: impl IntoIterator<Item = Problem>) -> Self {
        Self { problems: problems.into_iter().collect(), ..self }
    }

    /// Says what the person can do about it.
    pub fn remedy(self, remedy: impl Into<String>) -> Self {
        Self { remedy: Some(remedy.into()), ..self }
    }

    /// Adds to what the person can do about it.
    pub fn also(self, more: impl Into<String>) -> Self {
        let more = more.into();
        let remedy = match &self.remedy {
            Some(remedy) => format!("{remedy}; {more}"),
            None => more,
        };
        self.remedy(remedy)
    }
}

/// What helps against an error: what the system asks for, however deep beneath the message it was said, and the remedy that is known.
pub fn help_of(message: &str, remedy: Option<&str>) -> Option<String> {
    let of_the_system =
        remedy_of_the_system(message).filter(|_| !remedy.is_some_and(|said| said.contains("`ulimit -n`")));
    let remedies: Vec<&str> = of_the_system.into_iter().chain(remedy).collect();
    (!remedies.is_empty()).then(|| remedies.join("; "))
}

/// The remedy for what the system refuses anywhere.
fn remedy_of_the_system(message: &str) -> Option<&'static str> {
    let too_many = message.contains("Too many open files") && !message.contains("open files in system");
    too_many.then_some("raise the limit of open files (`ulimit -n`)")
}

/// An error and everything beneath it, joined by colons.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut below = error.source();
    while let Some(error) = below {
        // Some errors repeat their source in their own words.
        let next = error.to_string();
        if !text.ends_with(&next) {
            text.push_str(": ");
            text.push_str(&next);
        }
        below = error.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Fault;
    use depthloom_graphs::ready::NotReady;

    use super::Stop;

    fn refusal(name: &str) -> NotReady {
        let fault = Fault::new("it would start a program").remedy("allow it");
        NotReady::Node { stage: "look".to_owned(), name: name.to_owned(), kind: "process".to_owned(), fault }
    }

    #[test]
    fn what_all_variants_of_a_node_lack_is_reported_once() {
        let one = Stop::of_missing(&[refusal("own"), refusal("own"), refusal("own")]);
        assert!(one.problems.is_empty() && one.message.contains("`look.own`"), "{}", one.message);
        assert_eq!(one.remedy.as_deref(), Some("allow it"));
        let two = Stop::of_missing(&[refusal("own"), refusal("own"), refusal("other")]);
        assert_eq!((two.problems.len(), two.message.as_str()), (2, "2 things are missing"));
    }
}
