//! The edge map: where the image changes from left to right, stereo can be trusted.

use crate::raster::{check, reflect101};
use crate::simd::{Level, Pass};

/// The value of an edge pixel in a mask; all others are 0.
pub const EDGE: u8 = 255;

/// Marks with [`EDGE`] where the absolute 3x3 Sobel derivative along the row exceeds `threshold`; 0 elsewhere.
///
/// The derivative is OpenCV's `Sobel(grey, CV_32F, 1, 0, ksize=3)` with its default border (reflect-101), so the
/// outermost columns are never edges. The paper's "vertical contrasts".
pub fn edges(grey: &[u8], width: usize, height: usize, threshold: f32, out: &mut [u8]) {
    edges_at(Level::best(), grey, width, height, threshold, out);
}

fn edges_at(level: Level, grey: &[u8], width: usize, height: usize, threshold: f32, out: &mut [u8]) {
    check("grey", grey.len(), width, height, 1);
    check("edge mask", out.len(), width, height, 1);
    if out.is_empty() {
        return;
    }
    // The derivative is a whole number of at most 4 * 255, so that comparing with the threshold's floor is the same.
    let threshold = if threshold.is_nan() { 1020 } else { threshold.floor().clamp(-1.0, 1020.0) as i16 };
    level.run(Edges { grey, width, height, threshold, out });
}

struct Edges<'a> {
    grey: &'a [u8],
    width: usize,
    height: usize,
    threshold: i16,
    out: &'a mut [u8],
}

impl Pass for Edges<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { grey, width, height, threshold, out } = self;
        let row = |y: isize| &grey[reflect101(y, height) * width..][..width];
        // One column of margin on either side, which the border rule fills.
        let mut smoothed = vec![0i16; width + 2];
        for (y, out) in out.chunks_exact_mut(width).enumerate() {
            let (above, here, below) = (row(y as isize - 1), row(y as isize), row(y as isize + 1));
            for (smoothed, ((&a, &b), &c)) in smoothed[1..=width].iter_mut().zip(above.iter().zip(here).zip(below)) {
                *smoothed = i16::from(a) + 2 * i16::from(b) + i16::from(c);
            }
            smoothed[0] = smoothed[1 + reflect101(-1, width)];
            smoothed[width + 1] = smoothed[1 + reflect101(width as isize, width)];
            for ((out, &left), &right) in out.iter_mut().zip(&smoothed[..width]).zip(&smoothed[2..]) {
                *out = if (right - left).abs() > threshold { EDGE } else { 0 };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;
    use proptest::prelude::*;

    const GREY: [u8; 15] = [1, 2, 50, 200, 255, 0, 9, 60, 255, 3, 7, 100, 130, 0, 1];

    fn edges_of(grey: &[u8], width: usize, height: usize, threshold: f32) -> Vec<u8> {
        every_level(|level| {
            let mut out = vec![7; grey.len()];
            edges_at(level, grey, width, height, threshold, &mut out);
            out
        })
    }

    #[test]
    fn the_derivative_is_opencvs() {
        // |cv2.Sobel(GREY, CV_32F, 1, 0, ksize=3)| is 0 218 888 296 0 | 0 292 590 38 0 | 0 366 292 372 0.
        assert_eq!(edges_of(&GREY, 5, 3, 292.0), [0, 0, 255, 255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 255, 0]);
        assert_eq!(edges_of(&GREY, 5, 3, 291.5), [0, 0, 255, 255, 0, 0, 255, 255, 0, 0, 0, 255, 255, 255, 0]);
    }

    #[test]
    fn images_one_pixel_wide_or_high_have_opencvs_borders() {
        assert_eq!(edges_of(&GREY[..5], 5, 1, 700.0), [0, 0, 255, 255, 0]);
        assert_eq!(edges_of(&GREY[..5], 1, 5, 0.0), [0; 5]);
        assert_eq!(edges_of(&GREY[..4], 2, 2, 0.0), [0; 4]);
    }

    #[test]
    fn a_negative_threshold_marks_every_pixel_and_nan_no_pixel() {
        assert_eq!(edges_of(&GREY, 5, 3, -0.5), [EDGE; 15]);
        assert_eq!(edges_of(&GREY, 5, 3, f32::NAN), [0; 15]);
    }

    proptest! {
        #[test]
        fn every_level_gives_the_definition(
            (width, height, grey) in (1usize..150, 1usize..6).prop_flat_map(|(w, h)| {
                (Just(w), Just(h), prop::collection::vec(any::<u8>(), w * h))
            }),
            threshold in 0f32..1100.0,
        ) {
            let at = |x: isize, y: isize| i32::from(grey[reflect101(y, height) * width + reflect101(x, width)]);
            let mut expected = Vec::new();
            for y in 0..height as isize {
                for x in 0..width as isize {
                    let column = |x| at(x, y - 1) + 2 * at(x, y) + at(x, y + 1);
                    expected.push(if (column(x + 1) - column(x - 1)).abs() as f32 > threshold { EDGE } else { 0 });
                }
            }
            prop_assert_eq!(&edges_of(&grey, width, height, threshold), &expected);
        }
    }
}
