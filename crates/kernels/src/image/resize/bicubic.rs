//! Bicubic resizing of a map of floats.

use super::{is_done, scale};
use crate::raster::replicate;
use crate::simd::{Level, Pass};

/// OpenCV's constant of the cubic: the slope at a distance of one pixel.
const SLOPE: f32 = -0.75;

/// Resizes a map of floats with half-pixel centres: OpenCV's `resize(..., INTER_CUBIC)`, over 4x4 pixels whatever the
/// scale. Beyond the borders the outermost sample repeats. Results may exceed the range of the map.
///
/// # Panics
/// If a slice does not have the announced size, or one map is empty and the other is not.
pub fn bicubic_f32(input: &[f32], width: usize, height: usize, out_width: usize, out_height: usize, out: &mut [f32]) {
    bicubic_f32_at(Level::best(), input, (width, height), (out_width, out_height), out);
}

pub(crate) fn bicubic_f32_at(
    level: Level,
    input: &[f32],
    (width, height): (usize, usize),
    (out_width, out_height): (usize, usize),
    out: &mut [f32],
) {
    if is_done(input, (width, height), (out_width, out_height), out) {
        return;
    }
    let (columns, rows) = (fours(width, out_width), fours(height, out_height));
    let mut wide = vec![0.0; out_width * height];
    level.run(Widen { input, width, columns: &columns, out: &mut wide });
    level.run(Heighten { input: &wide, width: out_width, rows: &rows, out });
}

/// The four samples of an output pixel along an axis.
struct Four {
    at: [usize; 4],
    weights: [f32; 4],
}

fn fours(input: usize, output: usize) -> Vec<Four> {
    let scale = scale(input, output);
    let four = |index: usize| {
        let position = (index as f64 + 0.5) * scale - 0.5;
        let floor = position.floor();
        let first = floor as isize - 1;
        let at = [0, 1, 2, 3].map(|tap| replicate(first + tap, input));
        Four { at, weights: weights((position - floor) as f32) }
    };
    (0..output).map(four).collect()
}

fn weights(x: f32) -> [f32; 4] {
    let near = |x: f32| ((SLOPE + 2.0) * x - (SLOPE + 3.0)) * x * x + 1.0;
    let first = ((SLOPE * (x + 1.0) - 5.0 * SLOPE) * (x + 1.0) + 8.0 * SLOPE) * (x + 1.0) - 4.0 * SLOPE;
    let (second, third) = (near(x), near(1.0 - x));
    [first, second, third, 1.0 - first - second - third]
}

struct Widen<'a> {
    input: &'a [f32],
    width: usize,
    columns: &'a [Four],
    out: &'a mut [f32],
}

impl Pass for Widen<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { input, width, columns, out } = self;
        for (out, row) in out.chunks_exact_mut(columns.len()).zip(input.chunks_exact(width)) {
            for (out, Four { at: [a, b, c, d], weights }) in out.iter_mut().zip(columns) {
                *out = row[*a] * weights[0] + row[*b] * weights[1] + row[*c] * weights[2] + row[*d] * weights[3];
            }
        }
    }
}

struct Heighten<'a> {
    input: &'a [f32],
    width: usize,
    rows: &'a [Four],
    out: &'a mut [f32],
}

impl Pass for Heighten<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { input, width, rows, out } = self;
        for (out, Four { at, weights }) in out.chunks_exact_mut(width).zip(rows) {
            let [a, b, c, d] = at.map(|row| &input[row * width..][..width]);
            for ((((out, a), b), c), d) in out.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *out = a * weights[0] + b * weights[1] + c * weights[2] + d * weights[3];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;

    fn resized(input: &[f32], size: (usize, usize), out_size: (usize, usize)) -> Vec<f32> {
        every_level(|level| {
            let mut out = vec![-7.0; out_size.0 * out_size.1];
            bicubic_f32_at(level, input, size, out_size, &mut out);
            out
        })
    }

    #[test]
    fn values_are_opencvs() {
        // cv2.resize(..., interpolation=cv2.INTER_CUBIC), OpenCV 5.0.0.
        let map: Vec<f32> = (0..20u8).map(|i| f32::from(i) * f32::from(i % 7)).collect();
        let cases: [((usize, usize), &[f32]); 3] = [
            ((3, 2), &[15.019_1, -3.625, 13.723_38, 26.693_86, 61.125, 58.202_54]),
            (
                (7, 3),
                &[
                    3.313_57, 5.251_12, 4.991_44, 2.384_26, 5.121_7, 11.953_89, 17.304_71, 30.214_38, 40.345_76,
                    41.598_71, 30.46875, 44.150_87, 26.701_98, -3.118_35, 15.931_18, 24.839_24, 39.908_92, 53.333_34,
                    68.692_14, 79.182_57, 81.602_44,
                ],
            ),
            (
                (4, 6),
                &[
                    -2.221_83, -0.035_13, 7.059_37, 15.170_76, 12.847_99, 10.309_1, -3.316_16, 16.994_29, 29.755_68,
                    29.582_36, 12.933_83, 14.470_65, 32.349_43, 47.642_72, 71.203_33, 2.280_62, 24.388_34, 47.199_45,
                    79.600_34, 49.757_66, 15.304, 38.393_7, 61.597_48, 100.145_09,
                ],
            ),
        ];
        for (size, expected) in cases {
            for (found, expected) in resized(&map, (5, 4), size).iter().zip(expected) {
                assert!((found - expected).abs() < 1e-4, "{size:?}: {found} is not {expected}");
            }
        }
    }

    #[test]
    fn a_constant_stays_and_a_pixel_is_everywhere() {
        assert!(resized(&[3.0; 12], (4, 3), (9, 5)).iter().all(|value| (value - 3.0).abs() < 1e-6));
        assert_eq!(resized(&[2.0], (1, 1), (3, 2)), [2.0; 6]);
    }
}
