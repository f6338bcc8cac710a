//! Fusing stereo and mono depth, pixel by pixel.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fusion::scale::extent_at;
use crate::raster::check_same;
use crate::simd::{Level, Pass};

/// How the two are weighted where stereo is valid; elsewhere mono is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Weighting {
    /// `W_c Z_s + (1 - W_c) (W_s Z_s + (1 - W_s) Z_m)`, as in Martins et al. 2018.
    #[default]
    Full,
    /// `W_c Z_s + (1 - W_c) Z_m`, without `W_s`: "no weighting" in Martins et al. 2018.
    Confidence,
    /// `(Z_s + Z_m) / 2`, without both weights.
    Mean,
    /// `Z_s` wherever stereo is valid.
    Fill,
}

/// Fuses two depth maps (metres) under the confidence `weight` (`W_c`, in [0, 1]); the median filter comes after.
///
/// Where one of the two is invalid (NaN, infinity) the other is used, whatever the confidence; where both are invalid,
/// the result is NaN. Stereo's maximum is taken over its valid (finite) pixels, mono's over all of its
/// finite pixels. The arithmetic is the oracle's (NumPy on `float32`), operation by operation.
pub fn fuse(stereo: &[f32], mono: &[f32], weight: &[f32], weighting: Weighting, out: &mut [f32]) {
    fuse_at(Level::best(), stereo, mono, weight, weighting, out);
}

fn fuse_at(level: Level, stereo: &[f32], mono: &[f32], weight: &[f32], weighting: Weighting, out: &mut [f32]) {
    check_same("mono", mono.len(), stereo.len());
    check_same("weight", weight.len(), stereo.len());
    check_same("fused depth", out.len(), stereo.len());
    match weighting {
        Weighting::Full => {
            let rule = Full { stereo_max: largest(level, stereo), mono_max: largest(level, mono) };
            level.run(Fuse { stereo, mono, weight, out, rule });
        }
        Weighting::Confidence => level.run(Fuse { stereo, mono, weight, out, rule: Confidence }),
        Weighting::Mean => level.run(Fuse { stereo, mono, weight, out, rule: Mean }),
        Weighting::Fill => level.run(Fuse { stereo, mono, weight, out, rule: Fill }),
    }
}

fn largest(level: Level, depth: &[f32]) -> f32 {
    extent_at(level, depth).map_or(1.0, |extent| extent.max)
}

trait Rule {
    fn fused(&self, stereo: f32, mono: f32, weight: f32) -> f32;
}

struct Full {
    stereo_max: f32,
    mono_max: f32,
}

impl Rule for Full {
    #[inline(always)]
    fn fused(&self, stereo: f32, mono: f32, weight: f32) -> f32 {
        let (n_s, n_m) = (stereo / self.stereo_max, mono / self.mono_max);
        // A NaN in either makes the quotient NaN, as NumPy's minimum and maximum would.
        let (low, high) = if n_s < n_m { (n_s, n_m) } else { (n_m, n_s) };
        let w_s = low / high;
        weight * stereo + (1.0 - weight) * (w_s * stereo + (1.0 - w_s) * mono)
    }
}

struct Confidence;

impl Rule for Confidence {
    #[inline(always)]
    fn fused(&self, stereo: f32, mono: f32, weight: f32) -> f32 {
        weight * stereo + (1.0 - weight) * mono
    }
}

struct Mean;

impl Rule for Mean {
    #[inline(always)]
    fn fused(&self, stereo: f32, mono: f32, _weight: f32) -> f32 {
        (stereo + mono) / 2.0
    }
}

struct Fill;

impl Rule for Fill {
    #[inline(always)]
    fn fused(&self, stereo: f32, _mono: f32, _weight: f32) -> f32 {
        stereo
    }
}

struct Fuse<'a, R> {
    stereo: &'a [f32],
    mono: &'a [f32],
    weight: &'a [f32],
    out: &'a mut [f32],
    rule: R,
}

impl<R: Rule> Pass for Fuse<'_, R> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { stereo, mono, weight, out, rule } = self;
        for (((out, &stereo), &mono), &weight) in out.iter_mut().zip(stereo).zip(mono).zip(weight) {
            let both = rule.fused(stereo, mono, weight);
            // NaN in a sum makes the sum NaN: this one check of the result covers invalid mono pixels too.
            let (fused, alone) = if stereo.is_finite() { (both, stereo) } else { (mono, f32::NAN) };
            *out = if fused.is_finite() { fused } else { alone };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;
    use proptest::prelude::*;

    const NAN: f32 = f32::NAN;

    fn fused(stereo: &[f32], mono: &[f32], weight: &[f32], weighting: Weighting) -> Vec<f32> {
        let bits = every_level(|level| {
            let mut out = vec![0.0; mono.len()];
            fuse_at(level, stereo, mono, weight, weighting, &mut out);
            out.into_iter().map(f32::to_bits).collect::<Vec<_>>()
        });
        bits.into_iter().map(f32::from_bits).collect()
    }

    #[test]
    fn each_weighting_follows_its_formula_and_gaps_take_mono() {
        let (stereo, mono, weight) = ([10.0, 20.0, NAN, 40.0], [40.0, 10.0, 7.0, 20.0], [0.5, 1.0, 1.0, 0.0]);
        // Pixel 0: N_s = 1/4, N_m = 1, W_s = 1/4: 0.5 * 10 + 0.5 * (0.25 * 10 + 0.75 * 40) = 21.25.
        // Pixel 3: N_s = 1, N_m = 1/2, W_s = 1/2: 0.5 * 40 + 0.5 * 20 = 30.
        assert_eq!(fused(&stereo, &mono, &weight, Weighting::Full), [21.25, 20.0, 7.0, 30.0]);
        assert_eq!(fused(&stereo, &mono, &weight, Weighting::Confidence), [25.0, 20.0, 7.0, 20.0]);
        assert_eq!(fused(&stereo, &mono, &weight, Weighting::Mean), [25.0, 15.0, 7.0, 30.0]);
        assert_eq!(fused(&stereo, &mono, &weight, Weighting::Fill), [10.0, 20.0, 7.0, 40.0]);
    }

    #[test]
    fn fault_19_stereo_is_used_where_mono_is_invalid_whatever_the_confidence() {
        for gap in [NAN, -NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for weighting in [Weighting::Full, Weighting::Confidence, Weighting::Mean, Weighting::Fill] {
                // 40 pixels of each, so that vectors and what remains of them are both seen.
                let stereo = [[10.0; 40], [20.0; 40], [NAN; 40], [f32::INFINITY; 40]].concat();
                let mono = [[gap; 40], [20.0; 40], [gap; 40], [30.0; 40]].concat();
                for weight in [0.0, 0.3, 1.0] {
                    let out = fused(&stereo, &mono, &[weight; 160], weighting);
                    let expected = [[10.0; 40], [20.0; 40], [NAN; 40], [30.0; 40]].concat();
                    for (found, expected) in out.iter().zip(expected) {
                        let equal = if expected.is_nan() { found.is_nan() } else { (found - expected).abs() < 1e-5 };
                        assert!(equal, "{gap} {weighting:?} {weight}: {found} is not {expected}");
                    }
                }
            }
        }
    }

    #[test]
    fn without_any_stereo_all_is_mono() {
        assert_eq!(fused(&[NAN, NAN], &[3.0, 4.0], &[1.0, 0.5], Weighting::Full), [3.0, 4.0]);
    }

    proptest! {
        #[test]
        fn a_fused_depth_lies_between_the_two_estimates_on_every_level(
            pixels in prop::collection::vec((prop::option::weighted(0.8, 1f32..80.0), 1f32..80.0, 0f32..=1.0), 1..100),
        ) {
            let stereo: Vec<f32> = pixels.iter().map(|pixel| pixel.0.unwrap_or(NAN)).collect();
            let mono: Vec<f32> = pixels.iter().map(|pixel| pixel.1).collect();
            let weight: Vec<f32> = pixels.iter().map(|pixel| pixel.2).collect();
            for weighting in [Weighting::Full, Weighting::Confidence, Weighting::Mean, Weighting::Fill] {
                for (i, depth) in fused(&stereo, &mono, &weight, weighting).into_iter().enumerate() {
                    let other = if stereo[i].is_nan() { mono[i] } else { stereo[i] };
                    prop_assert!(depth >= mono[i].min(other) * 0.999_999 && depth <= mono[i].max(other) * 1.000_001);
                }
            }
        }
    }
}
