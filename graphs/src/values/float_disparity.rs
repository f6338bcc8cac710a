//! Disparity maps that are finer than OpenCV's fixed point.

use std::sync::Arc;

use super::{Disparity, Raster};

/// A disparity map of the left image in floating point, with the nearest fixed point.
///
/// [`Value::disparity_from_px`](super::Value::disparity_from_px) uses it unless a [`Disparity`] is exact.
#[derive(Clone, Debug)]
pub struct FloatDisparity {
    pub(super) px: Raster<f32>,
    pub(super) fixed: Arc<Disparity>,
}

impl FloatDisparity {
    /// Pixels, row-major; NaN = invalid.
    pub const fn px(&self) -> &Raster<f32> {
        &self.px
    }

    /// The map rounded to sixteenths of a pixel; what 16 bits cannot hold is invalid.
    pub const fn fixed(&self) -> &Arc<Disparity> {
        &self.fixed
    }
}

impl PartialEq for FloatDisparity {
    /// Bit for bit, so that a map equals itself.
    fn eq(&self, other: &Self) -> bool {
        let bits = |map: &Raster<f32>| map.iter().map(|px| px.to_bits()).collect::<Vec<_>>();
        self.px.dimensions() == other.px.dimensions() && bits(&self.px) == bits(&other.px)
    }
}
