//! Mono and stereo into one: `fusion/*`.

mod confidence;
mod scale;

pub(crate) use confidence::Confidence;
pub(crate) use scale::Scale;
