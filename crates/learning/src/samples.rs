//! Training samples: images and targets at the network's size.

mod format;
mod fusion_node;
mod node;
mod sample;
mod sampler;
#[cfg(test)]
mod set;
mod spool;
mod target;
mod view;

pub(crate) use fusion_node::{CollectFusionSamples, FusionSamplesParams};
pub(crate) use node::{CollectSamples, SamplesParams, depth_scale, small};
pub(crate) use sample::Sample;
#[cfg(test)]
pub(crate) use sample::cell_bytes;
pub(crate) use sampler::{Sampler, Sampling, encode};
#[cfg(test)]
pub(crate) use set::Samples;
pub(crate) use view::size_and_right;
pub(crate) use view::{SampleView, SamplesView};
