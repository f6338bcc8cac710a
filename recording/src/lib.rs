//! Writes values as MCAP messages, and reads them: recordings.
//!
//! # Reading
//! ```no_run
//! use depthloom_graphs::Value;
//! use depthloom_graphs::plan::{FrameIndex, RunId};
//! use depthloom_recording::{Recording, RecordingError};
//!
//! fn valid_pixels(path: &str) -> Result<usize, RecordingError> {
//!     let recording = Recording::open(path)?; // complete, or up to the last commit: see `condition()`
//!     let mut valid = 0;
//!     for (run, planned) in RunId::enumerate(&recording.plan().runs) {
//!         for estimate in &planned.estimates {
//!             let Some(topic) = &estimate.estimate_topic else { continue };
//!             let mut reader = recording.reader(run, &[topic])?;
//!             for position in FrameIndex::all(recording.frames(run).len()) {
//!                 if let [Some(Value::Depth(depth))] = &reader.read(position)?[..] {
//!                     valid += depth.metres.iter().filter(|metres| !metres.is_nan()).count();
//!                 }
//!             }
//!         }
//!     }
//!     Ok(valid)
//! }
//! ```
//! A reader takes any topics of a stage run and returns a value for each. It reads and decompresses no other chunk. A
//! [`Recording`] is `Sync`, reads by offset, and keeps only the index in memory.
//!
//! [`EarlierRuns`] is a store of recordings. A [`Recorder`] with a store receives keys instead of values
//! ([`Recorder::with_earlier`]), and copies chunks with the same key and labels. [`Recorder::resume`] continues an
//! unfinished file after its last commit; the bytes are those of an uninterrupted run.
//!
//! `docs/reference/recording-format.md` describes the format.

mod checksum;
mod commit_message;
mod condition;
mod difference;
mod error;
mod plan;
mod read;
mod reuse;
mod source;
mod write;

pub use condition::Condition;
pub use depthloom_mcap::FileError;
pub use difference::{NodePair, PlanDifference, json_differences, node_pairs, source_differences};
pub use error::RecordingError;
pub use plan::{
    RecordedEstimate, RecordedInput, RecordedNode, RecordedOutput, RecordedPlan, RecordedRun, RecordedSource,
    RecordedSourcePart,
};
pub use read::attachment::AttachmentEntry;
pub use read::damage::Damage;
pub use read::damaged_content::DamagedContent;
pub use read::frame_reader::{FrameReader, StoredMessage};
pub use read::recording::{LiveTotals, RecordedAggregate, RecordedContent, RecordedFrame, RecordedWindow, Recording};
pub use read::topic_sizes::TopicSize;
pub use reuse::earlier_runs::EarlierRuns;
pub use source::{Mcap, McapParams};
pub use write::attachments::Attachment;
pub use write::disk::{Disk, WrapFile};
pub use write::messages::{MessageChannel, MessageEncoder};
pub use write::part::Part;
pub use write::recorder::{Compression, Recorder, Written};
pub use write::resume::{Recovered, recover};
pub use write::ring::{RingEvent, RingFile, RingOptions, RingSink};

/// The version of the recording format, the only one that is read. Version 0.1 of depthloom wrote 1 to 5.
pub(crate) const FORMAT: &str = "10";
/// The most bytes of an uncompressed chunk: the limit of protobuf messages, which no camera frame comes near. Writer
/// and reader use the same number.
pub(crate) const LARGEST_CHUNK: u64 = 1 << 31;
/// The most bytes of a chunk's body before its records.
pub(crate) const LONGEST_CHUNK_HEADER: u64 = 40 + "zstd".len() as u64;
/// The metadata record that holds format, plan and aliases.
pub(crate) const PLAN_METADATA: &str = "depthloom";
/// The metadata records that state which attachment contains which aggregate value. The topic follows in the name,
/// because viewers list a record by its name.
pub(crate) const AGGREGATE_METADATA: &str = "depthloom.once";
/// The metadata record of a run that ended early.
pub(crate) const ENDED_METADATA: &str = "depthloom.ended";
/// The metadata record of a file with a window of a live run's frames.
pub(crate) const WINDOW_METADATA: &str = "depthloom.window";
/// The entry of the record of a run that ended early in a file that `runs recover` wrote.
pub(crate) const RECOVERED: &str = "recovered";
/// The entry of a channel with its topic in the plan, if that differs from the channel's own topic.
pub(crate) const TOPIC_IN_PLAN: &str = "topic_in_plan";
