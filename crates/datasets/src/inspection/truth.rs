//! Checks ground truth, by itself and against the images.

use depthloom_graphs::Value;
use depthloom_graphs::values::{Calibration, Raster};

use super::votes::{Pixels, Votes};
use super::{Contradiction, FEWEST};

pub(super) enum Truth<'a> {
    /// Metres.
    Depth(&'static str, &'a Raster<f32>),
    /// Pixels.
    Disparity(&'static str, &'a Raster<f32>),
}

const UNIT: &str = "is it the unit, or what its numbers are multiplied by: metres for millimetres, disparity * 256 for disparity, 8 bits for 16?";

/// Correlation of true and seen distances below which the ground truth contradicts the images.
const AGAINST: f64 = -0.4;
/// Smallest standard deviation of log distances for a verdict.
const SPREAD: f64 = 0.1;

impl<'a> Truth<'a> {
    pub(super) fn from_value(port: &'static str, value: &'a Value) -> Option<Self> {
        match value {
            Value::Depth(depth) => Some(Self::Depth(port, &depth.metres)),
            Value::TrueDisparity(disparity) => Some(Self::Disparity(port, &disparity.px)),
            _ => None,
        }
    }

    pub(super) const fn is_depth(&self) -> bool {
        matches!(self, Self::Depth(..))
    }

    /// `is_disparity`: the depth was computed from a disparity of the same frame.
    pub(super) fn fault(
        &self,
        calibration: Option<&Calibration>,
        votes: Option<&Votes>,
        is_disparity: bool,
    ) -> Option<Contradiction> {
        let (Self::Depth(port, map) | Self::Disparity(port, map)) = self;
        let mut known: Vec<f32> = map.iter().copied().filter(|of| of.is_finite()).collect();
        if known.is_empty() {
            return Some(Contradiction {
                port,
                what: "the ground truth has no known pixel".to_owned(),
                remedy: "every number in it is 0, or none: take the file from where it came from, or the frame out (`frames:`)",
            });
        }
        if known.len() < FEWEST {
            return None;
        }
        let seen = votes.map_or_else(Vec::new, |votes| self.beside(votes, calibration.map_or(0.0, |of| of.doffs_px)));
        if let Some(against) = against(&seen).filter(|of| *of < AGAINST) {
            let count = seen.len();
            let looks = match is_disparity {
                true => "its numbers look like depths, and are read as disparities",
                false => "its numbers look like disparities instead of depths, or like depths instead of disparities",
            };
            let what = format!(
                "the ground truth contradicts the images: at {count} places that both show it is far where they say near (correlation {against:.2}); {looks}"
            );
            let remedy = "set the unit of its numbers (source `images`: `ground_truth: { unit: pixels }`, `metres` or `millimetres`), or use the right ground truth";
            return Some(Contradiction { port, what, remedy });
        }
        match (self, calibration) {
            (Self::Depth(..), Some(calibration)) => self.implausible(&mut known, calibration, &seen),
            (Self::Disparity(..), _) => self.of_other_scale(&seen, 0.0, |px| format!("{px:.1} px"), &mut known),
            _ => None,
        }
    }

    fn implausible(&self, known: &mut [f32], of: &Calibration, seen: &[(f64, f64)]) -> Option<Contradiction> {
        let scaled = self.of_other_scale(seen, of.focal_baseline_px_m().ln(), |metres| format!("{metres:.3} m"), known);
        if scaled.is_some() {
            return scaled;
        }
        let (Self::Depth(port, map) | Self::Disparity(port, map)) = self;
        let median = median_of(known);
        let width = f64::from(map.width());
        let disparity = of.disparity_px(median);
        let what = match () {
            () if !(0.02..=1000.0).contains(&median) => {
                format!("half of the ground-truth depths are beyond {median:.4} m")
            }
            () if disparity > 0.5 * width => {
                format!(
                    "the median of the ground-truth depths, {median:.4} m, is a disparity of {disparity:.0} px of an image {width} px wide"
                )
            }
            () => return None,
        };
        Some(Contradiction { port, what, remedy: UNIT })
    }

    fn of_other_scale(
        &self,
        seen: &[(f64, f64)],
        ln: f64,
        shown: impl Fn(f64) -> String,
        known: &mut [f32],
    ) -> Option<Contradiction> {
        let (Self::Depth(port, _) | Self::Disparity(port, _)) = self;
        let mut factors: Vec<f64> = seen.iter().map(|(truth, seen)| (truth - seen - ln).exp()).collect();
        let count = factors.len();
        if count < FEWEST {
            return None;
        }
        let near = factors.iter().filter(|factor| (0.5..=2.0).contains(*factor)).count();
        let factor = *factors.select_nth_unstable_by(count / 2, f64::total_cmp).1;
        (5 * near < count && !(0.5..=2.0).contains(&factor)).then(|| {
            let at = shown(median_of(known));
            let what = format!(
                "the ground truth does not fit the images: at {count} places that both images show it is {factor:.3} times as far as their disparity states \
                 (by median), at {at}"
            );
            Contradiction { port, what, remedy: UNIT }
        })
    }

    /// Logarithms of true distances and of the distances that the images show (1 / px), where both are known.
    fn beside(&self, votes: &Votes, doffs_px: f64) -> Vec<(f64, f64)> {
        let (Self::Depth(_, map) | Self::Disparity(_, map)) = self;
        let distance = |value: f32| match self {
            Self::Depth(..) => f64::from(value),
            Self::Disparity(..) => 1.0 / f64::from(value),
        };
        let one = |(pixels, disparity): (Pixels, f64)| {
            let nearest = pixels.map(|(x, y)| distance(map.get_pixel(x, y).0[0])).fold(f64::NAN, f64::min);
            let seen = 1.0 / (disparity + doffs_px);
            let are_known = nearest.is_finite() && nearest > 0.0 && seen.is_finite() && seen > 0.0;
            are_known.then(|| (nearest.ln(), seen.ln()))
        };
        votes.places(map.dimensions()).filter_map(one).collect()
    }
}

/// Correlation of true and seen distances; `None` with too few places or without spread.
fn against(seen: &[(f64, f64)]) -> Option<f64> {
    let count = seen.len();
    if count < FEWEST {
        return None;
    }
    let mean = |of: fn(&(f64, f64)) -> f64| seen.iter().map(of).sum::<f64>() / count as f64;
    let (x, y) = (mean(|of| of.0), mean(|of| of.1));
    let sum = |of: &dyn Fn(f64, f64) -> f64| seen.iter().map(|at| of(at.0 - x, at.1 - y)).sum::<f64>() / count as f64;
    let (xx, yy, xy) = (sum(&|x, _| x * x), sum(&|_, y| y * y), sum(&|x, y| x * y));
    (xx.sqrt() > SPREAD && yy.sqrt() > SPREAD).then(|| xy / (xx * yy).sqrt())
}

fn median_of(known: &mut [f32]) -> f64 {
    let middle = known.len() / 2;
    f64::from(*known.select_nth_unstable_by(middle, f32::total_cmp).1)
}
