//! What a case came to.

use crate::child::Ended;

/// What a case came to. The last three are faults of the program.
#[derive(Clone, Debug)]
pub(crate) enum Verdict {
    /// Exit code, what was printed and every file that matters are those of the undisturbed program.
    Equal,
    /// A non-zero exit code with a message.
    Error,
    /// Exit 0 with a partial answer, and a warning about it.
    Said,
    /// The machine lacks what the case needs.
    Skipped(String),
    /// Exit 0 with another answer and nothing said, or a promise that was not kept: what is the matter.
    Different(String),
    /// A panic, or an end by a signal of the processor or of `abort`.
    Panic(String),
    /// It did not end.
    Hang(String),
}

impl Verdict {
    pub(crate) fn different(what: impl Into<String>) -> Self {
        Self::Different(what.into())
    }
}

/// Signals that a program gets by its own fault: ILL, TRAP, ABRT, BUS, FPE, SEGV, SYS.
const OWN_FAULT: [i32; 7] = [4, 5, 6, 7, 8, 11, 31];
/// The exit codes that `depthloom --help` lists.
const KNOWN: [i32; 5] = [0, 1, 2, 3, 130];

/// The messages if there is no memory for the start of a thread: from glibc, which ends the program, and from the
/// panics of Rust's own start of a thread.
const BY_A_THREADS_START: [&str; 4] = [
    "Fatal glibc error",
    "cannot allocate memory for thread-local data",
    "failed to allocate an alternative stack",
    "failed to set up alternative stack guard page",
];

/// Faults in every area: a hang, a panic, an unknown exit code, an error without a message.
pub(crate) fn fault(ended: &Ended) -> Option<Verdict> {
    if ended.hung {
        return Some(Verdict::Hang(ended.summary()));
    }
    // An error that the program cannot catch.
    if BY_A_THREADS_START.iter().any(|text| ended.stderr.contains(text)) {
        return Some(Verdict::Error);
    }
    let own = ended.signal.is_some_and(|signal| OWN_FAULT.contains(&signal));
    let panicked =
        ["panicked at", "stack overflow", "memory allocation of"].iter().any(|text| ended.stderr.contains(text));
    if own || panicked || matches!(ended.code, Some(101 | 134)) {
        let place = ended.stderr.lines().find(|line| line.contains("panicked at")).unwrap_or_default();
        return Some(Verdict::Panic(format!("{} {place}", ended.summary())));
    }
    match ended.code {
        Some(code) if !KNOWN.contains(&code) => Some(Verdict::different(format!("an unknown {}", ended.summary()))),
        Some(code) if code != 0 && ended.stderr.trim().is_empty() && ended.stdout.trim().is_empty() => {
            Some(Verdict::different(format!("exit {code} without a word")))
        }
        _ => None,
    }
}

/// For a child that nothing from outside ended: its fault, an error, or what `answered` makes of exit 0.
pub(crate) fn judge(ended: &Ended, answered: impl FnOnce() -> Verdict) -> Verdict {
    if let Some(fault) = fault(ended) {
        return fault;
    }
    match (ended.code, ended.signal) {
        (Some(0), _) => answered(),
        (Some(_), _) => Verdict::Error,
        (None, signal) => Verdict::different(format!("ended by signal {signal:?}")),
    }
}

/// Whether a person who reads what was printed learns that the recording is not whole.
pub(crate) fn says_it_is_not_whole(ended: &Ended) -> bool {
    let printed = format!("{}\n{}", ended.stdout, ended.stderr).to_lowercase();
    ["unfinished", "not finished", " cut", "interrupted", "not whole", "damaged", "whole frame", "complete frame"]
        .iter()
        .any(|word| printed.contains(word))
}
