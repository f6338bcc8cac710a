//! Depth in metres: `depth/*`.

mod from_disparity;

pub use from_disparity::{FromDisparity, FromDisparityParams};
