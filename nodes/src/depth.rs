//! Depth in metres: `depth/*`.

mod files;
mod from_disparity;
mod guided_upsampling;

pub(crate) use files::DepthFiles;
pub(crate) use from_disparity::FromDisparity;
pub(crate) use guided_upsampling::GuidedUpsampling;
