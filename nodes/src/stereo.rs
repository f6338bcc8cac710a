//! Disparity from a rectified pair: `stereo/*`.

mod bm;
mod census_sgm;
mod onnx;
mod onnx_network;
mod onnx_params;
mod sgbm;

pub(crate) use bm::Bm;
pub(crate) use census_sgm::CensusSgm;
pub(crate) use onnx::StereoOnnx;
pub(crate) use sgbm::Sgbm;

use depthloom_kernels::params::ParamError;

/// A parameter that a kernel refuses, as a kind's check tells it: kinds call their parameters as the kernels do.
#[expect(clippy::needless_pass_by_value, reason = "for `map_err`")]
fn refused(error: ParamError) -> (&'static str, String) {
    (error.name, error.to_string())
}
