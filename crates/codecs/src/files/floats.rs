//! Maps as floats in their own unit.

use depthloom_graphs::Value;
use depthloom_graphs::values::Raster;

/// The pixels of a map: pixels of a disparity, metres of a depth, the share of a weight; NaN = invalid. `None` if it
/// is not such a map.
pub(super) fn floats(value: &Value) -> Option<Raster<f32>> {
    match value {
        Value::Disparity(_) | Value::FloatDisparity(_) => value.disparity_px(),
        Value::TrueDisparity(truth) => Some(truth.px.clone()),
        Value::Depth(depth) => Some(depth.metres.clone()),
        Value::RelativeDepth(map) => Some(map.depth().metres.clone()),
        Value::RelativeInverseDepth(map) => Some(map.values.clone()),
        Value::Weight(weight) => Some(weight.share.clone()),
        Value::Image(_)
        | Value::Mask(_)
        | Value::Calibration(_)
        | Value::Scores(_)
        | Value::Samples(_)
        | Value::Model(_)
        | Value::Reliability(_)
        | Value::Curve(_)
        | Value::Number(_) => None,
    }
}
