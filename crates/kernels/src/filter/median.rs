//! Median filters of depth maps.
//!
//! Samples are compared as floats where all are zero or above, otherwise as integers ([`key`](crate::raster::key)),
//! which orders NaN too. The image is filtered in strips [`STRIP`] columns wide, from top to bottom, so that what
//! neighbouring windows share stays in cache: each row's windows are sorted once, and for 5x5 two rows' sorted windows
//! are merged once, whichever of the output rows read them.

pub(crate) mod integer;
mod networks;
mod valid;

use std::marker::PhantomData;

use crate::raster::{check, replicate};
use crate::simd::{Level, Pass, prefetch};
use networks::{Sample, median3_of_sorted, median11, merge5, middle6, sort3, sort5};
pub use valid::{median3_of_valid, median5_of_valid};

/// Columns filtered together. The more, the fewer pages are visited in turn; sorted windows must fit in the first
/// cache.
const STRIP: usize = 128;

/// Rows of sorted windows that 5x5 keeps: six are in use at once.
const RING: usize = 8;

/// How many rows ahead input and output are called into the cache.
const AHEAD: usize = 16;

/// One sample for each column of a strip. Aligned, because stores that straddle cache lines cost more than the network.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Lane<T>([T; STRIP]);

impl<T: Sample> Lane<T> {
    #[inline(always)]
    fn zero() -> Self {
        Self([T::default(); STRIP])
    }
}

/// Median over 3x3 pixels, border replicated: OpenCV's `medianBlur(..., 3)` of a `float32` image, exactly.
///
/// NaN sorts above every number (below, if its sign is set).
pub fn median3(input: &[f32], width: usize, height: usize, out: &mut [f32]) {
    median3_at(Level::best(), input, width, height, out);
}

fn median3_at(level: Level, input: &[f32], width: usize, height: usize, out: &mut [f32]) {
    check("depth", input.len(), width, height, 1);
    check("median", out.len(), width, height, 1);
    if !out.is_empty() {
        let image = Image { input, width, height };
        if level.run(All { depths: input, condition: is_unsigned }) {
            level.run(Median3::<f32> { image, out, samples: PhantomData });
        } else {
            level.run(Median3::<i32> { image, out, samples: PhantomData });
        }
    }
}

/// Median over 5x5 pixels, border replicated: OpenCV's `medianBlur(..., 5)` of a `float32` image, exactly.
///
/// NaN sorts above every number (below, if its sign is set).
pub fn median5(input: &[f32], width: usize, height: usize, out: &mut [f32]) {
    median5_at(Level::best(), input, width, height, out);
}

fn median5_at(level: Level, input: &[f32], width: usize, height: usize, out: &mut [f32]) {
    check("depth", input.len(), width, height, 1);
    check("median", out.len(), width, height, 1);
    if !out.is_empty() {
        let image = Image { input, width, height };
        if level.run(All { depths: input, condition: is_unsigned }) {
            level.run(Median5::<f32> { image, out, samples: PhantomData });
        } else {
            level.run(Median5::<i32> { image, out, samples: PhantomData });
        }
    }
}

/// Whether a condition is true for all pixels.
struct All<'a, F> {
    depths: &'a [f32],
    condition: F,
}

impl<F: Fn(f32) -> bool> Pass for All<'_, F> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        // Block by block, so that it vectorises and yet ends early.
        self.depths.chunks(4096).all(|block| block.iter().fold(true, |all, depth| all & (self.condition)(*depth)))
    }
}

/// Whether a pixel is zero or above, without a sign, and not NaN.
#[inline(always)]
fn is_unsigned(depth: f32) -> bool {
    depth.to_bits() <= f32::INFINITY.to_bits()
}

struct Image<'a> {
    input: &'a [f32],
    width: usize,
    height: usize,
}

impl Image<'_> {
    /// Keys of row `y` from column `left - reach` on, both replicated beyond the border.
    #[inline(always)]
    fn keys<T: Sample, const N: usize>(&self, y: isize, left: usize, reach: usize, keys: &mut [T; N]) {
        let row = &self.input[replicate(y, self.height) * self.width..][..self.width];
        if left >= reach && left - reach + N <= self.width {
            for (out, sample) in keys.iter_mut().zip(&row[left - reach..][..N]) {
                *out = T::from_depth(*sample);
            }
        } else {
            for (x, out) in keys.iter_mut().enumerate() {
                let x = replicate((left + x) as isize - reach as isize, self.width);
                *out = T::from_depth(row[x]);
            }
        }
    }
}

#[inline(always)]
fn store<T: Sample>(medians: &Lane<T>, row: &mut [f32], left: usize) {
    let columns = STRIP.min(row.len() - left);
    for (out, &median) in row[left..left + columns].iter_mut().zip(&medians.0) {
        *out = median.depth();
    }
}

struct Median3<'a, T> {
    image: Image<'a>,
    out: &'a mut [f32],
    samples: PhantomData<T>,
}

impl<T: Sample> Pass for Median3<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { image, out, .. } = self;
        for left in (0..image.width).step_by(STRIP) {
            // The sorted windows of three rows, in rotation, and the keys of the next.
            let mut sorted = [[Lane::zero(); 3]; 3];
            let mut keys = [T::default(); STRIP + 2];
            for (ahead, sorted) in (-1..1).zip(&mut sorted) {
                image.keys(ahead, left, 1, &mut keys);
                sort_windows3(&keys, sorted);
            }
            image.keys(1, left, 1, &mut keys);
            for index in 0..image.height {
                prefetch(image.input, (index + AHEAD) * image.width + left, STRIP);
                prefetch(out, (index + AHEAD) * image.width + left, STRIP);
                sort_windows3(&keys, &mut sorted[(index + 2) % 3]);
                image.keys(index as isize + 2, left, 1, &mut keys);
                let mut medians = Lane::zero();
                for x in 0..STRIP {
                    medians.0[x] = median3_of_sorted([at(&sorted[0], x), at(&sorted[1], x), at(&sorted[2], x)]);
                }
                store(&medians, &mut out[index * image.width..][..image.width], left);
            }
        }
    }
}

#[inline(always)]
fn sort_windows3<T: Sample>(keys: &[T; STRIP + 2], sorted: &mut [Lane<T>; 3]) {
    for x in 0..STRIP {
        let window = sort3([keys[x], keys[x + 1], keys[x + 2]]);
        for (lane, sample) in sorted.iter_mut().zip(window) {
            lane.0[x] = sample;
        }
    }
}

struct Median5<'a, T> {
    image: Image<'a>,
    out: &'a mut [f32],
    samples: PhantomData<T>,
}

impl<T: Sample> Pass for Median5<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { image, out, .. } = self;
        for left in (0..image.width).step_by(STRIP) {
            // Output rows are made in pairs y, y + 1. Their windows share the rows y - 1 to y + 2, merged two by two:
            // y - 1 with y, and y + 1 with y + 2, which the next pair of rows takes over as its first two.
            let mut sorted = [[Lane::zero(); 5]; RING]; // of row y + k at (index + k) % RING
            let mut merged = [[Lane::zero(); 10]; 2];
            // Filled a round before they are sorted: unaligned loads of what was only just stored would stall.
            let mut keys = [[T::default(); STRIP + 4]; 2];
            for ahead in -2..2 {
                image.keys(ahead, left, 2, &mut keys[0]);
                sort_windows5(&keys[0], &mut sorted[(ahead + 8) as usize % RING]);
            }
            merge_lanes(&sorted[RING - 1], &sorted[0], &mut merged[0]);
            for (keys, ahead) in keys.iter_mut().zip(2..) {
                image.keys(ahead, left, 2, keys);
            }
            for half in 0..image.height.div_ceil(2) {
                let index = 2 * half;
                for ahead in [AHEAD, AHEAD + 1] {
                    prefetch(image.input, (index + ahead) * image.width + left, STRIP);
                    prefetch(out, (index + ahead) * image.width + left, STRIP);
                }
                for (keys, ahead) in keys.iter_mut().zip(2..) {
                    sort_windows5(keys, &mut sorted[(index + ahead) % RING]);
                    image.keys((index + ahead + 2) as isize, left, 2, keys);
                }
                merge_lanes(&sorted[(index + 1) % RING], &sorted[(index + 2) % RING], &mut merged[(half + 1) % 2]);
                let (above, below) = (&sorted[(index + RING - 2) % RING], &sorted[(index + 3) % RING]);
                let (mut upper, mut lower) = (Lane::zero(), Lane::zero());
                for x in 0..STRIP {
                    let shared = middle6(at(&merged[0], x), at(&merged[1], x));
                    upper.0[x] = median11(shared, at(above, x));
                    lower.0[x] = median11(shared, at(below, x));
                }
                let mut pair = out[index * image.width..].chunks_exact_mut(image.width);
                for (medians, row) in [upper, lower].iter().zip(&mut pair) {
                    store(medians, row, left);
                }
            }
        }
    }
}

#[inline(always)]
fn at<T: Sample, const N: usize>(lanes: &[Lane<T>; N], x: usize) -> [T; N] {
    lanes.each_ref().map(|lane| lane.0[x])
}

#[inline(always)]
fn sort_windows5<T: Sample>(keys: &[T; STRIP + 4], sorted: &mut [Lane<T>; 5]) {
    for x in 0..STRIP {
        let window = sort5([keys[x], keys[x + 1], keys[x + 2], keys[x + 3], keys[x + 4]]);
        for (lane, sample) in sorted.iter_mut().zip(window) {
            lane.0[x] = sample;
        }
    }
}

#[inline(always)]
fn merge_lanes<T: Sample>(upper: &[Lane<T>; 5], lower: &[Lane<T>; 5], merged: &mut [Lane<T>; 10]) {
    for x in 0..STRIP {
        for (lane, sample) in merged.iter_mut().zip(merge5(at(upper, x), at(lower, x))) {
            lane.0[x] = sample;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;
    use proptest::prelude::*;

    /// The definition: sort the window, take the middle.
    fn expected(input: &[f32], width: usize, height: usize, reach: isize) -> Vec<u32> {
        let mut out = Vec::new();
        for y in 0..height as isize {
            for x in 0..width as isize {
                let mut window: Vec<f32> = (-reach..=reach)
                    .flat_map(|dy| (-reach..=reach).map(move |dx| (x + dx, y + dy)))
                    .map(|(x, y)| input[replicate(y, height) * width + replicate(x, width)])
                    .collect();
                window.sort_unstable_by(f32::total_cmp);
                out.push(window[window.len() / 2].to_bits());
            }
        }
        out
    }

    type Median = fn(Level, &[f32], usize, usize, &mut [f32]);

    fn filtered(median: Median, input: &[f32], width: usize, height: usize) -> Vec<u32> {
        every_level(|level| {
            let mut out = vec![-7.0; input.len()];
            median(level, input, width, height, &mut out);
            out.into_iter().map(f32::to_bits).collect()
        })
    }

    #[test]
    fn a_lone_outlier_disappears_and_a_straight_edge_stays() {
        let mut input: Vec<f32> = (0..9 * 9).map(|i| if i % 9 < 4 { 1.0 } else { 5.0 }).collect();
        let straight: Vec<u32> = input.iter().map(|sample| sample.to_bits()).collect();
        input[4 * 9 + 2] = 80.0;
        assert_eq!(filtered(median3_at, &input, 9, 9), straight);
        assert_eq!(filtered(median5_at, &input, 9, 9), straight);
    }

    fn sample() -> impl Strategy<Value = f32> {
        prop_oneof![
            4 => (0u8..6).prop_map(f32::from),
            4 => -90f32..90.0,
            1 => prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(f32::NEG_INFINITY), Just(-0.0)],
        ]
    }

    /// A sample without a sign that is not NaN: maps of these alone are compared as floats.
    fn unsigned() -> impl Strategy<Value = f32> {
        prop_oneof![
            4 => (0u8..6).prop_map(f32::from),
            4 => 0f32..90.0,
            1 => prop_oneof![Just(f32::INFINITY), Just(1e-40), Just(f32::MAX)],
        ]
    }

    proptest! {
        #[test]
        fn every_level_takes_the_middle_of_the_sorted_window(
            (width, height, input) in (1usize..270, 1usize..12).prop_flat_map(|(w, h)| {
                let (any, unsigned) = (prop::collection::vec(sample(), w * h), prop::collection::vec(unsigned(), w * h));
                (Just(w), Just(h), prop_oneof![any, unsigned])
            }),
        ) {
            prop_assert_eq!(filtered(median3_at, &input, width, height), expected(&input, width, height, 1));
            prop_assert_eq!(filtered(median5_at, &input, width, height), expected(&input, width, height, 2));
        }
    }
}
