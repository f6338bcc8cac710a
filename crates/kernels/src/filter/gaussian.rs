//! Gaussian blur of masks, separable, in `f32`, with OpenCV's kernel and border.
//!
//! The image is blurred in strips of columns ([`strips`]): along the rows into a scratch strip that stays in cache,
//! from there down the columns. Along the rows, a mask costs by its set pixels only ([`lines`]). Each output is a sum
//! in one fixed order, without FMA, on every instruction set.

mod lines;
mod strips;

use crate::raster::check;
use crate::simd::Level;
use lines::SetPixels;
use strips::blur_lines;

/// The taps of OpenCV's Gaussian for 32-bit float images: `round(8 sigma + 1) | 1` of them, normalised in `f64`.
///
/// For sigma 10 these are 81 taps, 4 sigma on either side.
fn taps(sigma: f64) -> Vec<f32> {
    assert!(sigma > 0.0 && sigma.is_finite(), "sigma must be positive and finite, not {sigma}");
    let count = (sigma * 8.0 + 1.0).round_ties_even() as usize | 1;
    let radius = (count / 2) as f64;
    let scale = -0.5 / (sigma * sigma);
    let raw: Vec<f64> = (0..count).map(|i| i as f64 - radius).map(|x| libm::exp(scale * x * x)).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|tap| (tap / sum) as f32).collect()
}

/// Blurs a mask; any value but 0 counts as 1.
pub(crate) fn blur_mask_at(level: Level, mask: &[u8], width: usize, height: usize, sigma: f64, out: &mut [f32]) {
    check("mask", mask.len(), width, height, 1);
    check("blurred mask", out.len(), width, height, 1);
    let taps = taps(sigma);
    if !out.is_empty() {
        blur_lines(level, &SetPixels::new(mask, width, height, &taps), &taps, width, height, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::reflect101;
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
        fn masks_blur_as_defined_on_every_level(
            (width, height, mask) in (1usize..170, 1usize..24).prop_flat_map(|(w, h)| {
                (Just(w), Just(h), prop::collection::vec(prop_oneof![4 => Just(0u8), 1 => any::<u8>()], w * h))
            }),
            sigma in 0.3f64..12.0,
        ) {
            let doubles: Vec<f64> = mask.iter().map(|&set| f64::from(u8::from(set != 0))).collect();
            let expected = expected(&doubles, width, height, sigma);
            let of_mask = every_level(|level| {
                let mut out = vec![7.0; mask.len()];
                blur_mask_at(level, &mask, width, height, sigma, &mut out);
                out
            });
            for i in 0..mask.len() {
                prop_assert!((f64::from(of_mask[i]) - expected[i]).abs() < 1e-6);
            }
        }
    }
}
