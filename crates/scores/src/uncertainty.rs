//! Metrics of a predicted uncertainty: does it match the error, and does it rank pixels by their error?
//!
//! `coverage` compares the error with a predicted standard deviation. `ause` is the area between two sparsification
//! curves (Ilg et al. 2018, "Uncertainty estimates and multi-hypotheses networks for optical flow"). It needs an order
//! of pixels only, so a confidence has it too.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Metric;

/// How sure an estimate is, by pixel: row-major, of the size of the estimate. A value that is not finite, or a negative
/// standard deviation, is unknown.
#[derive(Clone, Copy, Debug)]
pub enum Uncertainty<'a> {
    /// The predicted standard deviation of the estimate, metres.
    Deviation(&'a [f32]),
    /// A confidence; higher is surer.
    Confidence(&'a [f32]),
}

/// Whether an estimate comes with an uncertainty, and which. It decides which metrics can have a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UncertaintyKind {
    /// None.
    #[default]
    None,
    /// A standard deviation: `coverage`, `coverage_2`, `ause`.
    Deviation,
    /// A confidence: `ause`.
    Confidence,
}

impl UncertaintyKind {
    /// Whether a metric can have a value with this uncertainty.
    #[must_use]
    pub fn allows(self, metric: &Metric) -> bool {
        match metric.name {
            "coverage" | "coverage_2" => self == Self::Deviation,
            "ause" => self != Self::None,
            _ => true,
        }
    }
}

/// The error of a pixel in the sparsification curves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[schemars(description = "The error of the sparsification curves.")]
pub enum SparsificationError {
    /// `|y - t| / t`; of several pixels the mean.
    #[default]
    #[serde(rename = "abs_rel")]
    AbsoluteRelative,
    /// `|y - t|`, metres; of several pixels the root of the mean square.
    #[serde(rename = "rmse")]
    RootMeanSquare,
}

impl SparsificationError {
    /// What is averaged over pixels.
    fn summand(self, pixel: &UncertainPixel) -> f64 {
        let error = (pixel.estimate_m - pixel.ground_truth_m).abs();
        match self {
            Self::AbsoluteRelative => error / pixel.ground_truth_m,
            Self::RootMeanSquare => error * error,
        }
    }

    /// The error of pixels whose summands have this mean.
    fn of_mean(self, mean: f64) -> f64 {
        match self {
            Self::AbsoluteRelative => mean,
            Self::RootMeanSquare => mean.sqrt(),
        }
    }
}

/// How `ause` is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sparsification {
    /// The error of the curves.
    pub error: SparsificationError,
    /// The number of equal steps in which pixels are removed.
    pub steps: u32,
}

impl Default for Sparsification {
    fn default() -> Self {
        Self { error: SparsificationError::default(), steps: 100 }
    }
}

/// A scored pixel with a valid estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UncertainPixel {
    /// The ground truth, metres.
    pub ground_truth_m: f64,
    /// The estimate as it is scored (aligned, clamped), metres.
    pub estimate_m: f64,
    /// The predicted standard deviation, metres, or the negative of the confidence; infinite: unknown.
    pub uncertainty: f64,
}

/// The two sparsification curves of some pixels: point `k` of `n` is the error that remains after the share `k/n` of
/// the pixels was removed.
#[derive(Clone, Debug, PartialEq)]
pub struct SparsificationCurves {
    /// Pixels are removed by decreasing uncertainty.
    pub predicted: Vec<f64>,
    /// Pixels are removed by decreasing error: no order leaves less.
    pub oracle: Vec<f64>,
}

impl SparsificationCurves {
    /// The curves of some pixels; `None` without pixels.
    ///
    /// Pixels of equal uncertainty are removed as in the mean over all their orders: a group of which half is removed
    /// loses half of its summed error. An order by position would favour or punish an estimate by accident. A pixel of
    /// unknown uncertainty is removed first. Shares that are not a whole number of pixels remove a part of a pixel.
    #[must_use]
    pub fn new(pixels: &[UncertainPixel], settings: Sparsification) -> Option<Self> {
        let error = settings.error;
        let mut predicted: Vec<(f64, f64)> =
            pixels.iter().map(|pixel| (pixel.uncertainty, error.summand(pixel))).collect();
        // Stable: additions keep the order of pixels.
        predicted.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut oracle: Vec<(f64, f64)> = predicted.iter().map(|(_, error)| (*error, *error)).collect();
        oracle.sort_by(|a, b| b.0.total_cmp(&a.0));
        let curve = |ranked: &[(f64, f64)]| curve(ranked, settings);
        (!pixels.is_empty()).then(|| Self { predicted: curve(&predicted), oracle: curve(&oracle) })
    }

    /// The area between the curves, as a share of the error of all pixels: 0 is an order like the oracle's.
    ///
    /// The area is that of trapezoids over the shares 0 to 1. Both curves begin at the error of all pixels, and no
    /// error remains at their end. If the error of all pixels is 0, the area is 0.
    #[must_use]
    pub fn area(&self) -> f64 {
        let Some(&all) = self.predicted.first().filter(|all| **all > 0.0) else { return 0.0 };
        let between = self.predicted.iter().zip(&self.oracle).map(|(predicted, oracle)| (predicted - oracle) / all);
        between.sum::<f64>() / self.predicted.len() as f64
    }
}

/// What remains of pixels `(rank, summand)`, sorted by decreasing rank, at each step.
fn curve(ranked: &[(f64, f64)], settings: Sparsification) -> Vec<f64> {
    // Groups of equal rank: the first pixel, the number of pixels, the sum, and the sum of all later groups.
    let mut groups: Vec<(usize, usize, f64, f64)> = Vec::new();
    let mut end = ranked.len();
    let mut later = 0.0;
    for group in ranked.chunk_by(|a, b| a.0 == b.0).rev() {
        let sum: f64 = group.iter().map(|(_, summand)| summand).sum();
        end -= group.len();
        groups.push((end, group.len(), sum, later));
        later += sum;
    }
    groups.reverse();
    let mut group = 0;
    let remaining = |step: u32| {
        let removed = ranked.len() as f64 * f64::from(step) / f64::from(settings.steps);
        while group + 1 < groups.len() && groups[group + 1].0 as f64 <= removed {
            group += 1;
        }
        let (first, count, sum, later) = groups[group];
        let share = (removed - first as f64) / count as f64;
        settings.error.of_mean(((1.0 - share) * sum + later) / (ranked.len() as f64 - removed))
    };
    (0..settings.steps).map(remaining).collect()
}

/// The metrics of an uncertainty over some pixels.
#[derive(Clone, Debug)]
pub(crate) struct UncertaintyScores {
    coverage: f64,
    coverage_2: f64,
    ause: f64,
}

impl UncertaintyScores {
    /// Whether one of these metrics is requested.
    pub(crate) fn is_requested(metrics: &[&'static Metric]) -> bool {
        metrics.iter().any(|metric| !UncertaintyKind::None.allows(metric))
    }

    /// The metrics; all NaN without pixels, and the coverages NaN without standard deviations.
    pub(crate) fn new(pixels: &[UncertainPixel], kind: UncertaintyKind, settings: Sparsification) -> Self {
        let coverage = |deviations: f64| {
            let is_covered = |pixel: &&UncertainPixel| {
                let error = (pixel.estimate_m - pixel.ground_truth_m).abs();
                pixel.uncertainty.is_finite() && error <= deviations * pixel.uncertainty
            };
            match kind {
                UncertaintyKind::Deviation => pixels.iter().filter(is_covered).count() as f64 / pixels.len() as f64,
                UncertaintyKind::Confidence | UncertaintyKind::None => f64::NAN,
            }
        };
        let ause = SparsificationCurves::new(pixels, settings).map_or(f64::NAN, |curves| curves.area());
        Self { coverage: coverage(1.0), coverage_2: coverage(2.0), ause }
    }

    /// A metric, if it is one of these.
    pub(crate) fn score(&self, metric: &Metric) -> Option<f64> {
        Some(match metric.name {
            "coverage" => self.coverage,
            "coverage_2" => self.coverage_2,
            "ause" => self.ause,
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel(ground_truth_m: f64, estimate_m: f64, uncertainty: f64) -> UncertainPixel {
        UncertainPixel { ground_truth_m, estimate_m, uncertainty }
    }

    fn curves(pixels: &[UncertainPixel], steps: u32) -> SparsificationCurves {
        SparsificationCurves::new(pixels, Sparsification { steps, ..Sparsification::default() }).unwrap()
    }

    /// Errors of 10, 20, 30 and 40 %, with the best, the worst, and no order.
    #[test]
    fn four_pixels_by_hand() {
        let at = |uncertainties: [f64; 4]| {
            let pixels = [11.0, 12.0, 13.0, 14.0].iter().zip(uncertainties).map(|(y, u)| pixel(10.0, *y, u));
            curves(&pixels.collect::<Vec<_>>(), 4)
        };
        let close = |ours: &[f64], expected: [f64; 4]| {
            assert!(ours.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15), "{ours:?}, not {expected:?}");
        };
        let best = at([1.0, 2.0, 3.0, 4.0]);
        close(&best.oracle, [0.25, 0.2, 0.15, 0.1]);
        close(&best.predicted, [0.25, 0.2, 0.15, 0.1]);
        assert_eq!(best.area(), 0.0);
        let worst = at([4.0, 3.0, 2.0, 1.0]);
        close(&worst.predicted, [0.25, 0.3, 0.35, 0.4]);
        assert!((worst.area() - (0.1 + 0.2 + 0.3) / 0.25 / 4.0).abs() < 1e-15);
        // Without an order, what remains has the mean error, whatever the position of the pixels.
        let none = at([0.5; 4]);
        close(&none.predicted, [0.25; 4]);
        assert!((none.area() - (0.05 + 0.1 + 0.15) / 0.25 / 4.0).abs() < 1e-15);
    }

    #[test]
    fn steps_remove_parts_of_pixels() {
        // Of two pixels with errors 3 and 1, a quarter of all is half of the first.
        let two = curves(&[pixel(1.0, 4.0, 2.0), pixel(1.0, 2.0, 1.0)], 4);
        assert_eq!(two.predicted, [2.0, 2.5 / 1.5, 1.0, 1.0]);
    }

    #[test]
    fn unknown_uncertainties_are_least_sure_and_cover_nothing() {
        let pixels = [pixel(10.0, 12.0, f64::INFINITY), pixel(10.0, 12.0, 2.0), pixel(10.0, 12.0, 1.0)];
        let scores = UncertaintyScores::new(&pixels, UncertaintyKind::Deviation, Sparsification::default());
        assert_eq!(
            (scores.coverage, scores.coverage_2),
            (1.0 / 3.0, 2.0 / 3.0),
            "an error of one deviation is covered"
        );
        let scores = UncertaintyScores::new(&pixels, UncertaintyKind::Confidence, Sparsification::default());
        assert!(scores.coverage.is_nan() && scores.ause.abs() < 1e-15, "{}", scores.ause);
    }

    #[test]
    fn without_errors_or_pixels() {
        assert_eq!(curves(&[pixel(3.0, 3.0, 1.0), pixel(4.0, 4.0, 2.0)], 20).area(), 0.0);
        assert_eq!(SparsificationCurves::new(&[], Sparsification::default()), None);
        assert!(UncertaintyScores::new(&[], UncertaintyKind::Deviation, Sparsification::default()).coverage.is_nan());
    }
}
