//! `samples.parquet`: one row per scored pixel, a column an estimate; what every question about errors is asked of.
//!
//! One file, zstd. A row group is one frame scored in one way, so that a file of any size is written and read a part at
//! a time: frames in order, stage run by stage run. Its columns:
//!
//! | column | type | what it is |
//! |---|---|---|
//! | `stage`, `scoring`, `frame` | text | the stage, how these pixels were scored, the frame's id |
//! | `position` | u32 | the frame's place in its stage |
//! | `x`, `y` | u32 | the pixel: column from the left, row from the top |
//! | `truth_m` | f32 | metres |
//! | an estimate's label, e.g. `full/fused` | f32 | metres, as scored (aligned and clamped as its score says); null: no answer, or not scored so |
//! | a weight's topic without its stage, e.g. `full/weight.weight` | f32 | from 0 to 1; null: none |
//!
//! The file's metadata say which estimate a column is of ([`Described`]), units, and which recording it was made from.

mod described;
mod read;
mod write;

pub(crate) use described::{Described, DescribedEstimate};
pub(crate) use read::{Part, SamplesFile};
pub use write::{SamplesWritten, write_samples};

/// Its name in a run's folder.
pub const SAMPLES: &str = "samples.parquet";
