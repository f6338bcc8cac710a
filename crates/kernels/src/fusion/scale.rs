//! Scaling the mono estimate to what stereo saw (an ablation of the paper).
//!
//! A pixel is valid where its depth is finite.

use crate::raster::{check_same, key};
use crate::simd::{Level, Pass};

/// Independent partial results of a reduction: their number is fixed, so that every instruction set, and every
/// machine, reduces in the same order.
const LANES: usize = 64;

/// Smallest and largest valid depth, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Extent {
    pub min: f32,
    pub max: f32,
}

/// Smallest and largest of the valid (finite) pixels; `None` if all are invalid.
pub(crate) fn extent_at(level: Level, depth: &[f32]) -> Option<Extent> {
    let (min, max) = level.run(FindExtent { depth });
    (min <= max).then(|| Extent { min: f32::from_bits(key(min) as u32), max: f32::from_bits(key(max) as u32) })
}

/// Smallest and largest [`key`] of the valid pixels. Integers may be compared in any order, so that the compiler
/// can.
struct FindExtent<'a> {
    depth: &'a [f32],
}

impl Pass for FindExtent<'_> {
    type Output = (i32, i32);

    #[inline(always)]
    fn run(self) -> (i32, i32) {
        let (mut min, mut max) = (i32::MAX, i32::MIN);
        for depth in self.depth {
            let key = key(depth.to_bits() as i32);
            min = min.min(if depth.is_finite() { key } else { i32::MAX });
            max = max.max(if depth.is_finite() { key } else { i32::MIN });
        }
        (min, max)
    }
}

/// Min-max scaling: `min_s + (max_s - min_s) * (mono - min_m) / (max_m - min_m)`, the extent of stereo taken over
/// its valid pixels.
///
/// The range of mono is that of its own valid pixels; invalid pixels stay invalid. If stereo is valid nowhere, there
/// is nothing to scale by: mono is unchanged. A constant mono estimate has no extent: the result is invalid (NaN)
/// everywhere, as in the oracle.
pub fn minmax(mono: &[f32], stereo: &[f32], out: &mut [f32]) {
    minmax_at(Level::best(), mono, stereo, out);
}

pub(crate) fn minmax_at(level: Level, mono: &[f32], stereo: &[f32], out: &mut [f32]) {
    check_same("stereo", stereo.len(), mono.len());
    match (extent_at(level, mono), extent_at(level, stereo)) {
        (Some(mono_extent), Some(stereo_extent)) => minmax_to(level, mono, mono_extent, stereo_extent, out),
        _ => out.copy_from_slice(mono),
    }
}

fn minmax_to(level: Level, mono: &[f32], mono_extent: Extent, stereo_extent: Extent, out: &mut [f32]) {
    check_same("scaled depth", out.len(), mono.len());
    level.run(Affine {
        mono,
        offset: mono_extent.min,
        numerator: stereo_extent.max - stereo_extent.min,
        denominator: mono_extent.max - mono_extent.min,
        floor: stereo_extent.min,
        out,
    });
}

struct Affine<'a> {
    mono: &'a [f32],
    offset: f32,
    numerator: f32,
    denominator: f32,
    floor: f32,
    out: &'a mut [f32],
}

impl Pass for Affine<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (out, &mono) in self.out.iter_mut().zip(self.mono) {
            *out = self.floor + self.numerator * (mono - self.offset) / self.denominator;
        }
    }
}

/// Average scaling: `mono * mean(stereo) / mean(mono)`, both means over the pixels that are valid in both, in `f64`.
///
/// NumPy adds in another order, so its means may differ in the last bits of the `f64`; the ratio is rounded to `f32`
/// before it multiplies. If no pixel is valid in both, mono is unchanged.
pub fn average(mono: &[f32], stereo: &[f32], out: &mut [f32]) {
    average_at(Level::best(), mono, stereo, out);
}

pub(crate) fn average_at(level: Level, mono: &[f32], stereo: &[f32], out: &mut [f32]) {
    check_same("stereo", stereo.len(), mono.len());
    check_same("scaled depth", out.len(), mono.len());
    let Sums { mono: mono_sum, stereo: stereo_sum, valid } = level.run(ValidSums { mono, stereo });
    if valid == 0 {
        out.copy_from_slice(mono);
        return;
    }
    let (mono_mean, stereo_mean) = (mono_sum / valid as f64, stereo_sum / valid as f64);
    level.run(Times { mono, factor: (stereo_mean / mono_mean) as f32, out });
}

struct ValidSums<'a> {
    mono: &'a [f32],
    stereo: &'a [f32],
}

struct Sums {
    mono: f64,
    stereo: f64,
    valid: usize,
}

impl Pass for ValidSums<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run(self) -> Sums {
        let (mut mono_sums, mut stereo_sums, mut valid) = ([0f64; LANES], [0f64; LANES], 0);
        let ((monos, mono_rest), (stereos, stereo_rest)) =
            (self.mono.as_chunks::<LANES>(), self.stereo.as_chunks::<LANES>());
        for (mono, stereo) in monos.iter().zip(stereos) {
            valid += add_valid(mono, stereo, &mut mono_sums, &mut stereo_sums);
        }
        let (mut mono, mut stereo) = ([f32::NAN; LANES], [f32::NAN; LANES]);
        mono[..mono_rest.len()].copy_from_slice(mono_rest);
        stereo[..stereo_rest.len()].copy_from_slice(stereo_rest);
        valid += add_valid(&mono, &stereo, &mut mono_sums, &mut stereo_sums);
        Sums { mono: mono_sums.iter().sum(), stereo: stereo_sums.iter().sum(), valid: valid as usize }
    }
}

/// Adds both depths of the pixels that are valid in both to the lanes' sums; returns how many these are.
#[inline(always)]
fn add_valid(
    mono: &[f32; LANES],
    stereo: &[f32; LANES],
    mono_sums: &mut [f64; LANES],
    stereo_sums: &mut [f64; LANES],
) -> u32 {
    let valid = |lane: usize| mono[lane].is_finite() & stereo[lane].is_finite();
    for lane in 0..LANES {
        mono_sums[lane] += f64::from(if valid(lane) { mono[lane] } else { 0.0 });
    }
    for lane in 0..LANES {
        stereo_sums[lane] += f64::from(if valid(lane) { stereo[lane] } else { 0.0 });
    }
    (0..LANES).map(|lane| u32::from(valid(lane))).sum()
}

struct Times<'a> {
    mono: &'a [f32],
    factor: f32,
    out: &'a mut [f32],
}

impl Pass for Times<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (out, &mono) in self.out.iter_mut().zip(self.mono) {
            *out = mono * self.factor;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;
    use proptest::prelude::*;

    const NAN: f32 = f32::NAN;

    fn minmax_of(mono: &[f32], stereo: &[f32]) -> Vec<f32> {
        let bits = every_level(|level| {
            let mut out = vec![0.0; mono.len()];
            minmax_at(level, mono, stereo, &mut out);
            out.into_iter().map(f32::to_bits).collect::<Vec<_>>()
        });
        bits.into_iter().map(f32::from_bits).collect()
    }

    fn average_of(mono: &[f32], stereo: &[f32]) -> Vec<f32> {
        let bits = every_level(|level| {
            let mut out = vec![0.0; mono.len()];
            average_at(level, mono, stereo, &mut out);
            out.into_iter().map(f32::to_bits).collect::<Vec<_>>()
        });
        bits.into_iter().map(f32::from_bits).collect()
    }

    #[test]
    fn minmax_maps_the_range_of_mono_to_that_of_valid_stereo() {
        assert_eq!(minmax_of(&[1.0, 2.0, 5.0], &[NAN, 10.0, 50.0]), [10.0, 20.0, 50.0]);
    }

    #[test]
    fn average_uses_both_means_over_valid_stereo_pixels() {
        assert_eq!(average_of(&[100.0, 2.0, 4.0], &[NAN, 10.0, 5.0]), [250.0, 5.0, 10.0]);
    }

    #[test]
    fn fault_42_a_nan_pixel_does_not_affect_the_scale_of_others() {
        for gap in [NAN, -NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let (mono, stereo) = ([100.0, 2.0, gap, 4.0], [NAN, 10.0, 7.0, 5.0]);
            let scaled = average_of(&mono, &stereo);
            assert_eq!((scaled[0], scaled[1], scaled[3]), (250.0, 5.0, 10.0), "{gap}");
            assert!(!scaled[2].is_finite());
            let scaled = minmax_of(&mono, &stereo);
            assert_eq!((scaled[0], scaled[1]), (10.0, 5.0), "{gap}");
            assert!(!scaled[2].is_finite() && scaled[3].is_finite());
            // All pixels are invalid: there is nothing to scale.
            assert!(average_of(&[gap; 3], &[1.0, 2.0, NAN]).iter().all(|depth| !depth.is_finite()));
        }
    }

    #[test]
    fn without_any_stereo_mono_stays_as_it_is() {
        assert_eq!(minmax_of(&[1.0, 2.0], &[NAN, NAN]), [1.0, 2.0]);
        assert_eq!(average_of(&[1.0, 2.0], &[NAN, f32::INFINITY]), [1.0, 2.0]);
        assert_eq!(extent_at(Level::best(), &[NAN, f32::INFINITY]), None);
    }

    #[test]
    fn a_constant_mono_has_no_minmax_scale() {
        assert!(minmax_of(&[3.0, 3.0], &[1.0, 2.0]).iter().all(|depth| depth.is_nan()));
    }

    proptest! {
        #[test]
        fn extents_and_means_are_those_of_the_definition(
            pairs in prop::collection::vec((1f32..80.0, prop::option::weighted(0.8, 1f32..80.0)), 1..200),
        ) {
            let mono: Vec<f32> = pairs.iter().map(|pair| pair.0).collect();
            let stereo: Vec<f32> = pairs.iter().map(|pair| pair.1.unwrap_or(NAN)).collect();
            let seen: Vec<(f32, f32)> = pairs.iter().filter_map(|&(mono, stereo)| Some((mono, stereo?))).collect();
            let found = extent_at(Level::best(), &stereo);
            let smallest = seen.iter().map(|pair| pair.1).reduce(f32::min);
            let largest = seen.iter().map(|pair| pair.1).reduce(f32::max);
            prop_assert_eq!(found.map(|extent| extent.min), smallest);
            prop_assert_eq!(found.map(|extent| extent.max), largest);
            let scaled = average_of(&mono, &stereo);
            minmax_of(&mono, &stereo);
            let ratio = if seen.is_empty() {
                1.0
            } else {
                let sum = |pick: fn(&(f32, f32)) -> f32| seen.iter().map(|pair| f64::from(pick(pair))).sum::<f64>();
                sum(|pair| pair.1) / sum(|pair| pair.0)
            };
            for (scaled, mono) in scaled.iter().zip(&mono) {
                prop_assert!((f64::from(*scaled) / (f64::from(*mono) * ratio) - 1.0).abs() < 2e-7);
            }
        }
    }
}
