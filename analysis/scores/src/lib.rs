//! The formulas of depth scores: slices in, a row out; no polars, no I/O.

mod row;

pub use row::{PixelSet, SCORE_NAMES, ScoreRow};
