//! Panics in nodes, sources and taps, turned into faults.

use depthloom_graphs::Fault;
use depthloom_threads::Caught;

/// A panic as the fault of whoever panicked.
pub(crate) fn fault(Caught(message): Caught) -> Fault {
    Fault::new(format!("panicked {message}")).remedy("this is an error in the engine or in a node: please report it")
}
