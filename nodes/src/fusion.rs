//! Mono and stereo into one: `fusion/*`.

mod confidence;
mod learned;
mod mixture;
mod scale;

pub(crate) use confidence::Confidence;
pub(crate) use learned::Learned;
pub(crate) use mixture::Mixture;
pub(crate) use scale::Scale;
