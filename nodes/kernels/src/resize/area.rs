//! Resizing 8-bit colour by area.

use super::{enlarge, scale};
use crate::raster::check;
use crate::simd::{Level, Pass};

/// Resizes an interleaved RGB image by area and rounds to 8 bits: OpenCV's `resize(..., INTER_AREA)`, bit for bit.
///
/// Shrinking averages each output pixel's area, in `f32`, half to even. An image that grows along either axis is
/// interpolated linearly in OpenCV's fixed-point arithmetic, as OpenCV does.
///
/// # Panics
/// If a slice does not have the announced size, or one image is empty and the other is not.
pub fn area_rgb8(input: &[u8], width: usize, height: usize, out_width: usize, out_height: usize, out: &mut [u8]) {
    area_rgb8_at(Level::best(), input, (width, height), (out_width, out_height), out);
}

pub(crate) fn area_rgb8_at(
    level: Level,
    input: &[u8],
    (width, height): (usize, usize),
    (out_width, out_height): (usize, usize),
    out: &mut [u8],
) {
    check("rgb", input.len(), width, height, 3);
    check("resized rgb", out.len(), out_width, out_height, 3);
    if out.is_empty() {
        return;
    }
    assert!(!input.is_empty(), "an empty image cannot be resized to {out_width} x {out_height}");
    let (scale_x, scale_y) = (scale(width, out_width), scale(height, out_height));
    if (width, height) == (out_width, out_height) {
        out.copy_from_slice(input);
    } else if scale_x < 1.0 || scale_y < 1.0 {
        enlarge::linear_rgb8(input, (width, height), (out_width, out_height), out);
    } else if let (Some(columns), Some(rows)) = (whole(scale_x), whole(scale_y)) {
        level.run(WholeCells { input, width, out_width, columns, rows, out });
    } else {
        let columns = cells(width, out_width, scale_x);
        let rows = cells(height, out_height, scale_y);
        level.run(Cells { input, width, out_width, columns: &columns, rows: &rows, out });
    }
}

/// A scale that is a whole number, by OpenCV's measure.
fn whole(scale: f64) -> Option<usize> {
    let rounded = scale.round_ties_even();
    ((scale - rounded).abs() < f64::EPSILON).then_some(rounded as usize)
}

/// Every output pixel is the mean of `columns` x `rows` whole input pixels.
struct WholeCells<'a> {
    input: &'a [u8],
    width: usize,
    out_width: usize,
    columns: usize,
    rows: usize,
    out: &'a mut [u8],
}

impl Pass for WholeCells<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { input, width, out_width, columns, rows, out } = self;
        let share = 1.0 / (columns * rows) as f32;
        let mut down = vec![0u32; 3 * width];
        for (y, out) in out.chunks_exact_mut(3 * out_width).enumerate() {
            down.fill(0);
            for row in input[3 * width * rows * y..].chunks_exact(3 * width).take(rows) {
                for (sum, &sample) in down.iter_mut().zip(row) {
                    *sum += u32::from(sample);
                }
            }
            for (out, cell) in out.as_chunks_mut::<3>().0.iter_mut().zip(down.chunks_exact(3 * columns)) {
                let mut sum = [0; 3];
                for pixel in cell.as_chunks::<3>().0 {
                    for channel in 0..3 {
                        sum[channel] += pixel[channel];
                    }
                }
                *out = if (columns, rows) == (2, 2) {
                    sum.map(|sum| ((sum + 2) >> 2) as u8)
                } else {
                    sum.map(|sum| (sum as f32 * share).round_ties_even() as u8)
                };
            }
        }
    }
}

/// What one output pixel takes along one axis: input pixels `first..`, each with its share.
struct Cell {
    first: usize,
    shares: Vec<f32>,
}

/// The cells of one axis, with OpenCV's rounding and its tolerance of 1e-3 for slivers.
fn cells(input: usize, output: usize, scale: f64) -> Vec<Cell> {
    let cell = |index: usize| {
        let begin = index as f64 * scale;
        let end = begin + scale;
        let extent = scale.min(input as f64 - begin);
        let last = (end.floor() as usize).min(input - 1);
        let first = (begin.ceil() as usize).min(last);
        let mut shares = Vec::with_capacity(last - first + 2);
        let partial = first as f64 - begin > 1e-3;
        if partial {
            shares.push(((first as f64 - begin) / extent) as f32);
        }
        shares.extend((first..last).map(|_| (1.0 / extent) as f32));
        if end - last as f64 > 1e-3 {
            shares.push(((end - last as f64).min(1.0).min(extent) / extent) as f32);
        }
        Cell { first: first - usize::from(partial), shares }
    };
    (0..output).map(cell).collect()
}

/// Every output pixel is a weighted mean of input pixels, along the rows first.
struct Cells<'a> {
    input: &'a [u8],
    width: usize,
    out_width: usize,
    columns: &'a [Cell],
    rows: &'a [Cell],
    out: &'a mut [u8],
}

impl Pass for Cells<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { input, width, out_width, columns, rows, out } = self;
        let mut along = vec![0f32; 3 * out_width];
        let mut sum = vec![0f32; 3 * out_width];
        for (out, cell) in out.chunks_exact_mut(3 * out_width).zip(rows) {
            sum.fill(0.0);
            for (row, &share) in input[3 * width * cell.first..].chunks_exact(3 * width).zip(&cell.shares) {
                shrink_row(row, columns, &mut along);
                for (sum, &value) in sum.iter_mut().zip(&along) {
                    *sum += share * value;
                }
            }
            for (out, &sum) in out.iter_mut().zip(&sum) {
                *out = sum.round_ties_even() as u8;
            }
        }
    }
}

/// The weighted means along one row; each is added up from the left.
#[inline(always)]
fn shrink_row(row: &[u8], columns: &[Cell], out: &mut [f32]) {
    for (out, cell) in out.as_chunks_mut::<3>().0.iter_mut().zip(columns) {
        let mut sum = [0f32; 3];
        for (pixel, &share) in row[3 * cell.first..].as_chunks::<3>().0.iter().zip(&cell.shares) {
            for channel in 0..3 {
                sum[channel] += f32::from(pixel[channel]) * share;
            }
        }
        *out = sum;
    }
}
