//! What is told to a person and what is given to a program, on streams that may be closed or full.

use std::fmt::Display;
use std::io::{self, Write as _};
use std::path::Path;

use crate::exit::{Exit, Stop};
use crate::outputs::Output;

/// Tells a line on standard error. A reader that went away or a full disk behind it costs no result: then nobody is told.
pub fn say(line: impl Display) {
    tell(format_args!("{line}\n"));
}

/// Tells a text that has its own line ends; see [`say`].
pub fn tell(text: impl Display) {
    // In one piece, so that lines of several threads and processes do not mix.
    let _ = io::stderr().lock().write_all(text.to_string().as_bytes());
}

/// Prints to standard output; a reader that went away (`| head`) ends the command quietly.
pub fn print(text: impl AsRef<[u8]>) -> Result<(), Stop> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_ref()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Stop::because(Exit::Engine, "failed to print", &error))
        }
        Ok(()) | Err(_) => Ok(()),
    }
}

/// Prints an output of a command as indented JSON, its format in front.
pub fn print_output(output: Output, value: serde_json::Value) -> Result<(), Stop> {
    print_json(&output.stamped(value))
}

/// Prints a value as indented JSON, of a format that is not ours: SARIF, JSON Schema.
pub fn print_json(value: &serde_json::Value) -> Result<(), Stop> {
    print(format!("{value:#}\n"))
}

/// Prints a line that ends in a path, its bytes as they are: a program that reads it finds the file.
pub fn print_path(what: &str, path: &Path) -> Result<(), Stop> {
    print([what.as_bytes(), path.as_os_str().as_encoded_bytes(), b"\n"].concat())
}
