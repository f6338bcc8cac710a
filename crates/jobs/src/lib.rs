//! Splits a run into jobs of a cluster: shards of frames or variants, trainings, and the run that joins them.
//!
//! There is no scheduler, no daemon and no network protocol. Every value has a cache key that follows from the
//! experiment and the data, so a last run in the same folder of runs reuses what the shards computed, and writes the
//! recording that one process would have written.

#![forbid(unsafe_code)]

mod folder;
mod shard;

pub use folder::{MissingShard, ShardFolder, damage};
pub use shard::{Fraction, Shard, windows};
