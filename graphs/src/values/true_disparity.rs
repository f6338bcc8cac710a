//! Measured disparities, as KITTI's files hold them.

use super::Raster;

/// True disparities of the left image, in the fixed point of KITTI's files: u16, 1/256 px, 0 = unknown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrueDisparity {
    /// 256ths of a pixel, row-major; 0 = unknown.
    pub px_256: Raster<u16>,
}
