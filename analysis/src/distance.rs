//! Absolute error against ground-truth distance, per metre: counts and percentiles of the errors, computed by the
//! [query engine](crate::query).
//!
//! There are two pixel sets: the valid pixels of an estimate, and the *shared* pixels, which are valid in all estimates
//! with the same ground truth and settings. An estimate that is valid only on easy pixels would win on its own set.

mod earlier;
mod inputs;
mod maps;
mod metres;
mod sample;
mod samples;
mod selection;
mod sink;
mod sorting;
mod spill;
mod unchanged;

use std::collections::BTreeMap;
use std::path::PathBuf;

use depthloom_graphs::plan::RunId;
use depthloom_recording::{RecordedPlan, Recording};
use depthloom_scores::PixelSet;

use self::earlier::{ORIGIN, Origin};
use self::maps::CollectedSamples;
use self::samples::Samples;
pub use self::sink::{RecordedSamples, SampleSink};
use crate::error::AnalysisError;
use crate::estimates::{Estimate, estimate_columns};
use crate::files::Output;
use crate::tables::{COMMON, Cells, Column, RowKey, RowKeys, Rows, Table, key_columns};

/// The computed percentiles.
pub const PERCENTILES: [u32; 5] = [5, 25, 50, 75, 95];
/// Pixels at this ground-truth distance or beyond are excluded, metres: counting needs memory for every metre.
pub(crate) const FARTHEST_M: u32 = 4096;

/// Absolute errors of an estimate in one metre of ground-truth distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceBin {
    /// Index of the estimate.
    pub estimate: usize,
    /// The bin covers ground-truth distances from this many metres up to, but not including, one metre more.
    pub bin_m: u32,
    /// Over the valid pixels of the estimate.
    pub valid: Spread,
    /// Over the pixels that are valid in all compared estimates; `None` without such pixels.
    pub shared: Option<Spread>,
}

/// The distribution of absolute errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The number of pixels, at least one.
    pub count: u64,
    /// The [`PERCENTILES`] of the absolute error, metres.
    pub percentiles_m: [f64; 5],
}

/// Error against distance, and the number of pixels with ground truth in each metre.
pub(crate) struct Distances {
    /// Sorted by estimate, then by metre.
    pub(crate) bins: Vec<DistanceBin>,
    /// For each estimate, the number of pixels that were excluded because they are beyond [`FARTHEST_M`].
    pub(crate) beyond: Vec<u64>,
    /// Scored pixels with ground truth by stage run and metre, over the frames with recorded values. Each ground truth
    /// counts once.
    truth: BTreeMap<(RunId, u32), u64>,
}

/// Computes the error against distance of a recording, and its table. The maps of frames with `recorded` samples are
/// not read. The bins of equal maps are reused from one of the `reports` of earlier runs, given by their folders.
pub(crate) fn distances(
    recording: &Recording,
    estimates: &[Estimate],
    samples_in_memory: usize,
    recorded: Option<RecordedSamples<'_>>,
    reports: &[PathBuf],
    output: Output<'_>,
) -> Result<(Distances, Table), AnalysisError> {
    let inputs = inputs::inputs(recording, estimates)?;
    let distances = match unchanged::distances(recording, estimates, &inputs, reports, samples_in_memory, output)? {
        Some(distances) => distances,
        None => {
            let none = || CollectedSamples::empty(Samples::new(estimates.len(), samples_in_memory, output));
            let collected = recorded.map_or_else(none, |recorded| recorded.0);
            maps::distances(recording, estimates, |_| true, output, collected)?
        }
    };
    let origin = Origin::new(&distances.bins, &inputs, &distances.beyond);
    let table = distances.table(estimates, &origin);
    Ok((distances, table))
}

impl Distances {
    /// Pixels with ground truth by metre, over all stages.
    pub(crate) fn truth_of_all(&self) -> BTreeMap<u32, u64> {
        let mut all = BTreeMap::new();
        self.truth.iter().for_each(|((_, metre), count)| *all.entry(*metre).or_default() += count);
        all
    }

    /// The table `true_distances.csv`.
    pub(crate) fn table_of_truth(&self, plan: &RecordedPlan) -> Table {
        let keys = RowKeys::new(plan);
        let key = |run: RunId| keys.for_variants(&plan.runs[run].stage, &plan.runs[run].variants);
        let rows: Vec<(RowKey, u64)> = self.truth.iter().map(|((run, _), count)| (key(*run), *count)).collect();
        let mut columns = key_columns(&rows, |(key, _)| key, Vec::new());
        columns.extend(bin_columns(self.truth.keys().map(|(_, metre)| *metre)));
        columns.push(Rows(&rows).count("count", |(_, count)| *count).unit("pixels"));
        Table::new(columns)
    }

    /// The table `error_vs_distance`: estimate by estimate, first on the valid pixels of each (`valid`), then on the
    /// shared ones.
    fn table(&self, estimates: &[Estimate], origin: &Origin) -> Table {
        let mut rows: Vec<(&Estimate, &str, u32, Spread)> = Vec::new();
        for bins in self.bins.chunk_by(|a, b| a.estimate == b.estimate) {
            let row = |bin: &DistanceBin, set, spread| (&estimates[bin.estimate], set, bin.bin_m, spread);
            rows.extend(bins.iter().map(|bin| row(bin, PixelSet::Valid.name(), bin.valid)));
            rows.extend(bins.iter().filter_map(|bin| Some(row(bin, COMMON, bin.shared?))));
        }
        let cells = Rows(&rows);
        let mut columns = estimate_columns(&rows, |(estimate, set, ..)| (*estimate, *set), None);
        columns.extend(bin_columns(rows.iter().map(|(_, _, metre, _)| *metre)));
        columns.push(cells.count("count", |(.., spread)| spread.count).unit("pixels"));
        columns.extend(PERCENTILES.into_iter().enumerate().map(|(i, percentile)| {
            cells.number(format!("error_p{percentile}_m"), |(.., spread)| spread.percentiles_m[i]).unit("m")
        }));
        Table { metadata: vec![(ORIGIN, origin.json())], ..Table::new(columns) }
    }
}

/// The edges of one-metre bins of ground-truth distance. The upper edge is excluded.
fn bin_columns(metres: impl Iterator<Item = u32> + Clone) -> [Column; 2] {
    let column = |name: &str, metres| Column::new(name, Cells::Metres(metres)).unit("m");
    [column("bin_from_m", metres.clone().collect()), column("bin_to_m", metres.map(|metre| metre + 1).collect())]
}
