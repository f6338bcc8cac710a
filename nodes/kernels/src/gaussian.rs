//! Gaussian blur, separable, in `f32`, with OpenCV's kernel and border.
//!
//! The image is blurred in strips [`STRIP`] columns wide: along the rows into a scratch strip that stays in cache, from
//! there down the columns. What is blurred along the rows is a [`Lines`]: an image of floats, or a mask of which only
//! the set pixels cost anything. Each output is a sum in one fixed order, without FMA, on every instruction set.

use std::ops::Range;

use crate::raster::{check, check_rows, reflect101};
use crate::simd::{Level, Pass};

/// Columns blurred together.
const STRIP: usize = 64;

/// One value for each column of a strip.
type Lane = [f32; STRIP];

/// The taps of OpenCV's Gaussian for 32-bit float images: `round(8 sigma + 1) | 1` of them, normalised in `f64`.
///
/// For sigma 10 these are 81 taps, 4 sigma on either side.
///
/// # Panics
/// If `sigma` is not positive and finite.
#[must_use]
pub fn taps(sigma: f64) -> Vec<f32> {
    assert!(sigma > 0.0 && sigma.is_finite(), "sigma must be positive and finite, not {sigma}");
    let count = (sigma * 8.0 + 1.0).round_ties_even() as usize | 1;
    let radius = (count / 2) as f64;
    let scale = -0.5 / (sigma * sigma);
    let raw: Vec<f64> = (0..count).map(|i| i as f64 - radius).map(|x| (scale * x * x).exp()).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|tap| (tap / sum) as f32).collect()
}

/// Blurs an image of floats: OpenCV's `GaussianBlur(input, (0, 0), sigma, borderType=BORDER_REFLECT_101)`, up to the
/// rounding of sums that are added in another order.
///
/// # Panics
/// If a slice does not have the size that `width` and `height` announce, or `sigma` is not positive and finite.
pub fn blur(input: &[f32], width: usize, height: usize, sigma: f64, out: &mut [f32]) {
    blur_at(Level::best(), input, width, height, sigma, out);
}

pub(crate) fn blur_at(level: Level, input: &[f32], width: usize, height: usize, sigma: f64, out: &mut [f32]) {
    check("image", input.len(), width, height, 1);
    check("blurred image", out.len(), width, height, 1);
    let taps = taps(sigma);
    if !out.is_empty() {
        level.run(Blur {
            lines: Floats { input, width, taps: &taps },
            taps: &taps,
            width,
            height,
            rows: 0..height,
            out,
        });
    }
}

/// Blurs a mask, any value but 0 counting as 1, for the given rows; `out` holds just these rows.
///
/// # Panics
/// If a slice does not have the size that `width`, `height` and `rows` announce, or `sigma` is not positive and finite.
pub fn blur_mask_rows(mask: &[u8], width: usize, height: usize, sigma: f64, rows: Range<usize>, out: &mut [f32]) {
    blur_mask_rows_at(Level::best(), mask, width, height, sigma, rows, out);
}

pub(crate) fn blur_mask_rows_at(
    level: Level,
    mask: &[u8],
    width: usize,
    height: usize,
    sigma: f64,
    rows: Range<usize>,
    out: &mut [f32],
) {
    check("mask", mask.len(), width, height, 1);
    check_rows("blurred mask", out.len(), width, height, &rows);
    let taps = taps(sigma);
    if !out.is_empty() {
        let needed = source_rows(&rows, taps.len() / 2, height);
        let lines = SetPixels::new(mask, width, needed, &taps);
        level.run(Blur { lines, taps: &taps, width, height, rows, out });
    }
}

/// The rows of the image that an output of `rows` depends on; the reflected ones lie among them.
fn source_rows(rows: &Range<usize>, radius: usize, height: usize) -> Range<usize> {
    rows.start.saturating_sub(radius)..height.min(rows.end + radius)
}

/// Something that can be blurred along its rows.
trait Lines {
    /// Columns `left..left + STRIP` of row `y`, blurred along the row. Columns outside the image mean nothing.
    fn blurred(&mut self, y: usize, left: usize) -> Lane;
}

struct Blur<'a, L> {
    lines: L,
    taps: &'a [f32],
    width: usize,
    height: usize,
    rows: Range<usize>,
    out: &'a mut [f32],
}

impl<L: Lines> Pass for Blur<'_, L> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let radius = self.taps.len() / 2;
        let source = source_rows(&self.rows, radius, self.height);
        let first = self.rows.start;
        // Rows beyond the image are copied, so that the loop down the columns has no border.
        let wanted = first as isize - radius as isize..(self.rows.end + radius) as isize;
        let mut strip: Vec<Lane> = vec![[0.0; STRIP]; wanted.len()];
        for left in (0..self.width).step_by(STRIP) {
            let top = (source.start as isize - wanted.start) as usize;
            for y in source.clone() {
                strip[y - source.start + top] = self.lines.blurred(y, left);
            }
            for y in wanted.clone().filter(|&y| y < 0 || y >= self.height as isize) {
                let mirrored = reflect101(y, self.height) - source.start + top;
                strip[(y - wanted.start) as usize] = strip[mirrored];
            }
            let columns = STRIP.min(self.width - left);
            for (row, window) in self.out.chunks_exact_mut(self.width).zip(strip.windows(2 * radius + 1)) {
                let blurred = symmetric(window, self.taps);
                row[left..left + columns].copy_from_slice(&blurred[..columns]);
            }
        }
    }
}

/// The weighted sum of an odd number of lanes under symmetric taps, from the centre outwards.
#[inline(always)]
fn symmetric(window: &[Lane], taps: &[f32]) -> Lane {
    let radius = taps.len() / 2;
    let (before, after) = (&window[..radius], &window[radius + 1..]);
    let mut sum = window[radius];
    for value in &mut sum {
        *value *= taps[radius];
    }
    for ((before, after), &tap) in before.iter().rev().zip(after).zip(&taps[radius + 1..]) {
        for lane in 0..STRIP {
            sum[lane] += tap * (before[lane] + after[lane]);
        }
    }
    sum
}

/// An image of floats.
struct Floats<'a> {
    input: &'a [f32],
    width: usize,
    taps: &'a [f32],
}

impl Lines for Floats<'_> {
    #[inline(always)]
    fn blurred(&mut self, y: usize, left: usize) -> Lane {
        let (row, radius) = (&self.input[y * self.width..][..self.width], self.taps.len() / 2);
        let at = |x: isize| row[reflect101(x, self.width)];
        let mut sum = [0.0; STRIP];
        for (lane, sum) in sum.iter_mut().enumerate() {
            let x = (left + lane) as isize;
            *sum = self.taps[radius] * at(x);
            for k in 1..=radius as isize {
                *sum += self.taps[radius + k as usize] * (at(x - k) + at(x + k));
            }
        }
        sum
    }
}

/// The set pixels of a mask, a bit each, with the reflected border of either side.
struct SetPixels {
    /// Rows of `words` words; bit 0 of a row stands for column `-radius`.
    bits: Vec<u64>,
    words: usize,
    rows: Range<usize>,
    radius: usize,
    /// The taps between `STRIP - 1` zeros on either side: a set pixel adds `STRIP` of them, whatever its column.
    padded_taps: Vec<f32>,
}

impl SetPixels {
    fn new(mask: &[u8], width: usize, rows: Range<usize>, taps: &[f32]) -> Self {
        let radius = taps.len() / 2;
        // One strip more than the image has, so that the last strip's window is whole.
        let words = (width + 2 * radius + STRIP).div_ceil(64) + 1;
        let mut bits = vec![0; words * rows.len()];
        for (y, bits) in rows.clone().zip(bits.chunks_exact_mut(words)) {
            let row = &mask[y * width..][..width];
            for x in -(radius as isize)..(width + radius) as isize {
                let bit = (x + radius as isize) as usize;
                bits[bit / 64] |= u64::from(row[reflect101(x, width)] != 0) << (bit % 64);
            }
        }
        let mut padded_taps = vec![0.0; 2 * (STRIP - 1) + taps.len()];
        padded_taps[STRIP - 1..][..taps.len()].copy_from_slice(taps);
        Self { bits, words, rows, radius, padded_taps }
    }
}

impl Lines for SetPixels {
    #[inline(always)]
    fn blurred(&mut self, y: usize, left: usize) -> Lane {
        let row = &self.bits[(y - self.rows.start) * self.words..][..self.words];
        let mut sum = [0.0; STRIP];
        // The window's bits are `left..left + STRIP + 2 radius`, and `left` is a multiple of the word's 64.
        let reach = STRIP + 2 * self.radius;
        for (index, &word) in row[left / 64..].iter().take(reach.div_ceil(64)).enumerate() {
            let mut word = if (index + 1) * 64 > reach { word & ((1 << (reach % 64)) - 1) } else { word };
            while word != 0 {
                let position = index * 64 + word.trailing_zeros() as usize;
                word &= word - 1;
                let taps = &self.padded_taps[reach - 1 - position..][..STRIP];
                for lane in 0..STRIP {
                    sum[lane] += taps[lane];
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;
    use proptest::prelude::*;

    /// The definition, in `f64`.
    fn expected(input: &[f64], width: usize, height: usize, sigma: f64) -> Vec<f64> {
        let taps = taps(sigma);
        let radius = (taps.len() / 2) as isize;
        let mut along = vec![0.0; input.len()];
        let mut out = vec![0.0; input.len()];
        for y in 0..height {
            for x in 0..width {
                along[y * width + x] = (-radius..=radius)
                    .map(|k| {
                        f64::from(taps[(k + radius) as usize]) * input[y * width + reflect101(x as isize + k, width)]
                    })
                    .sum();
            }
        }
        for y in 0..height {
            for x in 0..width {
                out[y * width + x] = (-radius..=radius)
                    .map(|k| {
                        f64::from(taps[(k + radius) as usize]) * along[reflect101(y as isize + k, height) * width + x]
                    })
                    .sum();
            }
        }
        out
    }

    #[test]
    fn taps_are_opencvs() {
        // cv2.getGaussianKernel(81, 10, cv2.CV_32F) at 0, 1, 20 and 40.
        let found = taps(10.0);
        assert_eq!(found.len(), 81);
        assert_eq!(
            [0, 1, 20, 40, 60, 80].map(|i| found[i].to_bits()),
            [0x3760_8a91, 0x37a6_a71b, 0x3bb0_ed35, 0x3d23_6a42, 0x3bb0_ed35, 0x3760_8a91]
        );
        assert_eq!([0.5, 1.3, 3.7, 25.0].map(|sigma| taps(sigma).len()), [5, 11, 31, 201]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn masks_and_floats_blur_alike_on_every_level_and_tiling(
            (width, height, mask) in (1usize..170, 1usize..24).prop_flat_map(|(w, h)| {
                (Just(w), Just(h), prop::collection::vec(prop_oneof![4 => Just(0u8), 1 => any::<u8>()], w * h))
            }),
            sigma in 0.3f64..12.0,
            cut in any::<prop::sample::Index>(),
        ) {
            let floats: Vec<f32> = mask.iter().map(|&set| f32::from(u8::from(set != 0))).collect();
            let doubles: Vec<f64> = floats.iter().map(|&set| f64::from(set)).collect();
            let expected = expected(&doubles, width, height, sigma);
            let of_mask = every_level(|level| {
                let mut out = vec![7.0; mask.len()];
                blur_mask_rows_at(level, &mask, width, height, sigma, 0..height, &mut out);
                out
            });
            let of_floats = every_level(|level| {
                let mut out = vec![7.0; mask.len()];
                blur_at(level, &floats, width, height, sigma, &mut out);
                out
            });
            for i in 0..mask.len() {
                prop_assert!((f64::from(of_mask[i]) - expected[i]).abs() < 1e-6);
                prop_assert!((f64::from(of_floats[i]) - expected[i]).abs() < 1e-6);
            }
            let cut = cut.index(height + 1);
            let mut tiled = vec![7.0; mask.len()];
            let (upper, lower) = tiled.split_at_mut(cut * width);
            blur_mask_rows(&mask, width, height, sigma, 0..cut, upper);
            blur_mask_rows(&mask, width, height, sigma, cut..height, lower);
            prop_assert_eq!(tiled, of_mask);
        }
    }
}
