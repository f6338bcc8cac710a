//! The formulas of metrics: from slices to a row, without polars and I/O.
//!
//! They are defined here once, for the node `score/depth` and for the analysis of recordings. All arithmetic is f64
//! with a fixed order of additions and [our own logarithm](ln), so that equal maps give equal bits on every machine.
//!
//! ```
//! use depthloom_scores::{PixelSet, Preset, score};
//!
//! let ground_truth_m = [10.0, 20.0, f32::NAN, 40.0]; // NaN: no ground truth
//! let estimate_m = [11.0, 26.0, 5.0, f32::NAN]; // NaN: invalid
//! let sets = [PixelSet::All, PixelSet::Valid];
//! let rows = score(&estimate_m, &ground_truth_m, 4, 1, &sets, &Preset::Martins2018.settings());
//! assert_eq!((rows[0].pixels, rows[1].pixels), (3, 2)); // the invalid pixel counts in `all` only
//! assert_eq!(rows[1].score("a1"), Some(0.5)); // 11/10 is within 1.25, 26/20 is not
//! ```

mod aligned;
mod crop;
mod disparity;
mod extra;
mod line;
mod ln;
mod metric;
mod params;
mod pixels;
mod preset;
pub mod quantile;
mod row;
mod score;
mod settings;
mod sums;
mod uncertainty;
mod zones;

pub use crop::{Crop, Window};
pub use disparity::{DisparityMaps, DisparityScores};
pub use line::Line;
pub use ln::{ln, logarithms};
pub use metric::{DEPTH, DISPARITY, Family, Mean, Metric, Pooling};
pub use params::{DisparityScoreParams, MetricNames, ScoreParams};
pub use pixels::{Alignment, DepthEstimate, ScoredPixels};
pub use preset::Preset;
pub use row::{PixelSet, ScoreRow};
pub use score::{DepthScores, score, score_pixels};
pub use settings::{Align, ScaleInvariant, Settings, SquaredRelative};
pub use uncertainty::{
    Sparsification, SparsificationCurves, SparsificationError, UncertainPixel, Uncertainty, UncertaintyKind,
};
pub use zones::{Clues, ZoneParams};
