//! How metrics are computed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Crop;

/// How metrics are computed: which pixels count, how the estimate is prepared, and which of two formulas of one name
/// applies.
///
/// In this order: the ground truth is masked by `min_m < t < max_m`, both strict, and by the crop; the valid estimates
/// are aligned if requested; they are clamped to `[min_m, max_m]` last. An invalid pixel then counts as `missing_m`,
/// without clamping, in the set `all`; in the set `valid` it does not count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Ground truth above this is scored, and estimates below are raised to it; metres.
    pub min_m: f64,
    /// Ground truth below this is scored, and estimates above are lowered to it; metres.
    pub max_m: f64,
    /// The value of an invalid pixel in the set `all`; metres.
    pub missing_m: f64,
    /// The part of the image that is scored.
    pub crop: Crop,
    /// How estimates without a scale are aligned, frame by frame.
    pub align: Align,
    /// The formula of `sq_rel`.
    pub sq_rel: SquaredRelative,
    /// The formula of `silog`.
    pub silog: ScaleInvariant,
}

/// How estimates without a scale are aligned, frame by frame, before they are clamped. The fit uses the valid scored
/// pixels of the whole image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(description = "How estimates without a scale are aligned, frame by frame.")]
pub enum Align {
    /// Nothing: estimates are metres.
    #[default]
    None,
    /// Multiplied by `median(truth) / median(estimate)` (Zhou et al. 2017, monodepth2).
    Median,
    /// `1/y` becomes `s/y + b`, with the `s` and `b` of least squares against `1/t`, as MiDaS does in inverse depth
    /// (Ranftl et al. 2020). A result at infinity or beyond becomes `max_m`.
    ScaleAndShift,
}

impl Align {
    /// The name used in YAML.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Median => "median",
            Self::ScaleAndShift => "scale-and-shift",
        }
    }
}

/// The two formulas that go by "squared relative difference": the first is Eigen's, monodepth's and nearly all papers';
/// the second the KITTI depth devkit's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(description = "What `sq_rel` is.")]
pub enum SquaredRelative {
    /// `mean((y - t)^2 / t)`, metres.
    #[default]
    ByTruth,
    /// `mean((y - t)^2 / t^2)`.
    ByTruthSquared,
}

/// The two formulas that go by "scale-invariant log error", with `e = ln y - ln t`: half the variance, as in Table I of
/// Martins et al. 2018; and that of the KITTI depth leaderboard and BTS.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(description = "What `silog` is, with `e = ln y - ln t`.")]
pub enum ScaleInvariant {
    /// `1/2N sum (e - mean e)^2`.
    #[default]
    HalfVariance,
    /// `100 sqrt(1/N sum (e - mean e)^2)`.
    HundredDeviation,
}

impl Settings {
    /// What differs between tables that look alike, for a caption: bounds, crop, alignment.
    #[must_use]
    pub fn in_words(&self) -> String {
        let mut text = format!("ground truth from {} to {} m", self.min_m, self.max_m);
        match self.crop {
            Crop::None => {}
            Crop::Garg => text.push_str(", Garg crop"),
            Crop::Eigen => text.push_str(", Eigen crop"),
        }
        match self.align {
            Align::None => {}
            Align::Median => text.push_str(", scaled to the median of the ground truth, frame by frame"),
            Align::ScaleAndShift => {
                text.push_str(", scale and shift of inverse depth fitted to the ground truth, frame by frame");
            }
        }
        text
    }

    /// Whether these settings can be scored with.
    ///
    /// # Errors
    /// The setting at fault, by its field's name, and why.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        let positive = |metres: f64| metres.is_normal() && metres > 0.0;
        if !positive(self.min_m) {
            return Err(("min_m", format!("must be a positive distance in metres, not {}", self.min_m)));
        }
        if !positive(self.max_m) || self.max_m <= self.min_m {
            return Err(("max_m", format!("must be above min_m ({} m), not {}", self.min_m, self.max_m)));
        }
        if !positive(self.missing_m) {
            return Err(("missing_m", format!("must be a positive distance in metres, not {}", self.missing_m)));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::Preset;

    #[test]
    fn alignment_is_named_in_the_caption() {
        let paper = Preset::Martins2018.settings();
        assert_eq!(paper.in_words(), "ground truth from 0.001 to 80 m");
        let words = crate::Settings { align: crate::Align::ScaleAndShift, ..paper }.in_words();
        assert!(words.contains("scale and shift of inverse depth"), "{words}");
        let words = Preset::Monodepth2.settings().in_words();
        assert_eq!(
            words,
            "ground truth from 0.001 to 80 m, Garg crop, scaled to the median of the ground truth, frame by frame"
        );
    }

    #[test]
    fn settings_without_a_logarithm_are_refused_by_name() {
        let fine = Preset::Martins2018.settings();
        assert_eq!(fine.check(), Ok(()));
        let at_fault = |settings: crate::Settings| settings.check().unwrap_err().0;
        assert_eq!(at_fault(crate::Settings { min_m: 0.0, ..fine }), "min_m");
        assert_eq!(at_fault(crate::Settings { max_m: f64::INFINITY, ..fine }), "max_m");
        assert_eq!(at_fault(crate::Settings { max_m: 1e-4, ..fine }), "max_m");
        assert_eq!(at_fault(crate::Settings { missing_m: f64::NAN, ..fine }), "missing_m");
    }
}
