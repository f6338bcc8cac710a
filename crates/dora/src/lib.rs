//! An experiment as a dataflow of dora: every source, every node and the recorder is a process, and dora carries the
//! values.
//!
//! | part | task |
//! |---|---|
//! | a source | reads frames when they are admitted, and sends their values |
//! | a node | receives its inputs frame by frame, and sends its outputs |
//! | a third-party node (kind `dora`) | is called by one of our parts, which knows frames and absent values |
//! | the recorder | runs the whole plan with the received values, so order, keys and failures are those of a run in one process |
//!
//! Every part runs the runner over its own piece of the plan. The recorder admits frames, so that no more are in flight
//! than dora's queues hold.

#![forbid(unsafe_code)]

mod bridge;
mod foreign;
mod incoming;
mod layout;
mod mailbox;
pub mod message;
mod node;
mod outgoing;
mod piece;
mod recorder;
mod remedies;
mod report;
mod written;

pub use bridge::{Bridge, BridgeStart};
pub use layout::{Layout, Role, print_of};
pub use mailbox::Mailbox;
pub use node::run as run_part;
pub use recorder::prepare;
pub use written::{DataflowOptions, dataflow, too_large};

/// Inputs and outputs of parts that do not carry values.
pub mod channel {
    /// The frames of a stage, from its source to its nodes and the recorder.
    pub const FRAMES: &str = "stage.frames";
    /// How many frames of its stage a source may read.
    pub const ADMITTED: &str = "stage.admitted";
    /// Whether a part can start, or what is missing.
    pub const READY: &str = "node.ready";
    /// The fingerprints of all engines, which enter the keys of aggregate nodes.
    pub const ENGINES: &str = "run.engines";
    /// What a part did on a frame, or for its aggregate values.
    pub const REPORT: &str = "node.report";
    /// The recording is complete: all parts end.
    pub const END: &str = "run.end";
}
