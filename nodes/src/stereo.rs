//! Disparity from a rectified pair: `stereo/*`.

mod bm;
mod census_sgm;
mod matcher;
mod onnx;
mod onnx_network;
mod onnx_params;
mod sgbm;

pub(crate) use bm::Bm;
pub(crate) use census_sgm::CensusSgm;
pub(crate) use onnx::StereoOnnx;
pub(crate) use sgbm::Sgbm;
