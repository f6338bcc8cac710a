//! Absolute error against true distance: the paper's figure, as numbers.
//!
//! Per estimator, the samples are the scored pixels with an answer, of all frames: the truth `t`, and `e = |y - t|` of the
//! estimate as it is scored (median scaled if asked for, clamped). Per metre `floor(t)` of true distance: how many there are,
//! and the percentiles 5, 25, 50, 75 and 95 of `e` by linear interpolation (numpy's default; polars' default is `nearest`).
//!
//! The percentiles are exact, and memory is bounded whatever the number of frames: [`Samples`] says how.

mod in_memory;
mod samples;
mod selection;

use polars::frame::DataFrame;
use polars::prelude::{Column, NamedFrom, Series};

pub(crate) use samples::{FrameSamples, Samples};

use crate::error::AnalysisError;
use crate::estimators::Estimator;

/// The percentiles taken.
pub const PERCENTILES: [u32; 5] = [5, 25, 50, 75, 95];

/// Absolute errors of an estimator in one metre of true distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceBin {
    /// Index of the estimator.
    pub estimator: usize,
    /// The bin holds true distances from this many metres up to, not including, one metre more.
    pub bin_m: u32,
    /// How many pixels.
    pub count: u64,
    /// The [`PERCENTILES`] of the absolute error, metres.
    pub percentiles_m: [f64; 5],
}

/// `estimator, bin_m, count, p5, p25, p50, p75, p95`, in the order given.
pub(crate) fn table_of_bins(bins: &[DistanceBin], estimators: &[Estimator]) -> Result<DataFrame, AnalysisError> {
    let labels: Vec<&str> = bins.iter().map(|bin| estimators[bin.estimator].label.as_str()).collect();
    let mut columns = vec![
        Column::from(Series::new("estimator".into(), labels)),
        Column::from(Series::new("bin_m".into(), bins.iter().map(|bin| bin.bin_m).collect::<Vec<_>>())),
        Column::from(Series::new("count".into(), bins.iter().map(|bin| bin.count).collect::<Vec<_>>())),
    ];
    for (i, percentile) in PERCENTILES.into_iter().enumerate() {
        let errors: Vec<f64> = bins.iter().map(|bin| bin.percentiles_m[i]).collect();
        columns.push(Column::from(Series::new(format!("p{percentile}").into(), errors)));
    }
    DataFrame::new(bins.len(), columns).map_err(AnalysisError::compute("error against distance"))
}
