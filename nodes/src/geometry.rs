//! A calibration as the kernels take it, and depth from its inverse.

use depthloom_graphs::values::Calibration;
use depthloom_graphs::{Fault, Inputs};
use depthloom_kernels::depth::{Geometry, depth_from_share};

pub(crate) const fn geometry(calibration: &Calibration) -> Geometry {
    Geometry { focal_px: calibration.focal_px, baseline_metres: calibration.baseline_m, doffs_px: calibration.doffs_px }
}

/// The input `calibration` of a node that converts between disparity and depth.
///
/// # Errors
/// It is that of a single camera.
pub(crate) fn pair_calibration<'a>(inputs: &'a Inputs<'_>) -> Result<&'a Calibration, Fault> {
    of_pair(inputs.get::<Calibration>("calibration")?)
}

/// Kinds whose input `calibration` must have a baseline. Others need one depending on their network or parameters.
const WITH_BASELINE: [&str; 5] =
    ["depth/from-disparity", "fusion/inverse-variance", "fusion/learned", "fusion/mixture", "learn/reliability"];

/// Whether nodes of a kind fail on the calibration of a single camera.
#[must_use]
pub fn needs_baseline(kind: &str) -> bool {
    WITH_BASELINE.contains(&kind)
}

/// # Errors
/// The calibration is that of a single camera.
pub(crate) fn of_pair(calibration: &Calibration) -> Result<&Calibration, Fault> {
    match calibration.is_single_camera() {
        true => {
            Err(Fault::new("`calibration` is that of a single camera: a disparity has no depth without a baseline")
                .remedy("set `baseline_m` in the calibration of the source, or use depths"))
        }
        false => Ok(calibration),
    }
}

/// 1/m.
const SMALLEST_INVERSE: f32 = 1e-6;

/// Metres from 1/m, at most `cap`; numbers below 1e-6 count as 1e-6, NaN stays NaN.
pub(crate) fn depth_from_inverse(inverse: &[f32], cap: f32, out: &mut [f32]) {
    // 1 / x is f * B / (x * width) with all of f, B and width one.
    let unit = Geometry { focal_px: 1.0, baseline_metres: 1.0, doffs_px: 0.0 };
    depth_from_share(inverse, 1, unit, SMALLEST_INVERSE, cap, out);
}
