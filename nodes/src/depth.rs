//! Depth in metres: `depth/*`.

mod from_disparity;

pub(crate) use from_disparity::FromDisparity;
