//! Self-supervised learning of still-mono networks.

pub mod onnx;
pub mod samples;
