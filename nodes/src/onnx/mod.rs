//! Networks in ONNX files: what a file declares, the engine that runs it, an image as it wants it, its answer as a map.
//!
//! A node hands an image to `tensor`, runs it in a `Network` and reads the `Maps`; which engine that is, [`find`] chooses once a process.

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
pub use provider::Provider;

/// Reads what an ONNX file declares, as `mono/onnx` does before it hands the file to an engine: for tests of strangers' bytes.
///
/// # Errors
/// Why it is no ONNX file.
#[doc(hidden)]
pub fn read_declaration(model: &[u8]) -> Result<(), String> {
    model::Declared::read(model).map(|_| ())
}

pub(crate) use flip::Flip;
pub(crate) use input::{mirrored, tensor};
pub(crate) use network::Network;
pub(crate) use params::{OnnxParams, Output, Resize};
