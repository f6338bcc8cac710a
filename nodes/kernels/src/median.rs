//! Median filters of depth maps.

use std::ops::Range;

use crate::raster::{check, check_rows, replicate};

/// Median over 3x3 pixels, border replicated: OpenCV's `medianBlur(..., 3)` of a `float32` image, exactly.
///
/// NaN sorts above every number (below, if its sign is set).
///
/// # Panics
/// If a slice does not have the size that `width` and `height` announce.
pub fn median3(input: &[f32], width: usize, height: usize, out: &mut [f32]) {
    median3_rows(input, width, height, 0..height, out);
}

/// [`median3`] of the given rows only; `out` holds just these.
///
/// # Panics
/// If a slice does not have the size that `width`, `height` and `rows` announce.
pub fn median3_rows(input: &[f32], width: usize, height: usize, rows: Range<usize>, out: &mut [f32]) {
    median_rows::<3>(input, width, height, rows, out);
}

/// Median over 5x5 pixels, border replicated: OpenCV's `medianBlur(..., 5)` of a `float32` image, exactly.
///
/// NaN sorts above every number (below, if its sign is set).
///
/// # Panics
/// If a slice does not have the size that `width` and `height` announce.
pub fn median5(input: &[f32], width: usize, height: usize, out: &mut [f32]) {
    median5_rows(input, width, height, 0..height, out);
}

/// [`median5`] of the given rows only; `out` holds just these.
///
/// # Panics
/// If a slice does not have the size that `width`, `height` and `rows` announce.
pub fn median5_rows(input: &[f32], width: usize, height: usize, rows: Range<usize>, out: &mut [f32]) {
    median_rows::<5>(input, width, height, rows, out);
}

fn median_rows<const N: usize>(input: &[f32], width: usize, height: usize, rows: Range<usize>, out: &mut [f32]) {
    check("depth", input.len(), width, height, 1);
    check_rows("median", out.len(), width, height, &rows);
    let reach = (N / 2) as isize;
    for (y, out) in rows.zip(out.chunks_exact_mut(width.max(1))) {
        for (x, out) in out.iter_mut().enumerate() {
            let mut window: Vec<f32> = (-reach..=reach)
                .flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)))
                .map(|(dx, dy)| input[replicate(y as isize + dy, height) * width + replicate(x as isize + dx, width)])
                .collect();
            *out = *window.select_nth_unstable_by(N * N / 2, f32::total_cmp).1;
        }
    }
}
