//! The commands, one file each (two where they are two views of one thing).

pub mod check;
pub mod doctor;
pub mod nodes;
pub mod plan;
pub mod report;
pub mod run;
pub mod shell;
pub mod synth;

use std::io::Write;

use crate::exit::{Exit, Stop};

/// Prints to standard output; a reader that went away (`| head`) ends the command quietly.
pub fn print(text: &str) -> Result<(), Stop> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Stop::because(Exit::Engine, "failed to print", &error)),
        Ok(()) => Ok(()),
    }
}

/// Prints a value as indented JSON.
pub fn print_json(value: &serde_json::Value) -> Result<(), Stop> {
    print(&format!("{value:#}\n"))
}
