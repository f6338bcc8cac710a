//! Values to MCAP messages and back: writing and reading recordings.
//!
//! # Reading
//! ```no_run
//! use depthloom_graphs::Value;
//! use depthloom_graphs::plan::{FrameIndex, RunId};
//! use depthloom_recording::{Recording, RecordingError};
//!
//! fn answered_pixels(path: &str) -> Result<usize, RecordingError> {
//!     let recording = Recording::open(path)?; // whole, or up to the last commit: `condition()` says which
//!     let mut answered = 0;
//!     for (run, planned) in RunId::enumerate(&recording.plan().runs) {
//!         for estimate in &planned.estimates {
//!             let Some(topic) = &estimate.estimate_topic else { continue };
//!             let mut reader = recording.reader(run, &[topic])?;
//!             for position in FrameIndex::all(recording.frames(run).len()) {
//!                 if let [Some(Value::Depth(depth))] = &reader.read(position)?[..] {
//!                     answered += depth.metres.iter().filter(|metres| !metres.is_nan()).count();
//!                 }
//!             }
//!         }
//!     }
//!     Ok(answered)
//! }
//! ```
//! A reader takes any topics of a stage run (or their aliases) and gives a value for each; chunks that hold none of them are
//! neither read nor decompressed. A [`Recording`] is `Sync` and reads by position: several readers may work on it at once.
//! Nothing but the index is held in memory.
//!
//! # What a recording is
//! An MCAP file of protobuf channels that any MCAP reader opens. `log_time` and `publish_time` are the frame's time, `sequence`
//! its index. Of a source that has no clock, but counts its frames from zero, the time is 2000-01-01T00:00:00Z and a tenth of a second
//! for each frame of the stage before.
//!
//! | value | message | pixels |
//! |---|---|---|
//! | image with its file's bytes | `foxglove.CompressedImage` | the file, unchanged |
//! | image | `foxglove.RawImage` | `rgb8` or `mono8` |
//! | true disparity | `foxglove.RawImage` | `16UC1`: `value / 256` pixels, 0 = unknown, as in KITTI's files; where that does not hold a map exactly, `depthloom.FloatMap`, pixels, NaN = unknown |
//! | disparity | `foxglove.RawImage` | `16UC1`: 0 = nothing found, else `value / 16 + min_disparity_px - 1` pixels; `min_disparity_px`, the smallest disparity searched, is field 1001; where that does not hold a map exactly, `depthloom.FloatMap`, pixels, NaN = nothing found |
//! | depth | `depthloom.FloatMap` | metres, NaN = no answer; `inverse`, field 10, is the inverse depth, 1/m, that a network gave where metres do not hold it, and NaN elsewhere |
//! | weight | `depthloom.FloatMap` | |
//! | mask | `foxglove.RawImage` | `mono8` |
//! | calibration | `foxglove.CameraCalibration` | field 1001 is the pair's baseline, 1002, where it is not 0, how much farther right the right camera's principal point lies |
//! | scores | `depthloom.Score`, one a zone and pixel set | a score that was not asked for, or of no pixel, is absent |
//! | learning curve | `depthloom.CurvePoint`, one a point | outside frames: `log_time` is that of the stage's first frame, a millisecond more a step |
//!
//! A `depthloom.FloatMap` has its samples as they are, or in fewer bytes: [`floats`](depthloom_codecs::floats) says how, and `python/src/depthloom/_maps.py` reads both in NumPy.
//!
//! # What viewers need beside
//! The source's first image port is the reference camera, in whose pixels all maps are; the second is the right camera of the pair. A camera
//! is a folder of topics and a coordinate frame: images and the calibration are not under their topics in the plan but under
//! `/<stage>/source/<camera>/image` and `.../calibration`, and the channel says `topic_in_plan`; readers here take the plan's. Beside a
//! calibration lie the right camera's (with `P[3] = -f B`), and where the cameras stand, as `foxglove.FrameTransform`. Beside a disparity,
//! depth or weight lies, but with `view: false`, a picture of it, `/<stage>/view/<node>.<output>`: a `foxglove.CompressedImage` of half the pixels
//! a row and column ([`depthloom_codecs::picture`]), whose camera is `/<stage>/view`. These messages are parts of their values: made of them
//! alone, under the same commit, copied with them, and never read back.
//!
//! Disparities count from one pixel below the smallest searched, because `foxglove.RawImage` knows 16 bits without a sign only: a
//! viewer that takes the numbers at their word shows what is nearer as larger, and a pixel without an answer as zero.
//!
//! A frame is some chunks of values and then one chunk with its `depthloom.Commit` on `/<stage>/commit`; what stands behind the
//! last commit of an unfinished file belongs to no frame. Chunks never cross frames. Each raster has a chunk of its own, so that
//! nothing is read or decompressed that was not asked for; calibrations share one, scores another. Whether a raster is compressed is
//! measured on a sample of its own, so equal values are equal bytes whoever encodes them. With `every: n`, the first frame of a stage run and each nth after it keep
//! their values, however the source numbers them; all keep scores and commits.
//!
//! The metadata record `depthloom` holds the format's version, the plan ([`RecordedPlan`] as JSON) and the aliases of topics;
//! `depthloom.once/<stage>/<node>/<output>` says which attachment `artifacts/<hash>` holds which once-value, and of a learning curve its topic and how many
//! messages it is. A curve is one chunk between two frames, with its `depthloom.once` behind it: without that record, in a file
//! that was cut between the two, its messages belong to nothing. The experiment's files are attachments, as
//! written (`experiment/`) and as resolved.
//!
//! # What is checked
//! Chunks, attachments and the summary have MCAP's own checksums, which are always there and always compared. What MCAP leaves
//! unchecked has ours: each metadata record holds `checksum`, over its name and its other entries, and it and each commit hold
//! `crc32_before`, the CRC-32 of all bytes of the file before their record (of a commit: before its chunk). So a finished file is
//! opened by its summary in little time, and a file without an end, or with a damaged one, is read once from its start and kept
//! up to the last commit before which every byte is what was written. [`Recording::condition`] says which it was. Of a finished file
//! [`Recording::damage`] checks every byte, without decompressing one.
//! No message is larger than 2 GiB, and no chunk; what would be is refused with its size, by writer and reader.
//!
//! A run that was interrupted, or failed, closes its file with a summary and with a metadata record `depthloom.ended` before it: any
//! reader finds its way, and [`Recording::condition`] is unfinished.
//!
//! # Taken from, and taken up
//! [`EarlierRuns`] makes a store of recordings: a [`Recorder`] that has one is handed keys instead of values ([`Recorder::with_earlier`]), and copies
//! the chunks that are stored under the key of a value and have its labels; other values are decoded and encoded. The bytes
//! of a frame are compared with `crc32_before` of its commit before anything of it is taken. [`Recorder::resume`] goes on with a file
//! that was not finished, behind its last commit; the file ends with the bytes of one that was written at once.
//!
//! # A file that was not finished, read by others
//! A run that was killed leaves no summary. Python's `mcap` then finds nothing by default, since `make_reader` looks for the
//! summary first. `mcap.reader.NonSeekingReader(file).iter_messages(log_time_order=False)` reads from the start, and gives all
//! messages before it says that the file ends too early. `depthloom report` takes such a file as it is.

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
/// The versions that are read. In version 2 values share chunks, and maps of floats are images. In both 2 and 4, values that depthloom 0.1 copied from
/// an earlier run may be those of another variant: they can be looked at, and are never reused.
pub(crate) const KNOWN_FORMATS: [&str; 3] = ["2", "4", FORMAT];
/// The most a chunk may hold, uncompressed: protobuf messages end there, and no frame of a camera comes near. Writer and reader
/// keep to the same number.
pub(crate) const LARGEST_CHUNK: u64 = 1 << 31;
/// The most bytes of a chunk's body before its records.
pub(crate) const LONGEST_CHUNK_HEADER: u64 = 40 + "zstd".len() as u64;
/// The metadata record that holds format, plan and aliases.
pub(crate) const PLAN_METADATA: &str = "depthloom";
/// The metadata records that say which attachment holds which once-value: the topic follows, for viewers know a record by its name.
pub(crate) const ONCE_METADATA: &str = "depthloom.once";
/// The metadata record of a run that ended before its end.
pub(crate) const ENDED_METADATA: &str = "depthloom.ended";
/// The entry of that record in a file that `recover` wrote.
pub(crate) const RECOVERED: &str = "recovered";
/// What a channel calls the topic of the plan, where its own is another.
pub(crate) const TOPIC_IN_PLAN: &str = "topic_in_plan";
