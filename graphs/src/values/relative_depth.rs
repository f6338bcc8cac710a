//! Depth maps of networks that estimate inverse depth up to scale and shift.

use std::sync::Arc;

use super::{Depth, Raster};

/// Depth in metres with the inverse depth that metres cannot represent: zero, negative values, and values beyond a
/// cap.
///
/// An alignment with scale and shift uses the inverse depth, everything else the metres. Made by
/// [`Value::depth_from_inverse`](super::Value::depth_from_inverse).
#[derive(Clone, Debug)]
pub struct RelativeDepth {
    pub(super) depth: Arc<Depth>,
    pub(super) inverse: Raster<f32>,
}

impl RelativeDepth {
    /// Metres.
    pub const fn depth(&self) -> &Arc<Depth> {
        &self.depth
    }

    /// Inverse depth, 1/m, where it is not the inverse of the metres; NaN elsewhere.
    pub const fn inverse(&self) -> &Raster<f32> {
        &self.inverse
    }
}

impl PartialEq for RelativeDepth {
    /// Bit for bit, so that a map equals itself.
    fn eq(&self, other: &Self) -> bool {
        let bits = |map: &Raster<f32>| map.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        bits(&self.depth.metres) == bits(&other.depth.metres) && bits(&self.inverse) == bits(&other.inverse)
    }
}
