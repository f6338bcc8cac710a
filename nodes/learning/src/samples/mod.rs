//! What a network is taught: images and targets at its own size.

mod format;
mod node;
mod set;
mod spool;
mod target;

pub use format::DecodeError;
pub use node::{CollectSamples, SamplesParams};
pub use set::{MEDIA_TYPE, Sample, Samples};
