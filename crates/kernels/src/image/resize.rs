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

/// How many input pixels make an output pixel along one axis, rounded as OpenCV rounds it.
fn scale(input: usize, output: usize) -> f64 {
    1.0 / (output as f64 / input as f64)
}
