//! Depth maps.

use super::Raster;

/// A depth map: f32 metres along the optical axis, NaN where invalid.
#[derive(Clone, Debug, PartialEq)]
pub struct Depth {
    /// Metres, row-major; NaN = invalid.
    pub metres: Raster<f32>,
}
