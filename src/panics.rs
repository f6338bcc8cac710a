//! A panic ends the program, on whatever thread it happens.
//!
//! The runner catches panics of nodes and tells them as faults. Those of its own threads and of learning's reach
//! whoever waits for them. A thread that a library started may leave others waiting for ever for what it was to give.

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};

use depthloom_terminal::{CliError, ExitCode};

use crate::output::diagnostics;
use crate::signals;

/// Threads of these names have somebody who finds their panics.
const WATCHED: [&str; 2] = ["main", "depthloom-"];

const REMEDY: &str =
    "if the system refuses threads or files, raise its limits (`ulimit -u`, `ulimit -n`); else please report this";

/// Runs the program; a panic that nobody else finds is an error of the engine, told to programs as well where they
/// asked for JSON.
pub(crate) fn watched(
    as_json: bool,
    program: impl FnOnce() -> Result<ExitCode, CliError>,
) -> Result<ExitCode, CliError> {
    let tell = take_hook();
    set_hook(Box::new(move |panic| {
        tell(panic);
        let thread = std::thread::current();
        if !thread.name().is_some_and(|name| WATCHED.iter().any(|watched| name.starts_with(watched))) {
            let stop = stop();
            diagnostics::print_stop(&stop);
            crate::print_error_json(as_json, &stop);
            signals::leave(ExitCode::Engine);
        }
    }));
    catch_unwind(AssertUnwindSafe(program)).unwrap_or_else(|_| Err(stop()))
}

fn stop() -> CliError {
    CliError::new(ExitCode::Engine, "the engine failed").remedy(REMEDY)
}
