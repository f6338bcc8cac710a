//! Depth from a single image: `mono/*`.

mod ground_plane;
mod onnx;

pub(crate) use ground_plane::GroundPlane;
pub(crate) use onnx::Onnx;
