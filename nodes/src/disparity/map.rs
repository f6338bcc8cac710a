//! Changes of a disparity map that keep its form.

use depthloom_graphs::values::{Disparity, Raster};
use depthloom_graphs::{Fault, Value};

pub(crate) fn invalid(map: &Disparity) -> Result<i16, Fault> {
    let smallest = map.min_disparity_px;
    i16::try_from(map.invalid())
        .map_err(|_| Fault::new(format!("a smallest disparity of {smallest} px does not fit 16 bits of 1/16 px")))
}

/// Keeps the floating-point form if the input has it.
pub(super) fn pruned(value: Option<&Value>, map: &Disparity, prune: impl FnOnce(&mut [i16])) -> Value {
    let result = changed(map, prune);
    let Some(Value::FloatDisparity(floats)) = value else { return result.into() };
    let invalid = result.invalid();
    let mut px = floats.px().clone();
    let lost = px.iter_mut().zip(result.sixteenths_px.iter()).filter(|(_, fixed)| i32::from(**fixed) == invalid);
    lost.for_each(|(px, _)| *px = f32::NAN);
    Value::disparity_from_px(px)
}

pub(super) fn changed(map: &Disparity, change: impl FnOnce(&mut [i16])) -> Disparity {
    let mut sixteenths_px: Raster<i16> = map.sixteenths_px.clone();
    change(&mut sixteenths_px);
    Disparity { sixteenths_px, min_disparity_px: map.min_disparity_px }
}
