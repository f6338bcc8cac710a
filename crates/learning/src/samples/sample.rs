//! A training sample in memory.

use half::f16;

/// A frame as a training sample.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sample {
    /// The frame's own name, e.g. `000150_10`; frames of joined sources may share one.
    pub(crate) id: String,
    /// The left image, 3 x height x width: the planes of red, green and blue, 0 to 255.
    pub(crate) image: Vec<u8>,
    /// The right image, likewise.
    pub(crate) right: Option<Vec<u8>>,
    /// The target, height x width: disparity as a share of the image's width, above 0; NaN = no target.
    pub(crate) share: Vec<f16>,
    /// `f * B / width`, metres: depth is this over the share. `None` without calibration.
    pub(crate) depth_scale: Option<f64>,
}
