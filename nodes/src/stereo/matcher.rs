//! Shared by all matchers: ports, and the call of a kernel.

use depthloom_graphs::values::{Disparity, Image};
use depthloom_graphs::{Context, Fault, Inputs, Outputs, Port, ValueType};
use depthloom_kernels::memory::TooMuch;
use depthloom_kernels::params::ParamError;

use crate::grey::grey;
use crate::shape::{filled, same_size};
use crate::tiles::HostTiles;

/// Kinds and kernels use the same parameter names.
#[expect(clippy::needless_pass_by_value, reason = "for `map_err`")]
pub(super) fn refused(error: ParamError) -> (&'static str, String) {
    (error.name, error.to_string())
}

pub(super) fn too_large(error: TooMuch, (width, height): (usize, usize)) -> Fault {
    Fault::new(format!("the images are {width}x{height}"))
        .because(error)
        .remedy("reduce `disparities`, or use smaller images")
}

pub(super) fn pair() -> Vec<Port> {
    vec![
        Port::frame("left", ValueType::Image, "The left image of a rectified pair, grey or RGB."),
        Port::frame("right", ValueType::Image, "The right image; same size as `left`."),
    ]
}

pub(super) fn disparity() -> Vec<Port> {
    vec![Port::frame(
        "disparity",
        ValueType::Disparity,
        "Disparity of the left image, 1/16 px fixed point; invalid pixels hold `(min_disparity - 1) * 16`.",
    )]
}

pub(super) fn matched<S: Default + Send + 'static>(
    inputs: &Inputs<'_>,
    ctx: &mut Context<'_>,
    min_disparity_px: i32,
    kernel: impl FnOnce([&[u8]; 2], (usize, usize), &mut S, &HostTiles<'_>, &mut [i16]) -> Result<(), Fault>,
) -> Result<Outputs, Fault> {
    let (left, right) = (inputs.get::<Image>("left")?, inputs.get::<Image>("right")?);
    same_size(("left", left.dimensions()), ("right", right.dimensions()))?;
    let (width, height) = left.dimensions();
    let images = [left, right].map(|image| grey(image).as_raw().as_slice());
    let mut scratch = ctx.scratch.take::<S>();
    let mut result = Ok(());
    let sixteenths_px = filled((width, height), |out| {
        result = kernel(images, (width as usize, height as usize), &mut scratch, &HostTiles(ctx.host), out);
    });
    ctx.scratch.put(scratch);
    result?;
    Ok(Outputs::one("disparity", Disparity { sixteenths_px, min_disparity_px }))
}
