//! What a 64-beam laser scanner returns: scan lines fanned in elevation, sampled in azimuth, weaker with distance.
//!
//! The beams start at the left camera (a real scanner is next to it, so that some of its returns are hidden from
//! the camera; data sets remove those from their ground truth), and each return has the exact depth of the pixel that
//! its beam passes through.

use crate::frame::{Calibration, Size};
use crate::hash::{Draws, hash2, unit};

/// Elevation of the uppermost beam, and the steps of the upper and the lower half of the beams: radians (2°, 1/3°,
/// 1/2°; HDL-64E S2 manual).
const TOP: f64 = 0.034_906_585;
const UPPER_STEP: f64 = 0.005_817_764;
const LOWER_STEP: f64 = 0.008_726_646;
/// Azimuth step at ten turns a second (0.1728°): cosine and sine.
const AZIMUTH_STEP: (f64, f64) = (0.999_995_452_0, 0.003_015_924_0);
/// Everything nearer than this returns, nothing beyond the range does, metres.
const SURE_RANGE: f32 = 40.0;
const RANGE: f32 = 115.0;
/// Share of beams lost at any distance.
const LOST: f32 = 0.06;

/// Picks the depths that are scanned, NaN elsewhere. `reflects` is, per pixel, the probability that a surface sends
/// anything back.
pub(crate) fn scan(
    seed: u64,
    frame: u64,
    size: Size,
    calibration: &Calibration,
    depth: &[f32],
    reflects: &[u8],
) -> Vec<f32> {
    let mut sparse = vec![f32::NAN; size.pixels()];
    let mut draws = Draws::new(seed ^ 0x11da, 3, frame.cast_signed());
    let key = draws.bits();
    // The scanner turns freely: where its samples fall differs between frames.
    let phase = f64::from(draws.between(0.0, 1.0));
    for beam in 0..64_i32 {
        let upper = beam.min(32);
        let lower = beam - upper;
        let elevation = TOP - UPPER_STEP * f64::from(upper) - LOWER_STEP * f64::from(lower);
        let rise = tangent(elevation);
        for (side, first) in [(1.0, phase), (-1.0, 1.0 - phase)] {
            let (mut cos, mut sin) = (1.0, first * AZIMUTH_STEP.1);
            for step in 0.. {
                let across = side * sin / cos;
                let column = (calibration.cx_px + calibration.focal_px * across + 0.5).floor();
                if column < 0.0 || column >= size.width as f64 {
                    break;
                }
                // A cone in space is a hyperbola in the image.
                let row = (calibration.cy_px - calibration.focal_px * rise / cos + 0.5).floor();
                let sample = hash2(key, beam, if side > 0.0 { step } else { -1 - step });
                (cos, sin) = (cos * AZIMUTH_STEP.0 - sin * AZIMUTH_STEP.1, sin * AZIMUTH_STEP.0 + cos * AZIMUTH_STEP.1);
                if row < 0.0 || row >= size.height as f64 {
                    continue;
                }
                let pixel = row as usize * size.width + column as usize;
                let metres = depth[pixel];
                let fading = ((metres - SURE_RANGE) / (RANGE - SURE_RANGE)).clamp(0.0, 1.0);
                let returned = (1.0 - LOST) * (1.0 - fading) * f32::from(reflects[pixel]) / 255.0;
                if metres < RANGE && unit(sample) < returned {
                    sparse[pixel] = metres;
                }
            }
        }
    }
    sparse
}

/// The tangent of a small angle, to 1e-9 below half a radian (its series; a library's would differ between machines).
fn tangent(x: f64) -> f64 {
    let q = x * x;
    let terms = [
        1.0,
        1.0 / 3.0,
        2.0 / 15.0,
        17.0 / 315.0,
        62.0 / 2835.0,
        1382.0 / 155_925.0,
        21_844.0 / 6_081_075.0,
        929_569.0 / 638_512_875.0,
    ];
    x * terms.iter().rev().fold(0.0, |sum, term| sum * q + term)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_is_the_tangent() {
        for angle in [-0.45_f64, -0.2, 0.0, 0.03, 0.4] {
            assert!((tangent(angle) - angle.tan()).abs() < 1e-7, "{angle}");
        }
    }

    #[test]
    fn the_azimuth_step_is_a_rotation_by_its_angle() {
        let (cos, sin) = AZIMUTH_STEP;
        assert!((cos * cos + sin * sin - 1.0).abs() < 1e-9);
        assert!((sin.asin().to_degrees() - 0.1728).abs() < 1e-5);
    }
}
