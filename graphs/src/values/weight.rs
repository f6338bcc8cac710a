//! Weight maps.

use super::Raster;

/// A weight (confidence) map: f32 in [0, 1].
#[derive(Clone, Debug, PartialEq)]
pub struct Weight {
    /// Shares in [0, 1], row-major.
    pub share: Raster<f32>,
}
