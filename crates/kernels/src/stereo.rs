//! Stereo: rectified pairs, their matchers, and what is done with disparities. It may use `filter`.

pub mod bm;
pub mod census;
pub mod depth;
pub mod fill;
mod lanes;
pub mod left_right;
pub mod params;
pub mod rectify;
pub mod sgbm;
pub mod weighted_least_squares;
