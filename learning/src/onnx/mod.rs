//! Networks as ONNX files: writing them, and reading weights out of them and of `.safetensors` files.

pub mod proto;
pub mod weights;

mod graph;
mod metadata;

pub use graph::{Batch, GraphBuilder, OPSET, Tensor, Weights};
pub use metadata::{Meaning, Metadata, names};
