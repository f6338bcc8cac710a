//! The folder of runs: finds runs, resolves their names, and summarises them.
//!
//! Nothing is cached: a run is opened by its recording's summary in milliseconds, so a list of hundreds needs no index,
//! which could be out of date.

#![forbid(unsafe_code)]

mod condition;
pub mod environment;
mod failures;
mod files;
mod found;
mod git;
mod glance;
pub mod models;
mod named;
mod notes;
mod opening;
mod plain;
pub mod reuse;
pub mod run_folder;
mod timings;

pub use condition::{Condition, condition_paths};
pub use failures::{FrameFailure, Frames, frames_and_failures};
pub use files::{
    FOLDER, LIVE, MARKER, MODELS, NOTES, OUTDATED, RECORDING, SHARDS, TIMINGS, next_outdated, outdated_files,
};
pub use found::{FoundRun, all, in_folder, shards};
pub use git::GitState;
pub use glance::{Best, File, Glance, State, bytes_in, files_in};
pub use named::{named, named_in_full};
pub use notes::{Notes, mark, parse_note, parse_tag};
pub use opening::{
    end, failed, is_recording, open, open_frames, partial_with, read_failed, recording_in, remedy_of_partial,
    run_failed,
};
pub use plain::file_name;
pub use timings::write_timings;
