//! Values to MCAP messages and back: writing and reading recordings.
//!
//! # Reading
//! ```no_run
//! use depthloom_graphs::Value;
//! use depthloom_graphs::plan::{FrameIndex, RunId};
//! use depthloom_recording::{Recording, RecordingError};
//!
//! fn valid_pixels(path: &str) -> Result<usize, RecordingError> {
//!     let recording = Recording::open(path)?; // whole, or up to the last commit: see `condition()`
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
//! A reader takes any topics of a stage run and gives a value for each. It reads and decompresses no other chunk. A
//! [`Recording`] is `Sync` and reads by position, and holds only the index in memory.
//!
//! [`EarlierRuns`] makes a store of recordings. A [`Recorder`] that has one gets keys instead of values
//! ([`Recorder::with_earlier`]), and copies chunks of the same key and labels. [`Recorder::resume`] continues an
//! unfinished file after its last commit, with the bytes of an uninterrupted run.
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
pub use read::recording::{RecordedContent, RecordedFrame, RecordedOnce, Recording};
pub use read::topic_sizes::TopicSize;
pub use reuse::earlier_runs::EarlierRuns;
pub use source::{Mcap, McapParams};
pub use write::attachments::Attachment;
pub use write::disk::{Disk, Through};
pub use write::part::Part;
pub use write::recorder::{Compression, Recorder, Written};
pub use write::resume::{Recovered, recover};

/// The version of what a recording holds, and how it is stored.
pub(crate) const FORMAT: &str = "5";
/// The versions that are read. In version 2 values share chunks, and maps of floats are images. In both 2 and 4, values
/// that depthloom 0.1 copied from an earlier run may be those of another variant: they can be looked at, and are never
/// reused.
pub(crate) const KNOWN_FORMATS: [&str; 3] = ["2", "4", FORMAT];
/// The most a chunk may hold, uncompressed: protobuf messages end there, and no frame of a camera comes near. Writer
/// and reader keep to the same number.
pub(crate) const LARGEST_CHUNK: u64 = 1 << 31;
/// The most bytes of a chunk's body before its records.
pub(crate) const LONGEST_CHUNK_HEADER: u64 = 40 + "zstd".len() as u64;
/// The metadata record that holds format, plan and aliases.
pub(crate) const PLAN_METADATA: &str = "depthloom";
/// The metadata records that say which attachment holds which once-value: the topic follows, for viewers know a record
/// by its name.
pub(crate) const ONCE_METADATA: &str = "depthloom.once";
/// The metadata record of a run that ended before its end.
pub(crate) const ENDED_METADATA: &str = "depthloom.ended";
/// The entry of that record in a file that `recover` wrote.
pub(crate) const RECOVERED: &str = "recovered";
/// What a channel calls the topic of the plan, where its own is another.
pub(crate) const TOPIC_IN_PLAN: &str = "topic_in_plan";
