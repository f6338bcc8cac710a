//! Filters of images and maps: convolution, edges, blur and median.

pub mod convolve;
pub mod edges;
pub(crate) mod gaussian;
pub mod guided;
pub mod median;
