//! A panic ends the program, on whatever thread it happens.
//!
//! The runner catches panics of nodes and reports them as faults. Panics of its own threads and of training reach the
//! thread that joins them. If a thread of a library panics, other threads may wait for its result without end.

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};

use depthloom_terminal::{CliError, ExitCode};

use crate::output::diagnostics;
use crate::signals;

/// The panics of threads with these names are found by the thread that joins them.
const WATCHED: [&str; 2] = ["main", "depthloom-"];

const REMEDY: &str =
    "if the system refuses threads or files, raise its limits (`ulimit -u`, `ulimit -n`); else please report this";

/// Runs the program. A panic that no other thread finds is an error of the engine; with `--json` it is printed as JSON,
/// too.
pub(crate) fn watched(
    as_json: bool,
    program: impl FnOnce() -> Result<ExitCode, CliError>,
) -> Result<ExitCode, CliError> {
    let default_hook = take_hook();
    set_hook(Box::new(move |panic| {
        default_hook(panic);
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
