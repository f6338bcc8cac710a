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

use crate::estimators::{Estimator, estimator_columns};
use crate::tables::{COMMON, Cells, Column, Rows, Table};

/// What a row is of, `bin_from_m, bin_to_m, count, error_p5_m ... error_p95_m`: estimator by estimator, first on the pixels that each answered
/// (`set` is `answered`), then on those that all answered (`common`). `origin` goes into the metadata.
pub(crate) fn table_of_bins(bins: &[DistanceBin], estimators: &[Estimator], origin: &Origin) -> Table {
    let mut rows: Vec<(&Estimator, &str, u32, Spread)> = Vec::new();
    for of_one in bins.chunk_by(|a, b| a.estimator == b.estimator) {
        let row = |bin: &DistanceBin, set, spread| (&estimators[bin.estimator], set, bin.bin_m, spread);
        rows.extend(of_one.iter().map(|bin| row(bin, PixelSet::Answered.name(), bin.answered)));
        rows.extend(of_one.iter().filter_map(|bin| Some(row(bin, COMMON, bin.shared?))));
    }
    let cells = Rows(&rows);
    let mut columns = estimator_columns(&rows, |(estimator, set, ..)| (*estimator, *set), None);
    columns.extend(bin_columns(rows.iter().map(|(_, _, metre, _)| *metre)));
    columns.push(cells.count("count", |(.., spread)| spread.count).unit("pixels"));
    columns.extend(PERCENTILES.into_iter().enumerate().map(|(i, percentile)| {
        cells.number(format!("error_p{percentile}_m"), |(.., spread)| spread.percentiles_m[i]).unit("m")
    }));
    Table { metadata: vec![(ORIGIN, origin.json())], ..Table::new(columns) }
}

/// The edges of bins of a metre of true distance: from the first up to, not including, the second.
pub(crate) fn bin_columns(metres: impl Iterator<Item = u32> + Clone) -> [Column; 2] {
    let column = |name: &str, metres| Column::new(name, Cells::Metres(metres)).unit("m");
    [column("bin_from_m", metres.clone().collect()), column("bin_to_m", metres.map(|metre| metre + 1).collect())]
}
