//! Networks in ONNX files: what a file declares, the engine that runs it, images as its inputs, its outputs as maps.

mod binding;
mod choice;
mod engine;
mod fit;
mod flip;
mod input;
mod library;
mod model;
mod network;
mod params;
mod pool;
mod preprocessing;
mod provider;
mod runtime;
mod session;
mod shapes;
mod stanza;
#[cfg(feature = "tract")]
mod tract;

pub use choice::{VARIABLE, find, in_use, search_path};
pub use engine::Engine;
pub use model::{Description, Tensor};
pub use provider::Provider;

/// Reads what an ONNX file declares, as `mono/onnx` does before it hands the file to an engine: for tests of strangers'
/// bytes.
///
/// # Errors
/// Why it is not an ONNX file.
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
pub(crate) use input::colour;
pub(crate) use network::Network;
pub(crate) use params::{Channels, OnnxParams, Output, Resize, TensorLayout, check_preprocessing, check_resize};
pub(crate) use pool::{CachedNetwork, PoolInput, Pools, declared, engine_key};
pub(crate) use preprocessing::Preprocessing;
pub use shapes::shape_text;
pub(crate) use shapes::{Axes, Maps, batch, count_non_finite, map_of, map_output, outlet, planes, sizes};
pub use stanza::{closed_shape, stanza};
