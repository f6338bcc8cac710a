//! Alignment of a monocular map with stereo by scale and shift.
//!
//! A line `z = scale * x + shift` is fitted to the pixels that are valid in both maps. `x` is the monocular value and
//! `z` that of stereo, both in inverse depth or both in depth. Sums are `f64`, in the order of the pixels.

mod local;
mod robust;

use depthloom_scores::quantile::median;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use depthloom_scores::Line;
pub use local::{Window, local};

use crate::raster::check_same;
use crate::simd::{Level, Pass};

/// Metres; the smallest depth of a result.
const NEAREST_M: f64 = 1e-3;

/// What scale and shift apply to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Domain {
    /// Inverse depth, 1/m, as in MiDaS (Ranftl et al. 2020). Errors of stereo in pixels are alike at all distances
    /// there.
    #[default]
    InverseDepth,
    /// Depth, metres.
    Depth,
}

/// The two maps of a frame in one [`Domain`]; a pixel is invalid where it is not finite.
#[derive(Clone, Copy, Debug)]
pub struct Maps<'a> {
    /// What is aligned.
    pub mono: &'a [f32],
    /// What it is aligned with.
    pub stereo: &'a [f32],
    /// Confidence in stereo, which multiplies squared residuals. Pixels without a weight above 0 do not count. `None`:
    /// all pixels count alike.
    pub weight: Option<&'a [f32]>,
}

impl Maps<'_> {
    /// The pixel, if it is valid in both maps and its weight is above 0.
    #[inline(always)]
    fn point(&self, at: usize) -> Option<Point> {
        let (x, z, weight) = (self.mono[at], self.stereo[at], self.weight.map_or(1.0, |weight| weight[at]));
        let is_valid = x.is_finite() & z.is_finite() & (weight > 0.0) & weight.is_finite();
        is_valid.then_some(Point { x, z, weight })
    }

    fn check(&self) {
        check_same("stereo", self.stereo.len(), self.mono.len());
        if let Some(weight) = self.weight {
            check_same("weight", weight.len(), self.mono.len());
        }
    }
}

/// A pixel that is valid in both maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// The monocular value.
    pub x: f32,
    /// The value of stereo.
    pub z: f32,
    /// Above 0.
    pub weight: f32,
}

/// The pixels that are valid in both maps, row-major.
///
/// # Panics
/// If the maps have different sizes.
#[must_use]
pub fn points(maps: &Maps<'_>) -> Vec<Point> {
    maps.check();
    (0..maps.mono.len()).filter_map(|at| maps.point(at)).collect()
}

/// How a line is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// Weighted least squares of scale and shift.
    LeastSquares,
    /// Scale and shift that up to half of the pixels, if they are wrong, hardly change.
    Robust,
    /// The ratio of the medians, without a shift. Weights above 0 are alike.
    Median,
}

/// A line and whether the pixels determined it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Scale and shift.
    pub line: Line,
    /// Whether the monocular values were all alike (for the ratio of medians: whether it is not above 0). The line is
    /// then the ratio of means, or if that is not positive, the mean of stereo everywhere. Except for least squares,
    /// medians take the place of means.
    pub is_degenerate: bool,
}

/// Fits a line; `None` without points.
#[must_use]
pub fn fit(points: &[Point], estimator: Estimator) -> Option<Fit> {
    let first = points.first()?;
    let is_constant = points.iter().all(|point| point.x == first.x);
    let found = match estimator {
        Estimator::Median => ratio(centre(points, false)),
        _ if is_constant => None,
        Estimator::LeastSquares => least_squares(points),
        Estimator::Robust => robust::line(points),
    };
    let is_degenerate = found.is_none();
    let line = found.unwrap_or_else(|| {
        let centre = centre(points, estimator == Estimator::LeastSquares);
        ratio(centre).unwrap_or(Line { scale: 0.0, shift: centre.1 })
    });
    Some(Fit { line, is_degenerate })
}

fn least_squares(points: &[Point]) -> Option<Line> {
    let wide = |point: &Point| (f64::from(point.x), f64::from(point.z), f64::from(point.weight));
    Line::least_squares(points.iter().map(wide))
}

/// The line through the origin and a point, if its scale is positive.
fn ratio((x, z): (f64, f64)) -> Option<Line> {
    let scale = z / x;
    (x > 0.0 && scale > 0.0 && scale.is_finite()).then_some(Line { scale, shift: 0.0 })
}

/// Means, weighted, or medians of `x` and `z`.
fn centre(points: &[Point], mean: bool) -> (f64, f64) {
    if mean {
        let (mut total, mut x, mut z) = (0.0, 0.0, 0.0);
        for point in points {
            let weight = f64::from(point.weight);
            total += weight;
            x += weight * f64::from(point.x);
            z += weight * f64::from(point.z);
        }
        return (x / total, z / total);
    }
    let center = |value: fn(&Point) -> f32| {
        let mut values: Vec<f32> = points.iter().map(value).collect();
        median(&mut values, f32::total_cmp).unwrap_or(f64::NAN)
    };
    (center(|point| point.x), center(|point| point.z))
}

/// Metres of an aligned value. Inverse depth of zero and below is at the cap.
#[inline(always)]
fn metres(aligned: f64, domain: Domain, cap_m: f64) -> f32 {
    let metres = match domain {
        Domain::InverseDepth => {
            if aligned * cap_m > 1.0 {
                1.0 / aligned
            } else {
                cap_m
            }
        }
        Domain::Depth => {
            if aligned > cap_m {
                cap_m
            } else {
                aligned
            }
        }
    };
    (if metres < NEAREST_M { NEAREST_M } else { metres }) as f32
}

/// The aligned map, metres: `scale * x + shift` in `domain`, at most `cap_m` and at least 1 mm. Where the fit gives an
/// inverse depth of zero or below, the depth is `cap_m`. Invalid pixels of `mono` stay invalid (NaN).
///
/// # Panics
/// If the result has another size than the map.
pub fn apply(mono: &[f32], line: Line, domain: Domain, cap_m: f64, out: &mut [f32]) {
    apply_at(Level::best(), mono, line, domain, cap_m, out);
}

pub(crate) fn apply_at(level: Level, mono: &[f32], line: Line, domain: Domain, cap_m: f64, out: &mut [f32]) {
    check_same("aligned map", out.len(), mono.len());
    level.run(Apply { mono, line, domain, cap_m, out });
}

struct Apply<'a> {
    mono: &'a [f32],
    line: Line,
    domain: Domain,
    cap_m: f64,
    out: &'a mut [f32],
}

impl Pass for Apply<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { mono, line, domain, cap_m, out } = self;
        for (out, &x) in out.iter_mut().zip(mono) {
            let aligned = metres(line.scale * f64::from(x) + line.shift, domain, cap_m);
            *out = if x.is_finite() { aligned } else { f32::NAN };
        }
    }
}

/// A depth map in a domain: itself, or its inverse where it is above 0 (NaN elsewhere).
pub fn in_domain(metres: &[f32], domain: Domain, out: &mut [f32]) {
    check_same("converted map", out.len(), metres.len());
    match domain {
        Domain::Depth => out.copy_from_slice(metres),
        Domain::InverseDepth => {
            for (out, &metres) in out.iter_mut().zip(metres) {
                *out = if metres > 0.0 && metres.is_finite() { 1.0 / metres } else { f32::NAN };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;
    use depthloom_random::SplitMix64;
    use proptest::prelude::*;

    const NAN: f32 = f32::NAN;

    pub(super) fn maps<'a>(mono: &'a [f32], stereo: &'a [f32]) -> Maps<'a> {
        Maps { mono, stereo, weight: None }
    }

    fn line(mono: &[f32], stereo: &[f32], estimator: Estimator) -> Option<Fit> {
        fit(&points(&maps(mono, stereo)), estimator)
    }

    const ALL: [Estimator; 3] = [Estimator::LeastSquares, Estimator::Robust, Estimator::Median];

    #[test]
    fn only_pixels_valid_in_both_with_a_weight_count() {
        let weight = [1.0, 1.0, 0.0, NAN, 0.5, -1.0];
        let (mono, stereo) = ([1.0, NAN, 3.0, 4.0, 5.0, 6.0], [2.0, 2.0, 2.0, 2.0, f32::INFINITY, 2.0]);
        let found = points(&Maps { weight: Some(&weight), ..maps(&mono, &stereo) });
        assert_eq!(found, [Point { x: 1.0, z: 2.0, weight: 1.0 }]);
    }

    #[test]
    fn degenerate_maps_have_the_documented_lines() {
        for estimator in ALL {
            assert_eq!(line(&[1.0, NAN], &[NAN, 1.0], estimator), None, "{estimator:?}");
            // A constant: the ratio, or stereo's mean or median where no ratio exists.
            let found = line(&[2.0, 2.0, 2.0], &[1.0, 3.0, 2.0], estimator).unwrap();
            assert_eq!(found.line, Line { scale: 1.0, shift: 0.0 }, "{estimator:?}");
            let found = line(&[-2.0, -2.0, -2.0], &[1.0, 3.0, 2.0], estimator).unwrap();
            assert_eq!(found, Fit { line: Line { scale: 0.0, shift: 2.0 }, is_degenerate: true }, "{estimator:?}");
            // One pixel.
            let found = line(&[4.0, 1.0], &[1.0, NAN], estimator).unwrap();
            assert_eq!(found.line, Line { scale: 0.25, shift: 0.0 }, "{estimator:?}");
        }
    }

    #[test]
    fn results_are_at_most_the_cap_and_nothing_becomes_valid() {
        let applied = |line, domain| {
            let mono = [-1.0, 0.0, 0.001, 0.5, 1e9, NAN, f32::INFINITY];
            let bits = every_level(|level| {
                let mut out = vec![0.0; mono.len()];
                apply_at(level, &mono, line, domain, 80.0, &mut out);
                out.into_iter().map(f32::to_bits).collect::<Vec<_>>()
            });
            bits.into_iter().map(f32::from_bits).collect::<Vec<_>>()
        };
        let inverse = applied(Line { scale: 2.0, shift: 0.0 }, Domain::InverseDepth);
        assert_eq!(inverse[..5], [80.0, 80.0, 80.0, 1.0, 0.001]);
        let depth = applied(Line { scale: 2.0, shift: 1.0 }, Domain::Depth);
        assert_eq!(depth[..5], [0.001, 1.0, 1.002, 2.0, 80.0]);
        assert!(inverse[5].is_nan() && inverse[6].is_nan() && depth[5].is_nan() && depth[6].is_nan());
    }

    /// Inverse depths of a street from 2 to 80 m, and stereo of them with noise of a tenth of a pixel.
    fn street(seed: u64, count: usize) -> (Vec<f32>, Vec<f32>) {
        let mut random = SplitMix64::new(seed);
        let truth: Vec<f32> = (0..count).map(|_| 1.0 / (2.0 + 78.0 * random.unit() * random.unit())).collect();
        let stereo = truth.iter().map(|z| z + 3e-4 * random.sign_unit()).collect();
        (truth, stereo)
    }

    fn close(found: Line, scale: f64, shift: f64, tolerance: f64) -> bool {
        // At 2 m and at 80 m, relative to the inverse depth there.
        let off = |z: f64| (found.at((z - shift) / scale) - z).abs() / z;
        off(0.5) < tolerance && off(0.0125) < 20.0 * tolerance
    }

    #[test]
    fn robust_withstands_forty_percent_of_wrong_pixels() {
        for (seed, kind) in (0..30).flat_map(|seed| [(seed, 0), (seed, 1), (seed, 2)]) {
            let (truth, mut stereo) = street(seed, 5000);
            let mut random = SplitMix64::new(1000 + seed);
            let (scale, shift) = (f64::from(0.1 + 10.0 * random.unit()), f64::from(random.sign_unit()));
            for z in &mut stereo {
                if random.unit() < 0.4 {
                    *z = match kind {
                        // Anywhere, always too far, or on another line.
                        0 => 0.5 * random.unit(),
                        1 => *z * 0.3 * random.unit(),
                        _ => 0.1 + 0.3 * *z,
                    };
                }
            }
            let mono: Vec<f32> = truth.iter().map(|&z| ((f64::from(z) - shift) / scale) as f32).collect();
            let robust = line(&mono, &stereo, Estimator::Robust).unwrap().line;
            assert!(close(robust, scale, shift, 0.003), "seed {seed}, kind {kind}: {robust:?}, not {scale} {shift}");
            let least_squares = line(&mono, &stereo, Estimator::LeastSquares).unwrap().line;
            assert!(!close(least_squares, scale, shift, 0.003), "seed {seed}, kind {kind}: {least_squares:?}");
        }
    }

    proptest! {
        #[test]
        fn a_known_scale_and_shift_is_recovered(
            seed in 0u64..1000, scale in 0.05f64..50.0, shift in -3f64..3.0, share in 0.1f32..1.0,
        ) {
            let (truth, _) = street(seed, 400);
            let mono: Vec<f32> = truth.iter().map(|&z| ((f64::from(z) - shift) / scale) as f32).collect();
            let mut random = SplitMix64::new(seed);
            let stereo: Vec<f32> = truth.iter().map(|&z| if random.unit() < share { z } else { NAN }).collect();
            // The rounding of `mono` to f32 moves a depth by this much.
            let tolerance = 1e-5 * (1.0 + shift.abs() / 0.01);
            for estimator in [Estimator::LeastSquares, Estimator::Robust] {
                let found = line(&mono, &stereo, estimator).unwrap();
                let mut depth = vec![0.0; mono.len()];
                apply(&mono, found.line, Domain::InverseDepth, 1e4, &mut depth);
                for (depth, z) in depth.iter().zip(&truth) {
                    prop_assert!(f64::from((depth * z - 1.0).abs()) < tolerance, "{:?}: {} {}", estimator, depth, z);
                }
            }
            let scaled: Vec<f32> = truth.iter().map(|&z| (f64::from(z) / scale) as f32).collect();
            let found = line(&scaled, &stereo, Estimator::Median).unwrap().line;
            prop_assert!((found.scale / scale - 1.0).abs() < 1e-6 && found.shift == 0.0);
        }
    }
}
