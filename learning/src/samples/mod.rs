//! What a network is taught: images and targets at its own size.

mod format;
mod node;
mod set;
mod spool;
mod target;
mod view;

pub use format::DecodeError;
pub use node::{CollectSamples, SamplesParams};
pub use set::{Sample, Samples};
pub(crate) use view::size_and_right;
pub use view::{SampleView, SamplesView};
