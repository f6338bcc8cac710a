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
        let columns = Axis::new(width, out_width, scale_x);
        let rows = Axis::new(height, out_height, scale_y);
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

/// What the output pixels take along one axis.
pub(super) struct Axis {
    /// Of each output pixel, the first input pixel it takes and how many.
    spans: Vec<(usize, usize)>,
    /// The shares of these input pixels, one output pixel after the other.
    shares: Vec<f32>,
}

impl Axis {
    /// With OpenCV's rounding and its tolerance of 1e-3 for slivers.
    pub(super) fn new(input: usize, output: usize, scale: f64) -> Self {
        let (mut spans, mut shares) = (Vec::with_capacity(output), Vec::with_capacity(2 * input));
        for index in 0..output {
            let begin = index as f64 * scale;
            let end = begin + scale;
            let extent = scale.min(input as f64 - begin);
            let last = (end.floor() as usize).min(input - 1);
            let first = (begin.ceil() as usize).min(last);
            let before = shares.len();
            let partial = first as f64 - begin > 1e-3;
            if partial {
                shares.push(((first as f64 - begin) / extent) as f32);
            }
            shares.extend((first..last).map(|_| (1.0 / extent) as f32));
            if end - last as f64 > 1e-3 {
                shares.push(((end - last as f64).min(1.0).min(extent) / extent) as f32);
            }
            spans.push((first - usize::from(partial), shares.len() - before));
        }
        Self { spans, shares }
    }

    /// First input pixel and shares of each output pixel.
    #[inline(always)]
    pub(super) fn cells(&self) -> impl Iterator<Item = (usize, &[f32])> {
        let mut rest = &self.shares[..];
        self.spans.iter().map(move |&(first, count)| {
            let (shares, others) = rest.split_at(count);
            rest = others;
            (first, shares)
        })
    }
}

/// Every output pixel is a weighted mean of input pixels, along the rows first.
struct Cells<'a> {
    input: &'a [u8],
    width: usize,
    out_width: usize,
    columns: &'a Axis,
    rows: &'a Axis,
    out: &'a mut [u8],
}

impl Pass for Cells<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { input, width, out_width, columns, rows, out } = self;
        // A sample more than the pixels have: see `shrink_row`.
        let mut wide = vec![0f32; 3 * width + 1];
        let mut along = vec![0f32; 3 * out_width + 1];
        let mut sum = vec![0f32; 3 * out_width];
        for (out, (first, shares)) in out.chunks_exact_mut(3 * out_width).zip(rows.cells()) {
            sum.fill(0.0);
            for (row, &share) in input[3 * width * first..].chunks_exact(3 * width).zip(shares) {
                for (wide, &sample) in wide.iter_mut().zip(row) {
                    *wide = f32::from(sample);
                }
                shrink_row(&wide, columns, &mut along);
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
///
/// A pixel is read, calculated with and written as four samples, one vector; the fourth is the next pixel's, which is
/// written after it.
#[inline(always)]
fn shrink_row(row: &[f32], columns: &Axis, out: &mut [f32]) {
    for (x, (first, shares)) in columns.cells().enumerate() {
        let mut sum = [0f32; 4];
        let pixels = &row[3 * first..][..3 * shares.len() + 1];
        for (k, &share) in shares.iter().enumerate() {
            let pixel: &[f32; 4] = pixels[3 * k..].first_chunk().expect("three samples and the one after");
            for lane in 0..4 {
                sum[lane] += pixel[lane] * share;
            }
        }
        *out[3 * x..].first_chunk_mut().expect("three samples and the one after") = sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;
    use proptest::prelude::*;

    fn pattern(pixels: usize) -> Vec<u8> {
        (0..3 * pixels).map(|k| (k * k * 31 + k * 7) as u8).collect()
    }

    fn resized(input: &[u8], size: (usize, usize), out_size: (usize, usize)) -> Vec<u8> {
        every_level(|level| {
            let mut out = vec![7; 3 * out_size.0 * out_size.1];
            area_rgb8_at(level, input, size, out_size, &mut out);
            out
        })
    }

    // The expected numbers are those of OpenCV 5.0's resize(..., INTER_AREA).

    #[test]
    fn fractional_cells_are_weighted_means() {
        let image = pattern(15);
        assert_eq!(resized(&image, (5, 3), (2, 2)), [93, 44, 142, 105, 127, 159, 203, 131, 172, 131, 130, 174]);
        assert_eq!(resized(&image, (5, 3), (4, 1)), [128, 75, 153, 168, 100, 161, 119, 120, 200, 117, 137, 133]);
        assert_eq!(resized(&image, (5, 3), (5, 3)), image);
    }

    #[test]
    fn complete_cells_are_means() {
        let image = pattern(16);
        assert_eq!(resized(&image, (4, 4), (2, 2)), [102, 93, 82, 146, 61, 230, 102, 173, 178, 178, 109, 166]);
        assert_eq!(resized(&image, (4, 4), (1, 2)), [124, 77, 156, 140, 141, 172]);
    }

    #[test]
    fn growing_along_either_axis_interpolates() {
        let wider = resized(&pattern(15), (5, 3), (7, 3));
        assert_eq!(wider[..12], [0, 38, 138, 26, 22, 80, 62, 16, 83, 134, 32, 248]);
        let taller = resized(&pattern(15), (5, 3), (3, 5));
        assert_eq!(taller[..12], [18, 28, 100, 116, 28, 207, 123, 165, 116, 70, 49, 123]);
    }

    proptest! {
        #[test]
        fn a_uniform_image_stays_uniform_at_every_size_and_level(
            value in any::<u8>(),
            size in (1usize..60, 1usize..20),
            out_size in (1usize..60, 1usize..20),
        ) {
            let image = vec![value; 3 * size.0 * size.1];
            prop_assert!(resized(&image, size, out_size).iter().all(|&sample| sample == value));
        }
    }
}
