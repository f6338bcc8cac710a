//! Values to MCAP messages and back: writing and reading recordings.
//!
//! # Reading
//! ```text
//! let recording = Recording::open(path)?;                    // whole, or cut off by a crash: then up to the last commit
//! let plan: &RecordedPlan = recording.plan();                // runs, nodes, params, topics, aliases, estimates
//! for (run, planned) in plan.runs.iter().enumerate() {
//!     let frames: &[RecordedFrame] = recording.frames(run);  // id, index, time_ns, source_key, keys, failures
//!     // Any topics (or aliases) of the run; chunks that hold none of them are neither read nor decompressed.
//!     let mut reader: FrameReader<'_> = recording.reader(run, &["/compare/source/depth", "/compare/fused/depth"])?;
//!     for position in 0..frames.len() {
//!         let values: Vec<Option<Value>> = reader.read(position)?;   // one a topic, in the order asked for
//!     }
//!     for estimate in &planned.estimates {
//!         // label, name, variant, estimate_topic, truth_topic, score_topic, score_node, score_params
//!     }
//! }
//! ```
//! `Recording` is `Sync` and reads by position, so several `FrameReader`s may work on it at once; a score topic gives
//! `Value::Scores`. Nothing but the index is held in memory.

mod chunk;
mod decode;
mod digest;
mod encode;
mod error;
mod file;
mod index;
mod layout;
mod messages;
mod plan;
mod protobuf;
mod reader;
mod record;
mod recorder;
mod recording;
mod schema;
mod store;
mod unpack;
mod writer;

pub use chunk::Part;
pub use digest::digest;
pub use error::RecordingError;
pub use index::AttachmentEntry;
pub use plan::{
    RecordedEstimate, RecordedInput, RecordedNode, RecordedOutput, RecordedPlan, RecordedRun, RecordedSource,
    RecordedSourcePart,
};
pub use reader::FrameReader;
pub use recorder::{Attachment, Recorder, Written};
pub use recording::{RecordedFrame, RecordedOnce, Recording};

/// The version of what a recording holds beside the values.
pub(crate) const FORMAT: &str = "1";
/// The metadata record that holds format, plan and aliases.
pub(crate) const PLAN_METADATA: &str = "depthloom";
/// The metadata records that say which attachment holds which once-value.
pub(crate) const ONCE_METADATA: &str = "depthloom.once";
