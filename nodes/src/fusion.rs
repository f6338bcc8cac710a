//! Mono and stereo into one: `fusion/*`.

mod confidence;
mod evidence;
mod facil;
mod inverse_variance;
mod learned;
mod median;
mod mixture;
mod reliability;
mod scale;

pub(crate) use confidence::Confidence;
pub(crate) use facil::Facil;
pub(crate) use inverse_variance::InverseVariance;
pub(crate) use learned::Learned;
pub(crate) use median::MedianOf;
pub(crate) use mixture::Mixture;
pub(crate) use reliability::LearnReliability;
pub(crate) use scale::Scale;
