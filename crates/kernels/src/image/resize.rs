//! Resizing: by area or bicubic for the image a network sees, bilinear for the map it outputs.

mod area;
mod area_f32;
mod bicubic;
mod bilinear;
mod enlarge;

pub use area::area_rgb8;
pub use area_f32::shrink_f32;
pub use bicubic::bicubic_f32;
pub use bilinear::bilinear_f32;

use crate::raster::check;

/// How many input pixels make an output pixel along one axis, rounded as OpenCV rounds it.
fn scale(input: usize, output: usize) -> f64 {
    1.0 / (output as f64 / input as f64)
}

/// Whether an output without pixels or of the input's size needs nothing computed; the second is a copy of the input.
///
/// # Panics
/// If a slice does not have the announced size, or only the input is empty.
fn is_done(
    input: &[f32],
    (width, height): (usize, usize),
    (out_width, out_height): (usize, usize),
    out: &mut [f32],
) -> bool {
    check("map", input.len(), width, height, 1);
    check("resized map", out.len(), out_width, out_height, 1);
    if out.is_empty() {
        return true;
    }
    assert!(!input.is_empty(), "an empty map cannot be resized to {out_width} x {out_height}");
    let same = (width, height) == (out_width, out_height);
    if same {
        out.copy_from_slice(input);
    }
    same
}
