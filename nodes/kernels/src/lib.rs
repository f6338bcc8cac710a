//! Pixel kernels: slices in, slices out.

pub mod sgbm;
pub mod tiles;
