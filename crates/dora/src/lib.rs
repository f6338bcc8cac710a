//! An experiment as a dataflow of dora's: every source, every node and the recording a process of its own, with dora carrying values between them.
//!
//! | part | what it does |
//! |---|---|
//! | a source | reads frames as it is told to, and hands out their values |
//! | a node | gets its inputs, frame by frame, and hands out what it gives |
//! | a node of somebody else's (kind `dora`) | is asked by a part of ours, which knows of frames and absent values |
//! | the recorder | runs the whole plan, in which each node gives what its part gave: so order, keys, failures and what is recorded are the runner's, as in a run of one process |
//!
//! Every part runs the runner over its own piece of the plan: what comes is its source, what goes its tap. Frames are let in by the recorder, so that no more of them
//! are on their way than a queue of dora's holds.

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
pub use written::{Wanted, dataflow, too_large};

/// The outputs and inputs of parts that carry no value of a port.
pub mod channel {
    /// The frames of a stage, once, from its source to its nodes and the recorder.
    pub const FRAMES: &str = "stage.frames";
    /// How many frames of its stage a source may hand out by now.
    pub const ADMITTED: &str = "stage.admitted";
    /// That a part can begin, once; or what it lacks.
    pub const READY: &str = "node.ready";
    /// The fingerprints of the engines that nodes run in, once all parts can begin: they enter the keys of what fires once.
    pub const ENGINES: &str = "run.engines";
    /// What there is to say of a part, of a frame or of once-values besides the values.
    pub const REPORT: &str = "node.report";
    /// All is recorded: every part may go.
    pub const END: &str = "run.end";
}
