//! Depth maps.

use super::Raster;

/// A depth map: f32 metres along the optical axis, NaN where there is no answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Depth {
    /// Metres, row-major; NaN = no answer.
    pub metres: Raster<f32>,
}
