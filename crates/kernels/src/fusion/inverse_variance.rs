//! The average of two depths weighted by their inverse variances: the best one of two independent Gaussian estimates.

use crate::raster::check_same;
use crate::simd::{Level, Pass};

/// The standard deviations of the two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviations {
    /// Of a stereo depth of 1 m, metres: that of the disparity, px, divided by focal length (px) times baseline (m).
    /// It grows with the square of the depth.
    pub stereo_at_1m: f32,
    /// Of monocular depth, as a share of it.
    pub mono_share: f32,
}

/// Fuses two depth maps (metres; NaN, infinite or not above 0: invalid) into the average and its standard deviation,
/// metres.
///
/// Where one of the two is invalid, the other is used, with its own deviation; where both are, the results are NaN.
pub fn fuse(stereo: &[f32], mono: &[f32], deviations: Deviations, depth: &mut [f32], deviation: &mut [f32]) {
    fuse_at(Level::best(), stereo, mono, deviations, depth, deviation);
}

fn fuse_at(
    level: Level,
    stereo: &[f32],
    mono: &[f32],
    deviations: Deviations,
    depth: &mut [f32],
    deviation: &mut [f32],
) {
    check_same("mono", mono.len(), stereo.len());
    check_same("fused depth", depth.len(), stereo.len());
    check_same("deviation", deviation.len(), stereo.len());
    level.run(Fuse { stereo, mono, deviations, depth, deviation });
}

struct Fuse<'a> {
    stereo: &'a [f32],
    mono: &'a [f32],
    deviations: Deviations,
    depth: &'a mut [f32],
    deviation: &'a mut [f32],
}

impl Pass for Fuse<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { stereo, mono, deviations, depth, deviation } = self;
        let outputs = depth.iter_mut().zip(deviation.iter_mut());
        for ((depth, deviation), (&stereo, &mono)) in outputs.zip(stereo.iter().zip(mono)) {
            let is_valid = |metres: f32| metres.is_finite() && metres > 0.0;
            let (has_stereo, has_mono) = (is_valid(stereo), is_valid(mono));
            let stereo_deviation = stereo * stereo * deviations.stereo_at_1m;
            let mono_deviation = mono * deviations.mono_share;
            // An invalid depth has no precision and no part in the sum.
            let precision = |deviation: f32, valid: bool| if valid { 1.0 / (deviation * deviation) } else { 0.0 };
            let (p_s, p_m) = (precision(stereo_deviation, has_stereo), precision(mono_deviation, has_mono));
            let part = |metres: f32, precision: f32, valid: bool| if valid { metres * precision } else { 0.0 };
            let sum = p_s + p_m;
            let average = (part(stereo, p_s, has_stereo) + part(mono, p_m, has_mono)) / sum;
            // 0/0 where both are invalid.
            *depth = average;
            *deviation = if sum > 0.0 { (1.0 / sum).sqrt() } else { f32::NAN };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::every_level;

    #[test]
    fn by_hand() {
        let (stereo, mono) = ([10.0, 20.0, f32::NAN, f32::INFINITY], [20.0, f32::NAN, 8.0, f32::NAN]);
        let deviations = Deviations { stereo_at_1m: 0.02, mono_share: 0.2 };
        let bits = every_level(|level| {
            let (mut depth, mut deviation) = ([0.0; 4], [0.0; 4]);
            fuse_at(level, &stereo, &mono, deviations, &mut depth, &mut deviation);
            (depth.map(f32::to_bits), deviation.map(f32::to_bits))
        });
        let (depth, deviation) = (bits.0.map(f32::from_bits), bits.1.map(f32::from_bits));
        // Deviations 2 m and 4 m: (10 / 4 + 20 / 16) / (1 / 4 + 1 / 16) = 12 m, sqrt(3.2) m. Then 0.02 * 400 = 8 m.
        let close = |ours: f32, expected: f32| assert!((ours - expected).abs() < 1e-5, "{ours}, not {expected}");
        close(depth[0], 12.0);
        close(deviation[0], 3.2_f32.sqrt());
        close(depth[1], 20.0);
        close(deviation[1], 8.0);
        close(depth[2], 8.0);
        close(deviation[2], 1.6);
        assert!(depth[3].is_nan() && deviation[3].is_nan());
    }
}
