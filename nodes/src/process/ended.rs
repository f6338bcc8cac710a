//! Programs that have ended: their standard error, and failures after their last reply, for the command that ran them.

use depthloom_threads::locked;
use std::fmt::Write as _;
use std::sync::Mutex;

/// A program that has ended, of those that wrote to standard error or failed after their last answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EndedProgram {
    /// The program, as messages name it.
    pub command: String,
    /// How it failed after its last reply, as a lower-case fragment; `None` if it did not.
    pub failure: Option<String>,
    /// What it wrote to standard error, as lines without control characters.
    pub printed: String,
    /// Whether it wrote more before that.
    pub is_cut: bool,
}

static ENDED: Mutex<Vec<EndedProgram>> = Mutex::new(Vec::new());
const MOST: usize = 1 << 20;

/// Takes all programs that have ended since the last call.
#[must_use]
pub fn take_ended() -> Vec<EndedProgram> {
    std::mem::take(&mut *locked(&ENDED))
}

#[cfg_attr(not(unix), expect(dead_code, reason = "programs are started on Unix alone"))]
pub(super) fn put(program: EndedProgram) {
    if program.printed.is_empty() && program.failure.is_none() {
        return;
    }
    let mut ended = locked(&ENDED);
    let printed_bytes: usize = ended.iter().map(|program| program.printed.len()).sum();
    if program.failure.is_some() || printed_bytes + program.printed.len() <= MOST {
        ended.push(program);
    }
}

/// What programs printed, as a text with a heading per program; empty if none printed anything.
#[must_use]
pub fn printed_text(programs: &[EndedProgram]) -> String {
    let mut text = String::new();
    for EndedProgram { command, printed, is_cut, .. } in programs.iter().filter(|program| !program.printed.is_empty()) {
        let blank = if text.is_empty() { "" } else { "\n" };
        let what = if *is_cut { "the end of its standard error" } else { "its standard error" };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{blank}== {command}: {what}\n{}", printed.trim_end());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::{EndedProgram, printed_text};

    #[test]
    fn the_text_has_a_heading_per_program_that_printed() {
        let program = |command: &str, printed: &str, is_cut| EndedProgram {
            command: command.to_owned(),
            failure: None,
            printed: printed.to_owned(),
            is_cut,
        };
        let programs = [program("a", "one\ntwo\n", false), program("b", "", false), program("c d", "end", true)];
        let expected = "== a: its standard error\none\ntwo\n\n== c d: the end of its standard error\nend\n";
        assert_eq!(printed_text(&programs), expected);
        assert_eq!(printed_text(&programs[1..2]), "");
    }
}
