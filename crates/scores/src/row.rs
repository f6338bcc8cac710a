//! One row of metrics: of a frame's estimate on one pixel set.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Metric;

/// The pixels over which a metric is computed: in Table I, "Incl Occ" is `all` and "Non-occ only" is `valid`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(description = "Which pixels are scored.")]
pub enum PixelSet {
    /// Every pixel with ground truth; an invalid pixel counts as `missing_m`, of disparities as wrong.
    All,
    /// The pixels with ground truth on which the estimate is valid.
    Valid,
    /// Of disparities: every pixel with ground truth, after the benchmark's own filling of invalid pixels.
    Filled,
}

impl PixelSet {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::All, Self::Valid, Self::Filled];

    /// The name used in YAML, in `scores.csv` and in recordings.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Valid => "valid",
            Self::Filled => "filled",
        }
    }

    /// The set of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|set| set.name() == name)
    }
}

impl fmt::Display for PixelSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The scores of one estimate on one frame, in one zone of the image, on one pixel set.
#[derive(Clone, Debug, PartialEq)]
pub struct ScoreRow {
    /// The pixels scored over.
    pub set: PixelSet,
    /// The part of the image; empty: the whole one.
    pub zone: String,
    /// How many pixels counted.
    pub pixels: u64,
    /// Pixels with ground truth of the zone, after bounds and crop; 0 in a recording that does not say.
    pub truth: u64,
    /// Of these, the number on which the estimate is valid; 0 in a recording that does not say.
    pub valid: u64,
    /// Mean of the log error: with it `silog` can be pooled over frames. `None` where no pixel counted or no logarithm
    /// was taken.
    pub log_mean: Option<f64>,
    /// The requested metrics in the catalogue's order; a metric without a value is left out, because no pixel counted.
    pub scores: Vec<(&'static Metric, f64)>,
}

impl ScoreRow {
    /// A row without pixels.
    #[must_use]
    pub fn new(set: PixelSet, zone: &str) -> Self {
        Self { set, zone: zone.to_owned(), pixels: 0, truth: 0, valid: 0, log_mean: None, scores: Vec::new() }
    }

    /// The row with one more metric at the end; a value that is not a number is left out.
    #[must_use]
    pub fn with(mut self, metric: &'static Metric, value: f64) -> Self {
        if !value.is_nan() {
            self.scores.push((metric, value));
        }
        self
    }

    /// The value of a metric, if it was requested and a pixel counted.
    #[must_use]
    pub fn get(&self, metric: &Metric) -> Option<f64> {
        self.scores.iter().find(|(of, _)| of.name == metric.name).map(|(_, value)| *value)
    }

    /// The value of the metric of that name, if it was requested and a pixel counted.
    #[must_use]
    pub fn score(&self, name: &str) -> Option<f64> {
        self.get(Metric::named(name)?)
    }

    /// The share of pixels with ground truth that are valid; `None` without such pixels, or if the recording does not
    /// state it.
    #[must_use]
    pub fn density(&self) -> Option<f64> {
        (self.truth > 0).then(|| self.valid as f64 / self.truth as f64)
    }
}
