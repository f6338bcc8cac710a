//! Splits a run into jobs of a cluster: shards of frames or variants, trainings, and the run that joins them.
//!
//! There is no scheduler, no daemon and no network protocol. Every value has a cache key that follows from the
//! experiment and the data, so a last run in the same folder of runs reuses what the shards computed, and writes the
//! recording that one process would have written. What is submitted, and how far it is, is in files and in Slurm.

#![forbid(unsafe_code)]

mod folder;
mod progress;
mod shard;
pub mod slurm;
mod state;
mod steps;
mod submission;

pub use folder::{MissingShard, ShardFolder, damage};
pub use progress::{JobEnd, JobProgress, ProgressFile, host};
pub use shard::{Fraction, Shard, windows};
pub use state::{JobState, states};
pub use steps::{Split, Step, steps};
pub use submission::{FORMAT, JOBS, JobId, LOGS, Scheduler, SlurmArray, Submission, SubmitLock};
