//! Values as maps of f32, and back.

use depthloom_graphs::values::{Depth, Disparity, Image, Mask, Weight};
use depthloom_graphs::{Fault, Inputs, Value};
use depthloom_kernels::memory::TooMuch;

use super::params::{Form, InputType, NetworkInput, NetworkOutput, NetworkPorts, OutputType};
use crate::onnx::{Fitted, PadWith};
use crate::shape::{filled, same_size};

/// The size that all inputs have.
///
/// # Errors
/// If they differ.
pub(super) fn common_size(inputs: &Inputs<'_>, ports: &NetworkPorts) -> Result<(u32, u32), Fault> {
    let mut first: Option<(&str, (u32, u32))> = None;
    for (name, input) in &ports.inputs {
        let size = match input.value_type {
            InputType::Image => inputs.get::<Image>(name)?.dimensions(),
            InputType::Depth => inputs.get::<Depth>(name)?.metres.dimensions(),
            InputType::Disparity => inputs.get::<Disparity>(name)?.sixteenths_px.dimensions(),
            InputType::Weight => inputs.get::<Weight>(name)?.share.dimensions(),
            InputType::Mask => inputs.get::<Mask>(name)?.set.dimensions(),
        };
        match first {
            None => first = Some((name, size)),
            Some(first) => same_size(first, (name, size))?,
        }
    }
    first.map(|(_, size)| size).ok_or_else(|| Fault::new("the network has no input port"))
}

/// The plane of a map, as the network sees it.
///
/// # Errors
/// If there is no such value. Within: if there is not the memory.
pub(super) fn plane(
    inputs: &Inputs<'_>,
    name: &str,
    input: &NetworkInput,
    fitted: &Fitted,
    with: PadWith,
) -> Result<Result<Vec<f32>, TooMuch>, Fault> {
    let mut plane: Vec<f32> = match input.value_type {
        InputType::Depth => inputs.get::<Depth>(name)?.metres.to_vec(),
        InputType::Weight => inputs.get::<Weight>(name)?.share.to_vec(),
        InputType::Mask => inputs.get::<Mask>(name)?.set.iter().map(|&set| f32::from(u8::from(set != 0))).collect(),
        InputType::Disparity => {
            let disparity = inputs.get::<Disparity>(name)?;
            let (none, to_network) = (disparity.invalid(), 1.0 / fitted.columns_back(1.0));
            let px = |&fixed: &i16| match i32::from(fixed) <= none {
                true => f32::NAN,
                false => (f64::from(fixed) / 16.0 * to_network) as f32,
            };
            disparity.sixteenths_px.iter().map(px).collect()
        }
        InputType::Image => return Err(Fault::new(format!("port `{name}` is an image, not a map"))),
    };
    let (scale, offset, missing) = (input.scale as f32, input.offset as f32, input.missing as f32);
    for value in &mut plane {
        let told = if input.form == Form::Inverse { 1.0 / *value } else { *value };
        *value = if told.is_finite() { told * scale + offset } else { missing };
    }
    Ok(fitted.map_there(&plane, with))
}

/// The value of an output port, of a map of the image's size.
pub(super) fn value(
    mut map: Vec<f32>,
    output: &NetworkOutput,
    fitted: &Fitted,
    cap: Option<f64>,
    size: (u32, u32),
) -> Value {
    let (scale, offset) = (output.scale as f32, output.offset as f32);
    for value in &mut map {
        let told = *value * scale + offset;
        *value = if output.form == Form::Inverse { 1.0 / told } else { told };
    }
    match output.value_type {
        OutputType::Depth => {
            let cap = cap.map_or(f32::INFINITY, |cap| cap as f32);
            let metres = |value: &f32| if *value > 0.0 && value.is_finite() { value.min(cap) } else { f32::NAN };
            Depth { metres: of(&map, size, metres) }.into()
        }
        OutputType::Weight => {
            let share = |value: &f32| if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) };
            Weight { share: of(&map, size, share) }.into()
        }
        OutputType::Mask => Mask { set: of(&map, size, |value| if *value > 0.5 { 255 } else { 0 }) }.into(),
        OutputType::Disparity => {
            let to_image = fitted.columns_back(1.0) as f32;
            let fixed = |value: &f32| {
                let sixteenths = (value * to_image * 16.0).round_ties_even();
                if (0.0..=f32::from(i16::MAX)).contains(&sixteenths) { sixteenths as i16 } else { -16 }
            };
            Disparity { sixteenths_px: of(&map, size, fixed), min_disparity_px: 0 }.into()
        }
    }
}

fn of<T: image::Primitive>(
    map: &[f32],
    size: (u32, u32),
    value: impl Fn(&f32) -> T,
) -> depthloom_graphs::values::Raster<T> {
    filled(size, |out: &mut [T]| out.iter_mut().zip(map).for_each(|(out, map)| *out = value(map)))
}
