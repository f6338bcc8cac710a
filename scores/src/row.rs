//! One row of scores: what a frame's estimate is worth on one set of pixels.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which pixels a score is taken over: in Table I, "Incl Occ" is `all` and "Non-occ only" is `answered`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(description = "Which pixels are scored.")]
pub enum PixelSet {
    /// Every true pixel; a missing answer counts as `missing_m`.
    All,
    /// The true pixels where the estimate answered.
    Answered,
}

impl PixelSet {
    /// The name used in YAML, in `scores.csv` and in recordings.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Answered => "answered",
        }
    }
}

impl fmt::Display for PixelSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The scores of one estimate on one frame and one pixel set; every score is NaN where no pixel counted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoreRow {
    /// The pixels scored over.
    pub set: PixelSet,
    /// How many pixels counted.
    pub pixels: u64,
    /// Share with `max(y/t, t/y) < 1.25`.
    pub a1: f64,
    /// Share with `max(y/t, t/y) < 1.25^2`.
    pub a2: f64,
    /// Share with `max(y/t, t/y) < 1.25^3`.
    pub a3: f64,
    /// Mean of `|y - t| / t`.
    pub abs_rel: f64,
    /// Mean of `(y - t)^2 / t`, metres (preset `kitti-depth` divides by `t^2`).
    pub sq_rel: f64,
    /// Root of the mean of `(y - t)^2`, metres.
    pub rmse: f64,
    /// Root of the mean of `(ln y - ln t)^2`.
    pub rmse_log: f64,
    /// Scale-invariant log error; the formula is the preset's.
    pub silog: f64,
}

/// The names of the eight scores, in the order of Table I and of `scores.csv`.
pub const SCORE_NAMES: [&str; 8] = ["a1", "a2", "a3", "abs_rel", "sq_rel", "rmse", "rmse_log", "silog"];

impl ScoreRow {
    /// The eight scores in the order of [`SCORE_NAMES`].
    #[must_use]
    pub const fn scores(&self) -> [f64; 8] {
        [self.a1, self.a2, self.a3, self.abs_rel, self.sq_rel, self.rmse, self.rmse_log, self.silog]
    }
}
