//! True disparities from depths, in steps of KITTI's files, and depths from true disparities.

use depthloom_graphs::values::{Calibration, Depth, Raster, TrueDisparity};
use depthloom_kernels::depth::truth_from_disparity;
use image::Luma;

use crate::geometry::geometry;
use crate::shape::filled;

/// `f * B / (d + doffs)`; NaN if the disparity is unknown or the sum is not positive.
pub(crate) fn depth(truth: &TrueDisparity, calibration: &Calibration) -> Depth {
    let px = &truth.px;
    Depth { metres: filled(px.dimensions(), |out| truth_from_disparity(px, geometry(calibration), out)) }
}

/// Rounded to 1/256 px; values that 16 bits cannot hold become unknown.
pub(crate) fn from_depth(depth: &Depth, calibration: &Calibration) -> TrueDisparity {
    let (width, height) = depth.metres.dimensions();
    let px_256 = Raster::from_fn(width, height, |x, y| {
        let metres = f64::from(depth.metres.get_pixel(x, y).0[0]);
        Luma([fixed_point(calibration.disparity_px(metres))])
    });
    TrueDisparity::from_px_256(&px_256)
}

/// 0 is unknown.
fn fixed_point(disparity_px: f64) -> u16 {
    let fixed = (disparity_px * 256.0).round();
    if fixed >= 1.0 && fixed <= f64::from(u16::MAX) { fixed as u16 } else { 0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::fixed_point;

    proptest! {
        #[test]
        fn a_disparity_is_off_by_at_most_half_a_step(disparity_px in 0.002..255.99_f64) {
            let written = f64::from(fixed_point(disparity_px)) / 256.0;
            prop_assert!((written - disparity_px).abs() <= 0.5 / 256.0);
        }
    }

    #[test]
    fn values_beyond_sixteen_bits_are_unknown() {
        assert_eq!(fixed_point(10.0), 2560);
        assert_eq!(fixed_point(f64::NAN), 0);
        assert_eq!(fixed_point(0.0), 0);
        assert_eq!(fixed_point(300.0), 0);
        assert_eq!(fixed_point(1.0 / 512.0), 1);
    }
}
