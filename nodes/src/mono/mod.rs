//! Depth from a single image: `mono/*`.

mod flip;
mod ground_plane;
mod network;
mod network_input;
mod onnx;

pub use flip::Flip;
pub use ground_plane::{GroundPlane, GroundPlaneParams};
pub use network::{Maps, Network};
pub use network_input::{InputSize, tensor};
pub use onnx::{Channels, Layout, Onnx, OnnxParams, Output, Resize};
