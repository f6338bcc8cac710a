//! Absolute error against true distance: the paper's figure, as numbers.
//!
//! Per estimator, the samples are the scored pixels with an answer, of all frames: the truth `t`, and `e = |y - t|` of the
//! estimate as it is scored (median scaled if asked for, clamped). Per metre `floor(t)` of true distance: how many there are,
//! and the percentiles 5, 25, 50, 75 and 95 of `e` by linear interpolation (numpy's default).
//!
//! An estimator that answers the easy pixels only would win against one that answers all. So the same is taken once more over
//! the **shared** pixels: those that every estimator with the same truth and settings answered, on frames that all of them have.
//!
//! The percentiles are exact, and memory is bounded whatever the number of frames: [`Samples`] says how.

mod in_memory;
mod sample;
mod samples;
mod selection;
mod sorting;
mod spill;
mod spread;

pub(crate) use samples::{FARTHEST_M, FrameSamples, Samples};
pub use spread::{DistanceBin, PERCENTILES, Spread};

use crate::estimators::Estimator;
use crate::sheet::{Cells, Sheet};

/// `estimator, bin_m, count, p5, p25, p50, p75, p95`, then the same of the shared pixels, in the order given.
pub(crate) fn table_of_bins<'a>(bins: &[DistanceBin], estimators: &'a [Estimator]) -> Sheet<'a> {
    let labels = bins.iter().map(|bin| estimators[bin.estimator].label.as_str());
    let mut table = Sheet::new()
        .with("estimator", Cells::Text(labels.collect()))
        .with("bin_m", Cells::Metres(bins.iter().map(|bin| bin.bin_m).collect()))
        .with("count", Cells::Count(bins.iter().map(|bin| bin.answered.count).collect()));
    for (i, percentile) in PERCENTILES.into_iter().enumerate() {
        let errors = bins.iter().map(|bin| Some(bin.answered.percentiles_m[i]));
        table = table.with(format!("p{percentile}"), Cells::Number(errors.collect()));
    }
    let counts = bins.iter().map(|bin| bin.shared.map_or(0, |shared| shared.count));
    table = table.with("shared_count", Cells::Count(counts.collect()));
    for (i, percentile) in PERCENTILES.into_iter().enumerate() {
        let errors = bins.iter().map(|bin| bin.shared.map(|shared| shared.percentiles_m[i]));
        table = table.with(format!("shared_p{percentile}"), Cells::Number(errors.collect()));
    }
    table
}
