//! Depth in metres: `depth/*`.

mod from_disparity;
mod guided_upsampling;

pub(crate) use from_disparity::FromDisparity;
pub(crate) use guided_upsampling::GuidedUpsampling;
