//! Binary masks.

use super::Raster;

/// A binary mask: 255 where set, 0 elsewhere.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// 0 or 255, row-major.
    pub set: Raster<u8>,
}
