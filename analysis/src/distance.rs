//! Absolute error against true distance: the paper's figure, as numbers.
//!
//! Per estimator, the samples are the scored pixels with an answer, of all frames: the truth `t`, and `e = |y - t|` of the
//! estimate as it is scored (median scaled if asked for, clamped). Per metre `floor(t)` of true distance: how many there are,
//! and the percentiles 5, 25, 50, 75 and 95 of `e` by linear interpolation (numpy's default).
//!
//! An estimator that answers the easy pixels only would win against one that answers all. So the same is taken once more over
//! the **shared** pixels: those that every estimator with the same truth and settings answered, on frames that all of them have.
//!
//! Of estimates that have not changed since an earlier run the bins are those of [its report](EarlierBins).
//!
//! The percentiles are exact, and memory is bounded whatever the number of frames: [`Samples`] says how.

mod earlier;
mod in_memory;
mod inputs;
mod sample;
mod samples;
mod selection;
mod sorting;
mod spill;
mod spread;

use earlier::ORIGIN;
pub(crate) use earlier::{EarlierBins, Origin};
pub(crate) use inputs::{Input, inputs};
pub(crate) use samples::{FARTHEST_M, FrameSamples, Samples};
pub use spread::{DistanceBin, PERCENTILES, Spread};

use depthloom_scores::PixelSet;

use crate::estimators::Estimator;
use crate::leading::{COMMON, sheet_of_estimators};
use crate::sheet::{Cells, Sheet};

/// What a row is of, `bin_from_m, bin_to_m, count, error_p5_m ... error_p95_m`: estimator by estimator, first on the pixels that each answered
/// (`set` is `answered`), then on those that all answered (`common`). `origin` goes into the metadata.
pub(crate) fn table_of_bins<'a>(bins: &[DistanceBin], estimators: &'a [Estimator], origin: &Origin) -> Sheet<'a> {
    let mut rows: Vec<(&Estimator, &str, u32, Spread)> = Vec::new();
    for of_one in bins.chunk_by(|a, b| a.estimator == b.estimator) {
        let row = |bin: &DistanceBin, set, spread| (&estimators[bin.estimator], set, bin.bin_m, spread);
        rows.extend(of_one.iter().map(|bin| row(bin, PixelSet::Answered.name(), bin.answered)));
        rows.extend(of_one.iter().filter_map(|bin| Some(row(bin, COMMON, bin.shared?))));
    }
    let of: Vec<(&Estimator, &str)> = rows.iter().map(|(estimator, set, ..)| (*estimator, *set)).collect();
    let mut table = sheet_of_estimators(&of, [])
        .with_metadata(ORIGIN, origin.json())
        .with_bins(&rows.iter().map(|(_, _, metre, _)| *metre).collect::<Vec<_>>())
        .with_unit("count", "pixels", Cells::Count(rows.iter().map(|(.., spread)| spread.count).collect()));
    for (i, percentile) in PERCENTILES.into_iter().enumerate() {
        let errors = rows.iter().map(|(.., spread)| Some(spread.percentiles_m[i]));
        table = table.with_unit(format!("error_p{percentile}_m"), "m", Cells::Number(errors.collect()));
    }
    table
}

impl Sheet<'_> {
    /// Adds the edges of bins of a metre of true distance: from the first up to, not including, the second.
    pub(crate) fn with_bins(self, metres: &[u32]) -> Self {
        self.with_unit("bin_from_m", "m", Cells::Metres(metres.to_vec())).with_unit(
            "bin_to_m",
            "m",
            Cells::Metres(metres.iter().map(|metre| metre + 1).collect()),
        )
    }
}
