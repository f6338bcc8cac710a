//! The calibration of a rectified stereo pair.

/// Intrinsics of the left camera of a rectified pair, and the pair's baseline.
///
/// The matrices are those of ROS' and Foxglove's `CameraCalibration`, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Image width the calibration holds for, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal length along rows, pixels.
    pub focal_px: f64,
    /// Principal point, column, pixels.
    pub cx_px: f64,
    /// Principal point, row, pixels.
    pub cy_px: f64,
    /// Distance between the two cameras' centres, metres.
    pub baseline_m: f64,
}

impl Calibration {
    /// The intrinsic matrix K, 3x3.
    #[must_use]
    pub const fn k(&self) -> [f64; 9] {
        [self.focal_px, 0.0, self.cx_px, 0.0, self.focal_px, self.cy_px, 0.0, 0.0, 1.0]
    }

    /// The projection matrix P of the left camera, 3x4.
    #[must_use]
    pub const fn p(&self) -> [f64; 12] {
        [self.focal_px, 0.0, self.cx_px, 0.0, 0.0, self.focal_px, self.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0]
    }

    /// `f * B`, pixel metres: depth is this over disparity.
    #[must_use]
    pub const fn focal_baseline_px_m(&self) -> f64 {
        self.focal_px * self.baseline_m
    }
}
