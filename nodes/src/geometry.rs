//! A calibration as the kernels take it.

use depthloom_graphs::values::Calibration;
use depthloom_kernels::depth::Geometry;

pub(crate) const fn geometry(of: &Calibration) -> Geometry {
    Geometry { focal_px: of.focal_px, baseline_metres: of.baseline_m, doffs_px: of.doffs_px }
}
