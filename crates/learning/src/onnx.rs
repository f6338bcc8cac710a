//! Networks as ONNX files: writing them, and reading weights out of them and of `.safetensors` files.

pub(crate) mod weights;

mod graph;
mod metadata;

pub(crate) use graph::{GraphBuilder, Tensor, Weights};
pub(crate) use metadata::{Meaning, Metadata};
