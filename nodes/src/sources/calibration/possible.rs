//! Calibrations that no pair of projections tells: that there can be such cameras, and the principal point that nobody told.

use depthloom_graphs::values::Calibration;

use crate::sources::calibration::rectified_pair::{BASELINE_M, CENTRE_PX, FOCAL_PX, short};

pub(crate) fn check(of: &Calibration) -> Result<(), String> {
    let numbers = [
        ("the focal length", of.focal_px, FOCAL_PX, "px"),
        ("the principal point's column", of.cx_px, CENTRE_PX, "px"),
        ("the principal point's row", of.cy_px, CENTRE_PX, "px"),
        ("the distance of the principal points", of.doffs_px, CENTRE_PX, "px"),
        ("the baseline", of.baseline_m, BASELINE_M, "m"),
    ];
    match numbers.into_iter().find(|(_, number, possible, _)| !possible.contains(number)) {
        Some((what, number, possible, unit)) => {
            let (number, least, most) = (short(number), possible.start(), possible.end());
            Err(format!("{what} is {number} {unit}, and no camera's is beyond {least} to {most} {unit}"))
        }
        None => Ok(()),
    }
}

/// The image's middle; pixel centres have whole coordinates.
pub(crate) fn middle((width, height): (u32, u32)) -> (f64, f64) {
    ((f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0)
}
