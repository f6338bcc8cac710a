//! Estimates against the truth: `score/*`.

mod depth;

pub use depth::ScoreDepth;
