//! A calibration as the kernels take it.

use depthloom_graphs::values::Calibration;
use depthloom_kernels::depth::Geometry;

pub(crate) const fn geometry(calibration: &Calibration) -> Geometry {
    Geometry { focal_px: calibration.focal_px, baseline_metres: calibration.baseline_m, doffs_px: calibration.doffs_px }
}
