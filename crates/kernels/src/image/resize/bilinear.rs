//! Bilinear resizing of a map of floats.

use super::{is_done, scale};
use crate::simd::{Level, Pass};

/// Resizes a map of floats with half-pixel centres: OpenCV's `resize(..., INTER_LINEAR)`.
///
/// Beyond the outermost centres the outermost sample repeats. Positions are exact (`f64`), as in OpenCV's x86 packages,
/// which leave this to Intel's IPP; OpenCV's own code rounds positions to `f32`, a few 1e-8 of the image's width.
///
/// # Panics
/// If a slice does not have the announced size, or one map is empty and the other is not.
pub fn bilinear_f32(input: &[f32], width: usize, height: usize, out_width: usize, out_height: usize, out: &mut [f32]) {
    bilinear_f32_at(Level::best(), input, (width, height), (out_width, out_height), out);
}

pub(crate) fn bilinear_f32_at(
    level: Level,
    input: &[f32],
    (width, height): (usize, usize),
    (out_width, out_height): (usize, usize),
    out: &mut [f32],
) {
    if is_done(input, (width, height), (out_width, out_height), out) {
        return;
    }
    let columns = pairs(width, out_width);
    let rows = pairs(height, out_height);
    level.run(Bilinear { input, width, columns: &columns, rows: &rows, out });
}

struct Pair {
    first: usize,
    second: usize,
    weights: [f32; 2],
}

fn pairs(input: usize, output: usize) -> Vec<Pair> {
    let scale = scale(input, output);
    let pair = |index: usize| {
        let position = (index as f64 + 0.5) * scale - 0.5;
        let floor = position.floor();
        let offset = (position - floor) as f32;
        let clamped = |index: f64| index.clamp(0.0, (input - 1) as f64) as usize;
        let (first, second) = (clamped(floor), clamped(floor + 1.0));
        let weights = if first == second { [1.0, 0.0] } else { [1.0 - offset, offset] };
        Pair { first, second, weights }
    };
    (0..output).map(pair).collect()
}

struct Bilinear<'a> {
    input: &'a [f32],
    width: usize,
    columns: &'a [Pair],
    rows: &'a [Pair],
    out: &'a mut [f32],
}

impl Pass for Bilinear<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { input, width, columns, rows, out } = self;
        // The two rows last widened, by the index of the row they came from.
        let mut upper = (usize::MAX, vec![0f32; columns.len()]);
        let mut lower = (usize::MAX, vec![0f32; columns.len()]);
        for (out, row) in out.chunks_exact_mut(columns.len()).zip(rows) {
            if upper.0 != row.first && lower.0 == row.first {
                std::mem::swap(&mut upper, &mut lower);
            }
            for ((from, widened), y) in [(&mut upper, row.first), (&mut lower, row.second)] {
                if *from != y {
                    *from = y;
                    widen(&input[y * width..][..width], columns, widened);
                }
            }
            let [upper_weight, lower_weight] = row.weights;
            for ((out, &upper), &lower) in out.iter_mut().zip(&upper.1).zip(&lower.1) {
                *out = upper * upper_weight + lower * lower_weight;
            }
        }
    }
}

#[inline(always)]
fn widen(row: &[f32], columns: &[Pair], out: &mut [f32]) {
    for (out, Pair { first, second, weights: [a, b] }) in out.iter_mut().zip(columns) {
        *out = row[*first] * a + row[*second] * b;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;
    use proptest::prelude::*;

    fn resized(input: &[f32], size: (usize, usize), out_size: (usize, usize)) -> Vec<f32> {
        every_level(|level| {
            let mut out = vec![-7.0; out_size.0 * out_size.1];
            bilinear_f32_at(level, input, size, out_size, &mut out);
            out
        })
    }

    #[test]
    fn values_are_opencvs() {
        // cv2.resize(..., interpolation=cv2.INTER_LINEAR), exact in binary.
        let map = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
        assert_eq!(resized(&map, (3, 2), (2, 4)), [1.25, 3.5, 3.4375, 9.625, 7.8125, 21.875, 10.0, 28.0]);
        assert_eq!(resized(&map, (3, 2), (1, 1)), [9.0]);
        let squares: Vec<f32> = (0..16u8).map(|i| f32::from(i) * f32::from(i)).collect();
        assert_eq!(resized(&squares, (4, 4), (2, 2)), [10.5, 24.5, 114.5, 160.5]);
    }

    proptest! {
        #[test]
        fn a_slope_stays_a_slope_between_the_outermost_centres(
            (width, height) in (2usize..50, 2usize..20),
            (out_width, out_height) in (1usize..90, 1usize..40),
        ) {
            let at = |x: f64, y: f64| 3.0 * x - 2.0 * y;
            let slope: Vec<f32> = (0..height)
                .flat_map(|y| (0..width).map(move |x| at(x as f64, y as f64) as f32))
                .collect();
            let out = resized(&slope, (width, height), (out_width, out_height));
            for (index, &value) in out.iter().enumerate() {
                let centre = |index: usize, input: usize, output: usize| {
                    ((index as f64 + 0.5) * input as f64 / output as f64 - 0.5).clamp(0.0, (input - 1) as f64)
                };
                let (x, y) = (centre(index % out_width, width, out_width), centre(index / out_width, height, out_height));
                prop_assert!((f64::from(value) - at(x, y)).abs() < 2e-4);
            }
        }
    }
}
