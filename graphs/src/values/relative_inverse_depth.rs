//! Maps of networks whose scale and shift are unknown.

use super::Raster;

/// Inverse depth up to a scale and a shift that differ between frames. Larger is nearer; 1 / value is not a depth.
///
/// Only a node that aligns it accepts it, because no other port has this type.
/// [`RelativeDepth`](super::RelativeDepth) has metres, and is scored and fused as a depth.
#[derive(Clone, Debug, PartialEq)]
pub struct RelativeInverseDepth {
    /// Without a unit, row-major; NaN = invalid.
    pub values: Raster<f32>,
}
