//! Self-supervised learning of still-mono networks.

pub mod onnx;
pub mod samples;
pub mod networks;
pub mod ops;
pub mod random;
pub mod ssl;
