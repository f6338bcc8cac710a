//! Nodes made again from what a recording holds of their inputs, and compared with what it holds of their outputs.
//!
//! Every node gets the values that were *recorded* for it, not those that others make now: a node that differs is itself the one that
//! changed, and not one that a changed node feeds. It is a run like any other, on the same runner: its source reads the recording, its
//! tap compares.

#![forbid(unsafe_code)]

mod guard;
mod plan;
mod report;
mod source;
mod tally;
mod tolerance;

pub use plan::{Replay, Replayed, Unchecked};
pub use report::{ComparedNode, NodeName, NumberDifference, OtherNode, Report, SHOWN, node_name};
pub use tally::{Checker, Outcome, Placed, Tally};
pub use tolerance::{Tolerance, Tolerances};
