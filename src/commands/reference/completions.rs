//! `depthloom completions`: a shell's script.

use std::path::PathBuf;

use clap_complete::env::Shells;
use depthloom_terminal::{CliError, ExitCode, print_bytes};

use crate::completion::VARIABLE;

/// Prints the script: it completes the program by the name that it was called by, and asks it where it was found.
pub(crate) fn completions(shell: clap_complete::Shell, command: &clap::Command) -> Result<ExitCode, CliError> {
    let failed =
        |error: &dyn std::error::Error| CliError::because(ExitCode::Engine, "failed to write the script", error);
    let shells = Shells::builtins();
    let shell = shells.completer(&shell.to_string()).ok_or_else(|| {
        CliError::usage(format!("completion is not available for {shell}"), "use bash, elvish, fish, powershell or zsh")
    })?;
    let called = PathBuf::from(std::env::args_os().next().unwrap_or_default());
    // Found by name, it is found so again: it may move with an update.
    let completer = match called.components().count() {
        0 => PathBuf::from(command.get_name()),
        1 => called,
        _ => std::path::absolute(&called).map_err(|error| failed(&error))?,
    };
    let name = command.get_name();
    let mut script = Vec::new();
    shell
        .write_registration(VARIABLE, name, name, &completer.to_string_lossy(), &mut script)
        .map_err(|error| failed(&error))?;
    print_bytes(&script)?;
    Ok(ExitCode::Success)
}
