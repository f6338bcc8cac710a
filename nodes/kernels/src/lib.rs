//! Pixel kernels: slices in, slices out.
