//! Compares recordings: nodes recomputed from their recorded inputs ([`Replay`]), and two runs ([`RunDifference`]).
//!
//! A recomputed node reads the values that were *recorded* for it, so a node that differs is itself the one that
//! changed. The runner runs it like any other: the source reads the recording, and the sink compares.

#![forbid(unsafe_code)]

mod guard;
mod plan;
mod report;
mod run_difference;
mod source;
mod tally;
mod tolerance;

pub use plan::{Replay, Replayed, Unchecked};
pub use report::{ComparedNode, NodeName, NumberDifference, OtherNode, Report, SHOWN, node_name};
pub use run_difference::RunDifference;
pub use tally::{Checker, Outcome, Placed, Tally};
pub use tolerance::{Tolerance, Tolerances};
