//! Training samples: images and targets at the network's size.

mod format;
mod node;
mod sample;
#[cfg(test)]
mod set;
mod spool;
mod target;
mod view;

pub(crate) use node::{CollectSamples, SamplesParams};
#[cfg(test)]
pub(crate) use sample::Sample;
#[cfg(test)]
pub(crate) use set::Samples;
pub(crate) use view::SamplesView;
pub(crate) use view::size_and_right;
