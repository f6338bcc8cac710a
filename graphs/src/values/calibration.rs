//! The calibration of a rectified stereo pair, or of a single camera.

/// Intrinsics of the left camera of a rectified pair, and the pair's baseline; or of a single camera, with a baseline
/// of 0, as in ROS.
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
    /// Distance between the two cameras' centres, metres; 0 for a single camera.
    pub baseline_m: f64,
    /// How much farther right the right camera's principal point is, pixels: the negative disparity of infinity.
    /// Usually 0; `doffs` of Middlebury.
    pub doffs_px: f64,
}

impl Calibration {
    /// The intrinsic matrix K, 3x3.
    pub const fn k(&self) -> [f64; 9] {
        [self.focal_px, 0.0, self.cx_px, 0.0, self.focal_px, self.cy_px, 0.0, 0.0, 1.0]
    }

    /// The projection matrix P of the left camera, 3x4.
    pub const fn p(&self) -> [f64; 12] {
        [self.focal_px, 0.0, self.cx_px, 0.0, 0.0, self.focal_px, self.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0]
    }

    /// The projection matrix P of the right camera, 3x4: in the left camera's frame.
    pub const fn p_right(&self) -> [f64; 12] {
        let mut p = self.p();
        p[2] = self.cx_px + self.doffs_px;
        p[3] = -self.focal_baseline_px_m();
        p
    }

    /// Whether there is no second camera: no disparity has a depth.
    pub const fn is_single_camera(&self) -> bool {
        self.baseline_m == 0.0
    }

    /// `f * B`, pixel metres.
    pub const fn focal_baseline_px_m(&self) -> f64 {
        self.focal_px * self.baseline_m
    }

    /// The depth of a disparity, metres: `f * B / (d + doffs)`. Infinite or negative for points that are not in front
    /// of the cameras.
    pub const fn depth_m(&self, disparity_px: f64) -> f64 {
        self.focal_baseline_px_m() / (disparity_px + self.doffs_px)
    }

    /// The disparity of a depth, pixels: `f * B / Z - doffs`.
    pub const fn disparity_px(&self, depth_m: f64) -> f64 {
        self.focal_baseline_px_m() / depth_m - self.doffs_px
    }
}

#[cfg(test)]
mod tests {
    use super::Calibration;

    /// A point seen by both cameras through their projections: Middlebury's definitions say the same.
    #[test]
    fn disparity_and_depth_are_those_of_both_projections() {
        let (width, height) = (640, 480);
        let calibration =
            Calibration { width, height, focal_px: 500.0, cx_px: 320.0, cy_px: 240.0, baseline_m: 0.2, doffs_px: 30.0 };
        let column = |p: [f64; 12], [x, y, z]: [f64; 3]| {
            let row = |row: usize| p[4 * row] * x + p[4 * row + 1] * y + p[4 * row + 2] * z + p[4 * row + 3];
            row(0) / row(2)
        };
        let point = [1.0, 0.5, 4.0];
        let disparity = column(calibration.p(), point) - column(calibration.p_right(), point);
        // Left: 500 * 1 / 4 + 320 = 445; right: 500 * 0.8 / 4 + 350 = 450.
        assert_eq!((disparity, calibration.disparity_px(4.0), calibration.depth_m(disparity)), (-5.0, -5.0, 4.0));
        assert_eq!(calibration.depth_m(-30.0), f64::INFINITY);
    }
}
