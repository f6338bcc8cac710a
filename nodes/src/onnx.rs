//! Networks in ONNX files: what a file declares, the engine that runs it, an image as it wants it, its answer as a map.
//!
//! A node describes how the network sees an image ([`Look`]), runs it in a `Network` or a `Pool` and reads the `Maps`; which engine that is, [`find`] chooses once a process.

mod binding;
mod choice;
mod engine;
mod fit;
mod flip;
mod input;
mod library;
mod look;
mod model;
mod network;
mod params;
mod pool;
mod provider;
mod runtime;
mod session;
mod shapes;
mod stanza;
#[cfg(feature = "tract")]
mod tract;

pub use choice::{VARIABLE, find, in_use, looked_at};
pub use engine::Engine;
pub use model::{Description, Tensor};
pub use provider::Provider;

/// Reads what an ONNX file declares, as `mono/onnx` does before it hands the file to an engine: for tests of strangers' bytes.
///
/// # Errors
/// Why it is no ONNX file.
#[doc(hidden)]
pub fn read_declaration(model: &[u8]) -> Result<(), String> {
    model::Declared::read(model).map(|_| ())
}

/// Multiplications with an addition in one run of a model, its inputs of these shapes: as tract counts them.
///
/// # Errors
/// If tract cannot follow the model, or is not part of this program.
pub fn multiply_adds(model: &[u8], shapes: &[Vec<usize>]) -> Result<u64, String> {
    #[cfg(feature = "tract")]
    return tract::multiply_adds(model, shapes);
    #[cfg(not(feature = "tract"))]
    {
        _ = (model, shapes);
        Err("this program was built without tract, which counts them".to_owned())
    }
}

pub(crate) use fit::{Fit, Fitted, PadAt, PadWith, Sizes};
pub(crate) use flip::Flip;
pub(crate) use look::Look;
pub(crate) use network::Network;
pub(crate) use params::{Channels, OnnxParams, Output, Resize, TensorLayout, check_look, check_resize};
pub(crate) use pool::{Loaded, Pool, Pools, declared};
pub(crate) use shapes::{Axes, Maps, batch, map_of, map_output, numberless, outlet, planes, sizes};
pub use stanza::{closed_shape, shape_text, stanza};
