//! Estimates against the truth: `score/*`.

mod depth;

pub(crate) use depth::ScoreDepth;
