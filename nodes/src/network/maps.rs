//! Values as maps of f32, and back.

use depthloom_graphs::values::{Depth, Disparity, Image, Mask, Weight};
use depthloom_graphs::{Fault, Inputs, Value};
use depthloom_kernels::memory::TooMuch;

use super::params::{Form, InputType, NetworkInput, NetworkOutput, NetworkPorts, OutputType};
use crate::onnx::{Fitted, PadWith};
use crate::shape::{filled, same_size};

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

/// The inner error means that there is not enough memory.
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
            let map = inputs.value(name).and_then(Value::disparity_px);
            let mut map = map.ok_or_else(|| Fault::new(format!("no disparity at input `{name}`")))?.into_raw();
            let to_network = 1.0 / fitted.columns_back(1.0);
            map.iter_mut().for_each(|px| *px = (f64::from(*px) * to_network) as f32);
            map
        }
        InputType::Image => return Err(Fault::new(format!("port `{name}` is an image, not a map"))),
    };
    let (scale, offset, missing) = (input.scale as f32, input.offset as f32, input.missing as f32);
    for value in &mut plane {
        let plain = if input.form == Form::Inverse { 1.0 / *value } else { *value };
        *value = if plain.is_finite() { plain * scale + offset } else { missing };
    }
    Ok(fitted.map_there(&plane, with))
}

pub(super) fn value(
    mut map: Vec<f32>,
    output: &NetworkOutput,
    fitted: &Fitted,
    cap: Option<f64>,
    size: (u32, u32),
) -> Value {
    let (scale, offset) = (output.scale as f32, output.offset as f32);
    map.iter_mut().for_each(|value| *value = *value * scale + offset);
    let inverse = (output.value_type == OutputType::Depth && output.form == Form::Inverse).then(|| map.clone());
    if output.form == Form::Inverse {
        map.iter_mut().for_each(|value| *value = 1.0 / *value);
    }
    match output.value_type {
        OutputType::Depth => {
            let cap = cap.map_or(f32::INFINITY, |cap| cap as f32);
            let metres = |value: &f32| if *value > 0.0 && value.is_finite() { value.min(cap) } else { f32::NAN };
            let depth = Depth { metres: mapped(&map, size, metres) };
            match inverse {
                Some(inverse) => Value::depth_from_inverse(depth, &inverse),
                None => depth.into(),
            }
        }
        OutputType::Weight => {
            let share = |value: &f32| if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) };
            Weight { share: mapped(&map, size, share) }.into()
        }
        OutputType::Mask => Mask { set: mapped(&map, size, |value| if *value > 0.5 { 255 } else { 0 }) }.into(),
        OutputType::Disparity => {
            let to_image = fitted.columns_back(1.0) as f32;
            let px = |value: &f32| if *value >= 0.0 { value * to_image } else { f32::NAN };
            Value::disparity_from_px(mapped(&map, size, px))
        }
    }
}

fn mapped<T: image::Primitive>(
    map: &[f32],
    size: (u32, u32),
    value: impl Fn(&f32) -> T,
) -> depthloom_graphs::values::Raster<T> {
    filled(size, |out: &mut [T]| out.iter_mut().zip(map).for_each(|(out, map)| *out = value(map)))
}
