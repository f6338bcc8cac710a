//! The error of a map, and its gradient.
//!
//! Losses are plain loops over samples, forward and gradient in one, summed in a fixed order: so equal runs have equal
//! bits whatever the number of threads, and the training library only has to carry the gradient back.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::networks::Meaning;

/// The measure of the absolute error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Loss {
    /// Inverse depth, as the disparity's share of the image's width: near things count as much as stereo measures them
    /// well.
    #[default]
    InverseDepth,
    /// Depth, metres: the paper's; needs the calibration at `learn/samples`.
    Depth,
    /// Logarithm of depth: equal ratios count equally.
    LogDepth,
}

/// How errors count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Penalty {
    /// By their size.
    #[default]
    Absolute,
    /// The reverse Huber loss (Laina et al. 2016): errors above a fifth of the batch's largest count by their square.
    Berhu,
}

/// Smallest spread that the loss distinguishes.
const LEAST_SPREAD: f32 = 0.01;

/// Smallest share taken, of disparity and width: a depth of some kilometres.
const LEAST_SHARE: f32 = 1e-5;
/// Smallest depth taken, metres.
const LEAST_DEPTH_M: f32 = 1e-3;

/// The natural logarithm, rounded once from `f64`, in plain arithmetic: the system's differs in last bits between
/// machines.
fn ln(x: f32) -> f32 {
    libm::log(f64::from(x)) as f32
}

#[derive(Clone, Copy, Debug)]
pub(super) struct MaskedError {
    pub(crate) loss: Loss,
    pub(crate) meaning: Meaning,
    /// Depths beyond are as far as this, metres; of [`Loss::Depth`].
    pub(crate) cap_m: f32,
    /// Errors above this count by their square ([`Penalty::Berhu`]), in the loss's own measure.
    pub(crate) knee: f32,
}

/// A value and its derivative by the map's sample.
#[derive(Clone, Copy)]
struct Dual {
    value: f32,
    slope: f32,
}

impl MaskedError {
    /// The factor that brings the loss to the order of the map's [0, 1].
    fn unit(&self) -> f32 {
        match (self.loss, self.meaning) {
            (Loss::InverseDepth, Meaning::DisparityShare { scale }) => scale,
            (Loss::Depth, Meaning::Depth { farthest_m }) => farthest_m,
            (Loss::Depth, Meaning::DisparityShare { .. }) => self.cap_m,
            (Loss::InverseDepth, Meaning::Depth { .. }) => 0.1,
            (Loss::LogDepth, _) => 1.0,
        }
    }

    /// The sample in the loss's own measure, and its derivative. `k` is depth x share.
    fn measured(&self, sample: f32, k: f32) -> Dual {
        let share = |sample: f32| match self.meaning {
            Meaning::DisparityShare { scale } => Dual { value: (sample * scale).max(LEAST_SHARE), slope: scale },
            Meaning::Depth { farthest_m } => {
                let depth = (sample * farthest_m).max(LEAST_DEPTH_M);
                Dual { value: k / depth, slope: -k / (depth * depth) * farthest_m }
            }
        };
        match (self.loss, self.meaning) {
            (Loss::InverseDepth, _) => share(sample),
            (Loss::LogDepth, Meaning::DisparityShare { .. }) => {
                let Dual { value, slope } = share(sample);
                Dual { value: ln(value), slope: slope / value }
            }
            (Loss::LogDepth, Meaning::Depth { farthest_m }) => {
                let depth = (sample * farthest_m).max(LEAST_DEPTH_M);
                Dual { value: ln(k / depth), slope: -farthest_m / depth }
            }
            (Loss::Depth, Meaning::Depth { farthest_m }) => Dual { value: sample * farthest_m, slope: farthest_m },
            (Loss::Depth, Meaning::DisparityShare { .. }) => {
                let Dual { value, slope } = share(sample);
                let depth = k / value;
                if depth > self.cap_m {
                    // Held at the cap, but not without a way back: what is nearer there still pulls.
                    return Dual { value: self.cap_m, slope: -k / (value * value) * slope };
                }
                Dual { value: depth, slope: -depth / value * slope }
            }
        }
    }

    fn target(&self, share: f32, k: f32) -> f32 {
        match self.loss {
            Loss::InverseDepth => share,
            Loss::LogDepth => ln(share.max(LEAST_SHARE)),
            Loss::Depth => (k / share.max(LEAST_SHARE)).min(self.cap_m),
        }
    }

    /// Sum of absolute errors over the samples that have a target, and their number; `slopes` gets each sample's sign
    /// and derivative, to be divided by the batch's number.
    ///
    /// `shares` is NaN where there is no target; `k` turns a share into depth (`depth = k / share`).
    pub(super) fn add(&self, map: &[f32], shares: &[f32], k: f32, slopes: &mut [f32]) -> (f64, u64) {
        let (mut sum, mut count, unit) = (0.0, 0, self.unit());
        for ((&sample, &share), slope) in map.iter().zip(shares).zip(slopes) {
            *slope = 0.0;
            if share.is_nan() {
                continue;
            }
            let measured = self.measured(sample, k);
            let error = measured.value - self.target(share, k);
            sum += f64::from(error.abs());
            count += 1;
            if error != 0.0 {
                *slope = self.pull(error) * measured.slope / unit;
            }
        }
        (sum, count)
    }

    /// The derivative of an error's penalty.
    fn pull(&self, error: f32) -> f32 {
        if error.abs() > self.knee { error / self.knee } else { error.signum() }
    }

    /// The largest absolute error of the samples that have a target.
    pub(super) fn largest(&self, map: &[f32], shares: &[f32], k: f32) -> f32 {
        let with_target = map.iter().zip(shares).filter(|(_, share)| !share.is_nan());
        with_target.fold(0.0, |largest, (&sample, &share)| {
            largest.max((self.measured(sample, k).value - self.target(share, k)).abs())
        })
    }

    /// As [`add`](Self::add), of the negative log likelihood of a Laplace distribution, `|e| / b + ln b`: `b` is
    /// the sample of `spreads`, which has its own slopes. The sum is that of absolute errors.
    ///
    /// All slopes are those of the likelihood times `sqrt(b)`, as in the beta-NLL loss of Seitzer et al. 2022 with
    /// `beta` 0.5: otherwise large errors at the start drive the network to a constant map.
    pub(super) fn add_likelihood(
        &self,
        maps: [&[f32]; 2],
        shares: &[f32],
        k: f32,
        slopes: [&mut [f32]; 2],
    ) -> (f64, u64) {
        let ([map, spreads], [slopes, spread_slopes]) = (maps, slopes);
        let measured = self.add(map, shares, k, slopes);
        let samples = map.iter().zip(spreads).zip(shares);
        for (((&sample, &spread), &share), (slope, spread_slope)) in samples.zip(slopes.iter_mut().zip(spread_slopes)) {
            *spread_slope = 0.0;
            if share.is_nan() {
                continue;
            }
            let (error, b) = (self.measured(sample, k).value - self.target(share, k), spread.max(LEAST_SPREAD));
            *slope /= b.sqrt();
            *spread_slope = (1.0 - error.abs() / b) / b.sqrt();
        }
        measured
    }
}

#[cfg(test)]
mod tests {
    use super::{Loss, MaskedError};
    use crate::networks::Meaning;

    fn all() -> impl Iterator<Item = MaskedError> {
        let meanings = [Meaning::DisparityShare { scale: 0.1 }, Meaning::Depth { farthest_m: 10.0 }];
        let losses = [Loss::InverseDepth, Loss::Depth, Loss::LogDepth];
        losses.into_iter().flat_map(move |loss| {
            meanings.map(|meaning| MaskedError { loss, meaning, cap_m: 80.0, knee: f32::INFINITY })
        })
    }

    fn log(loss: Loss) -> MaskedError {
        MaskedError { loss, meaning: Meaning::DisparityShare { scale: 0.1 }, cap_m: 80.0, knee: f32::INFINITY }
    }

    #[test]
    fn the_slope_is_the_derivative() {
        for error in all() {
            for (sample, share) in [(0.2_f32, 0.05_f32), (0.7, 0.01), (0.4, 0.09)] {
                let at = |sample: f32| error.add(&[sample], &[share], 0.3, &mut [0.0]).0;
                let step = 1e-3;
                let expected = (at(sample + step) - at(sample - step)) / f64::from(2.0 * step);
                let mut slope = [0.0];
                error.add(&[sample], &[share], 0.3, &mut slope);
                let slope = f64::from(slope[0] * error.unit());
                assert!(
                    (slope - expected).abs() < 0.01 * expected.abs().max(1e-3),
                    "{error:?}: {slope} for {expected}"
                );
            }
        }
    }

    #[test]
    fn the_loss_is_the_error_in_its_own_measure() {
        let share = log(Loss::InverseDepth);
        let (sum, count) = share.add(&[0.5, 0.1, 0.9], &[0.04, f32::NAN, 0.09], 1.0, &mut [0.0; 3]);
        assert!((sum - 0.01).abs() < 1e-6 && count == 2, "{sum} {count}");
        // depth = k / share: 0.4 / 0.05 = 8 m and 0.4 / 0.04 = 10 m; a share of 0.001 is 400 m, capped to 80.
        let depth = MaskedError { loss: Loss::Depth, ..share };
        let (sum, _) = depth.add(&[0.5, 0.5], &[0.04, 0.001], 0.4, &mut [0.0; 2]);
        assert!((sum - 74.0).abs() < 1e-4, "{sum}");
        assert!((log(Loss::LogDepth).add(&[0.5], &[0.1], 1.0, &mut [0.0]).0 - std::f64::consts::LN_2).abs() < 1e-6);
    }

    #[test]
    fn berhu_is_quadratic_beyond_its_knee() {
        // Laina et al. 2016, equation 2: |e| up to c, then (e^2 + c^2) / (2 c); its derivative is e / c.
        let berhu = MaskedError { knee: 0.5, ..log(Loss::LogDepth) };
        let pull = |ratio: f32| {
            let mut slope = [0.0];
            berhu.add(&[0.5 * ratio], &[0.05], 1.0, &mut slope);
            slope[0] * 0.5 * ratio
        };
        assert!((pull(1.4) - 1.0).abs() < 1e-5 && (pull(0.7) + 1.0).abs() < 1e-5, "ln 1.4 is below the knee");
        assert!((pull(4.0) - 4_f32.ln() / 0.5).abs() < 1e-4, "{}", pull(4.0));
        assert!((berhu.largest(&[0.5, 0.1, 0.9], &[0.05, 0.02, f32::NAN], 1.0) - 2_f32.ln()).abs() < 1e-5);
    }

    #[test]
    fn the_slopes_of_the_likelihood_are_its_weighted_derivatives() {
        let error = log(Loss::LogDepth);
        let loss = |map: f64, spread: f64| (map * 0.1 / 0.04).ln().abs() / spread + spread.ln();
        for (map, spread) in [(0.6_f64, 0.2_f64), (0.3, 0.9), (0.41, 0.05)] {
            let (mut by_map, mut by_spread, step) = ([0.0; 2], [1.0; 2], 1e-6);
            let (maps, spreads) = ([map as f32, 0.3], [spread as f32, 0.3]);
            let measured =
                error.add_likelihood([&maps, &spreads], &[0.04, f32::NAN], 1.0, [&mut by_map, &mut by_spread]);
            assert!(measured.1 == 1 && (measured.0 - (map * 2.5).ln().abs()).abs() < 1e-5);
            let root = spread.sqrt();
            let of_map = root * (loss(map + step, spread) - loss(map - step, spread)) / (2.0 * step);
            let of_spread = root * (loss(map, spread + step) - loss(map, spread - step)) / (2.0 * step);
            assert!((f64::from(by_map[0]) - of_map).abs() < 1e-3 * of_map.abs(), "{} for {of_map}", by_map[0]);
            assert!((f64::from(by_spread[0]) - of_spread).abs() < 1e-3 * of_spread.abs().max(1.0), "{}", by_spread[0]);
            assert_eq!((by_map[1], by_spread[1]), (0.0, 0.0));
        }
    }

    #[test]
    fn pixels_without_a_target_have_no_gradient() {
        for error in all() {
            let mut slopes = [1.0; 2];
            assert_eq!(error.add(&[0.3, 0.4], &[f32::NAN; 2], 1.0, &mut slopes), (0.0, 0));
            assert_eq!(slopes, [0.0; 2]);
        }
    }
}
