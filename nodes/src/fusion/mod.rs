//! Mono and stereo into one: `fusion/*`.

mod confidence;
mod scale;

pub use confidence::{Confidence, ConfidenceParams, Weighting};
pub use scale::{Scale, ScaleMethod, ScaleParams};
