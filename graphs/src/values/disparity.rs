//! Disparity maps, as OpenCV's fixed point.

use super::Raster;

/// A disparity map in fixed point: i16, 1/16 px, of the left image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Disparity {
    /// Sixteenths of a pixel, row-major; `(min_disparity - 1) * 16` where invalid.
    pub sixteenths_px: Raster<i16>,
    /// The smallest disparity searched, whole pixels.
    pub min_disparity_px: i32,
}

impl Disparity {
    /// The value of invalid pixels.
    pub const fn invalid(&self) -> i32 {
        (self.min_disparity_px - 1) * 16
    }
}
