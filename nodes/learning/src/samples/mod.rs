//! What a network is taught: images and targets at its own size.

mod format;
mod set;

pub use format::DecodeError;
pub use set::{MEDIA_TYPE, Sample, Samples};
