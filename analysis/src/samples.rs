//! `samples.parquet`: one row per scored pixel, one column per estimate. All queries of errors read this file.
//!
//! The file is compressed with zstd. A row group contains one frame with one scoring, so that a file of any size is
//! written and read in parts: frames in order, stage run by stage run. Its columns:
//!
//! | column | type | what it is |
//! |---|---|---|
//! | `stage`, `scoring`, `frame` | text | the stage, how these pixels were scored, the frame's id |
//! | `position` | u32 | the frame's place in its stage |
//! | `x`, `y` | u32 | the pixel: column from the left, row from the top |
//! | `ground_truth_m` | f32 | metres |
//! | an estimate's label, e.g. `full/fused` | f32 | metres, as scored (aligned and clamped as declared); null: invalid, or not scored in this way |
//! | the topic of a confidence without its stage, e.g. `full/weight.weight` | f32 | from 0 to 1; null: missing |
//!
//! The metadata of the file contain the estimate of each column ([`Described`]), units, and the recording of the
//! samples.

mod described;
mod read;
mod write;

pub(crate) use described::{Described, DescribedEstimate};
pub(crate) use read::{Part, SamplesFile};
pub use write::{SamplesWritten, check_samples, write_samples};

/// The file name in the folder of a run.
pub const SAMPLES: &str = "samples.parquet";
