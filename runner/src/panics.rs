//! Panics in nodes, sources and sinks, turned into errors.

use depthloom_graphs::{ErrorMessage, Fault};
use depthloom_threads::caught;

/// Runs code of a node or a source.
pub(crate) fn guarded<T>(run: impl FnOnce() -> Result<T, Fault>) -> Result<T, Fault> {
    caught(run).unwrap_or_else(|panic| {
        let fault = Fault::new(format!("panicked {}", panic.0));
        Err(fault.remedy("this is an error in the engine or in a node: please report it"))
    })
}

/// Runs code of a sink.
pub(crate) fn guarded_sink<T>(run: impl FnOnce() -> Result<T, ErrorMessage>) -> Result<T, ErrorMessage> {
    caught(run).unwrap_or_else(|panic| Err(ErrorMessage::new(format!("panicked {}", panic.0))))
}
