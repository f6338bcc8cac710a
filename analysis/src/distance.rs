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
mod samples;
mod selection;
mod sorting;
mod spill;

pub(crate) use samples::{FrameSamples, Samples};

use crate::estimators::Estimator;
use crate::sheet::{Cells, Sheet};

/// The percentiles taken.
pub const PERCENTILES: [u32; 5] = [5, 25, 50, 75, 95];
/// True distances from here on are left out, metres: counting takes room for every metre up to the farthest.
pub(crate) const FARTHEST_M: u32 = 4096;

/// Absolute errors of an estimator in one metre of true distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceBin {
    /// Index of the estimator.
    pub estimator: usize,
    /// The bin holds true distances from this many metres up to, not including, one metre more.
    pub bin_m: u32,
    /// Over all pixels that the estimator answered.
    pub answered: Spread,
    /// Over those of them that all it is compared with answered too; `None` if there is none.
    pub shared: Option<Spread>,
}

/// How absolute errors spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// How many pixels; at least one.
    pub count: u64,
    /// The [`PERCENTILES`] of the absolute error, metres.
    pub percentiles_m: [f64; 5],
}

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

/// Where a percentile lies among `count` sorted samples: the rank below it, and how far it is from there to the next.
fn position(percentile: u32, count: u64) -> (u64, f64) {
    let exact = f64::from(percentile) / 100.0 * (count - 1) as f64;
    (exact.floor() as u64, exact - exact.floor())
}

/// The percentile between its two neighbours among sorted samples.
fn between(lower: f32, upper: f32, share: f64) -> f64 {
    let (lower, upper) = (f64::from(lower), f64::from(upper));
    lower + (upper - lower) * share
}
