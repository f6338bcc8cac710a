//! Depth from a single image: `mono/*`.

mod ground_plane;
mod onnx;

pub use ground_plane::{GroundPlane, GroundPlaneParams};
pub use onnx::Onnx;
