//! Medians of maps with gaps: an invalid pixel is not a sample.

use super::{All, median3, median5};
use crate::raster::{check, replicate};
use crate::simd::Level;

/// [`median3`] over the valid (finite) pixels of every window.
///
/// A valid pixel gets the median of the valid pixels around it (of an even number the mean of the middle two, as
/// NumPy's `nanmedian`); an invalid one gets it if more than half of its window is valid, and otherwise stays invalid
/// (NaN). So invalid pixels neither spread nor attract valid ones. If all pixels are valid this is [`median3`], in its
/// time.
pub fn median3_of_valid(input: &[f32], width: usize, height: usize, out: &mut [f32]) {
    median3(input, width, height, out);
    mend::<1>(input, width, height, out);
}

/// [`median5`] over the valid pixels of every window; see [`median3_of_valid`].
pub fn median5_of_valid(input: &[f32], width: usize, height: usize, out: &mut [f32]) {
    median5(input, width, height, out);
    mend::<2>(input, width, height, out);
}

/// Puts right what gaps did to the medians of windows that reach `REACH` pixels.
fn mend<const REACH: usize>(input: &[f32], width: usize, height: usize, out: &mut [f32]) {
    check("depth", input.len(), width, height, 1);
    if Level::best().run(All { depths: input, condition: f32::is_finite }) {
        return;
    }
    let reach = REACH as isize;
    let around = |at: usize, len: usize| (-reach..=reach).map(move |offset| replicate(at as isize + offset, len));
    let mut gaps_of_column = vec![0_u32; width];
    for y in 0..height {
        gaps_of_column.fill(0);
        for row in around(y, height) {
            for (gaps, depth) in gaps_of_column.iter_mut().zip(&input[row * width..][..width]) {
                *gaps += u32::from(!depth.is_finite());
            }
        }
        for x in 0..width {
            let gaps: u32 = around(x, width).map(|column| gaps_of_column[column]).sum();
            if gaps > 0 {
                let rows = around(y, height);
                let window = rows.flat_map(|row| around(x, width).map(move |column| input[row * width + column]));
                out[y * width + x] = of_window::<25>(input[y * width + x].is_finite(), window);
            }
        }
    }
}

/// The median of a window's valid pixels; NaN if they are too few for an invalid centre.
fn of_window<const MOST: usize>(centre_answered: bool, window: impl Iterator<Item = f32>) -> f32 {
    let mut depths = [0.0_f32; MOST];
    let (mut count, mut size) = (0, 0);
    for depth in window {
        depths[count] = depth;
        count += usize::from(depth.is_finite());
        size += 1;
    }
    if !centre_answered && 2 * count <= size {
        return f32::NAN;
    }
    let depths = &mut depths[..count];
    depths.sort_unstable_by(f32::total_cmp);
    let upper = depths[count / 2];
    if count % 2 == 1 { upper } else { (depths[count / 2 - 1] + upper) / 2.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NAN: f32 = f32::NAN;

    fn filtered(input: &[f32], width: usize, height: usize) -> [Vec<f32>; 2] {
        [median3_of_valid, median5_of_valid].map(|median| {
            let mut out = vec![-7.0; input.len()];
            median(input, width, height, &mut out);
            out
        })
    }

    #[test]
    fn fault_42_a_valid_pixel_stays_valid_among_invalid_ones() {
        for gap in [NAN, -NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut input = vec![gap; 49];
            input[24] = 5.0;
            for out in filtered(&input, 7, 7) {
                assert_eq!(out[24], 5.0, "{gap}");
                assert!(out.iter().enumerate().all(|(i, depth)| i == 24 || depth.is_nan()), "a gap stays a gap");
            }
        }
    }

    #[test]
    fn medians_of_valid_pixels_equal_numpys_nanmedian() {
        // np.nanmedian of the window of pixel (1, 1): of 1 2 3 4 6 7 8 9 it is 5, without 6 it is 4.
        let mut input = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
        input[4] = NAN;
        assert_eq!(filtered(&input, 3, 3)[0][4], 5.0);
        input[5] = NAN;
        assert_eq!(filtered(&input, 3, 3)[0][4], 4.0);
    }

    proptest! {
        #[test]
        fn windows_without_gaps_have_opencvs_median_and_others_that_of_their_answers(
            (width, height, input) in (1usize..80, 1usize..9).prop_flat_map(|(w, h)| {
                let sample = prop_oneof![6 => -90f32..90.0, 1 => Just(NAN), 1 => Just(f32::NEG_INFINITY)];
                (Just(w), Just(h), prop::collection::vec(sample, w * h))
            }),
        ) {
            for (out, reach) in filtered(&input, width, height).iter().zip([1isize, 2]) {
                for y in 0..height {
                    for x in 0..width {
                        let near = |at: usize, len: usize| (-reach..=reach).map(move |o| replicate(at as isize + o, len));
                        let mut depths: Vec<f32> = near(y, height)
                            .flat_map(|y| near(x, width).map(move |x| (x, y)))
                            .map(|(x, y)| input[y * width + x])
                            .filter(|depth| depth.is_finite())
                            .collect();
                        depths.sort_by(f32::total_cmp);
                        let (n, all) = (depths.len(), (2 * reach + 1).pow(2) as usize);
                        let found = out[y * width + x];
                        if input[y * width + x].is_finite() || 2 * n > all {
                            let middle = if n % 2 == 1 { depths[n / 2] } else { (depths[n / 2 - 1] + depths[n / 2]) / 2.0 };
                            prop_assert_eq!(found, middle);
                        } else {
                            prop_assert!(found.is_nan());
                        }
                    }
                }
            }
        }
    }
}
