//! What is printed for a person and for a program, on streams that may be closed or full.
//!
//! What is printed comes in part from experiments, file names, recordings and programs of strangers. All of it goes
//! through this module, which leaves no character in it that a terminal obeys; see [`visible`].

mod visible;

use std::fmt::Display;
use std::io::{self, Write as _};
use std::path::Path;

pub use visible::{on_one_line, same_length, visible};

use crate::error::{CliError, ExitCode};

/// Prints a line to standard error. A closed reader or a full disk is ignored: results do not depend on
/// it.
pub fn say(line: impl Display) {
    tell(format_args!("{line}\n"));
}

/// Prints a text that has its own line ends to standard error; see [`say`].
pub fn tell(text: impl Display) {
    tell_styled(visible(&text.to_string()));
}

/// As [`tell`], of a text with escape sequences of our own, in which all else is [visible()] already.
pub fn tell_styled(text: impl AsRef<str>) {
    // In one piece, so that lines of several threads and processes do not mix.
    let _ = io::stderr().lock().write_all(text.as_ref().as_bytes());
}

/// Prints text to standard output; a reader that went away (`| head`) ends the command quietly.
///
/// # Errors
/// If standard output cannot be written; not if its reader went away.
pub fn print(text: impl AsRef<str>) -> Result<(), CliError> {
    print_bytes(visible(text.as_ref()).as_bytes())
}

/// Prints what is for a program, or of our own, byte for byte.
///
/// # Errors
/// If standard output cannot be written; not if its reader went away.
pub fn print_bytes(bytes: &[u8]) -> Result<(), CliError> {
    let mut out = io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(CliError::because(ExitCode::Engine, "failed to print", &error))
        }
        Ok(()) | Err(_) => Ok(()),
    }
}

/// Prints a value as indented JSON, of a format that is not ours: SARIF, JSON Schema.
///
/// # Errors
/// If standard output cannot be written; not if its reader went away.
pub fn print_json(value: &serde_json::Value) -> Result<(), CliError> {
    print_quoted(&format!("{value:#}\n"))
}

/// Prints JSON, or YAML in which every text of a stranger is quoted as JSON: what a terminal would obey is escaped, and
/// stays the same text.
///
/// # Errors
/// If standard output cannot be written; not if its reader went away.
pub fn print_quoted(text: &str) -> Result<(), CliError> {
    print_bytes(visible::in_quotes(text).as_bytes())
}

/// Prints a line that ends in a path. On a terminal it is [visible()]; otherwise its bytes are as they are: a program
/// that reads it finds the file.
///
/// # Errors
/// If standard output cannot be written; not if its reader went away.
pub fn print_path(what: &str, path: &Path) -> Result<(), CliError> {
    if io::IsTerminal::is_terminal(&io::stdout()) {
        return print(format!("{what}{}\n", on_one_line(&path.to_string_lossy())));
    }
    print_bytes(&[what.as_bytes(), path.as_os_str().as_encoded_bytes(), b"\n"].concat())
}
