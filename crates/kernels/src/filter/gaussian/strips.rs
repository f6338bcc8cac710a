//! Blurring down the columns of a strip.

use super::lines::{STRIP, SetPixels};
use crate::raster::reflect101;
use crate::simd::{Block, BlockPass, Level, prefetch, run_blocks};

/// How many rows ahead the output is called into the cache.
const AHEAD: usize = 4;

/// One value for each column of a strip, aligned to cache lines.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Lane([f32; STRIP]);

impl Lane {
    const ZERO: Self = Self([0.0; STRIP]);
}

pub(super) fn blur_lines(level: Level, lines: &SetPixels, taps: &[f32], width: usize, height: usize, out: &mut [f32]) {
    if width >= STRIP {
        run_blocks(level, Blur { lines, taps, width, height, out });
        return;
    }
    // A narrow image is the left part of one strip.
    let mut strip = vec![0.0; STRIP * height];
    run_blocks(level, Blur { lines, taps, width: STRIP, height, out: &mut strip });
    for (out, strip) in out.chunks_exact_mut(width).zip(strip.chunks_exact(STRIP)) {
        out.copy_from_slice(&strip[..width]);
    }
}

struct Blur<'a> {
    lines: &'a SetPixels,
    taps: &'a [f32],
    width: usize,
    height: usize,
    out: &'a mut [f32],
}

impl BlockPass for Blur<'_> {
    type Output = ();

    #[inline(always)]
    fn run<B: Block>(self) {
        let Self { lines, taps, width, height, out } = self;
        let radius = taps.len() / 2;
        // Rows beyond the image are copied, so that the loop down the columns has no border.
        let mut strip = vec![Lane::ZERO; height + 2 * radius];
        for left in (0..width).step_by(STRIP) {
            // The last strip overlaps the one before: whole strips only.
            let left = left.min(width - STRIP);
            for y in 0..height {
                lines.blurred::<B>(y, left).store(&mut strip[radius + y].0);
            }
            for margin in 0..radius {
                strip[margin] = strip[radius + reflect101(margin as isize - radius as isize, height)];
                strip[radius + height + margin] = strip[radius + reflect101((height + margin) as isize, height)];
            }
            for (row, window) in strip.windows(2 * radius + 1).enumerate() {
                prefetch(out, (row + AHEAD) * width + left, STRIP);
                let out = out[row * width + left..].first_chunk_mut().expect("a whole strip");
                symmetric::<B>(window, taps).store(out);
            }
        }
    }
}

/// The weighted sum of an odd number of lanes under symmetric taps, from the centre outwards.
#[inline(always)]
fn symmetric<B: Block>(window: &[Lane], taps: &[f32]) -> B {
    let radius = taps.len() / 2;
    let (before, after) = (&window[..radius], &window[radius + 1..]);
    let mut sum = B::load(&window[radius].0).times(taps[radius]);
    for ((before, after), &tap) in before.iter().rev().zip(after).zip(&taps[radius + 1..]) {
        sum = sum.plus(B::load(&before.0).plus(B::load(&after.0)).times(tap));
    }
    sum
}
