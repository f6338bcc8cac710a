//! Estimates against the truth: `score/*`.

mod depth;

pub use depth::{ScoreCrop, ScoreDepth, ScoreDepthParams, ScorePreset, ScoreSet, ScoreSilog, ScoreSqRel};
