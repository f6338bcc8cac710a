//! Metrics of estimates against ground truth: `score/*`.

mod clues;
mod depth;
mod disparity;
mod doc;

pub(crate) use depth::ScoreDepth;
pub(crate) use disparity::ScoreDisparity;
