//! Networks in ONNX files: what a file declares, the engine that runs it, an image as it wants it, its answer as a map.
//!
//! A node hands an image to [`tensor`], runs it in a [`Network`] and reads the [`Maps`]; which engine that is, [`find`] chooses once a process.

mod choice;
mod engine;
mod flip;
mod input;
mod library;
mod model;
mod network;
mod params;
mod provider;
mod runtime;
mod session;
#[cfg(feature = "tract")]
mod tract;

pub use choice::{VARIABLE, find, in_use, looked_at};
pub use engine::Engine;
pub use flip::Flip;
pub use input::{InputSize, mirrored, tensor};
pub use network::{Maps, Network};
pub use params::{Channels, OnnxParams, Output, Resize, TensorLayout};
pub use provider::Provider;
