//! Filters of disparity maps: `disparity/*`.

mod files;
mod fill;
mod left_right;
mod map;
mod speckle;
mod weighted_least_squares;

pub(crate) use files::DisparityFiles;
pub(crate) use fill::Fill;
pub(crate) use left_right::LeftRight;
pub(crate) use map::invalid;
pub(crate) use speckle::Speckle;
pub(crate) use weighted_least_squares::WeightedLeastSquares;
