//! Depth from a single image: `mono/*`.

mod ground_plane;
mod network;
mod network_input;
mod onnx;

pub use ground_plane::{GroundPlane, GroundPlaneParams};
pub use onnx::{Channels, Layout, Onnx, OnnxParams, Output, Resize};
