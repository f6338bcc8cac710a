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

mod plan;

pub use plan::{
    RecordedEstimate, RecordedInput, RecordedNode, RecordedOutput, RecordedPlan, RecordedRun, RecordedSource,
    RecordedSourcePart,
};
