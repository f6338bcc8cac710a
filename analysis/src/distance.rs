//! Absolute error against true distance, per metre: counts and percentiles of the errors, by the [query
//! engine](crate::query).
//!
//! Two pixel sets: those for which an estimate is valid, and the *shared* ones, for which all estimates with the same
//! ground truth and settings are. An estimate that is valid on easy pixels only would win on its own set.

mod earlier;
mod inputs;
mod maps;
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
use self::maps::Taken;
use self::samples::Samples;
pub use self::sink::{RecordedSamples, SampleSink};
use crate::error::AnalysisError;
use crate::estimates::{Estimate, estimate_columns};
use crate::files::Output;
use crate::tables::{COMMON, Cells, Column, RowKey, RowKeys, Rows, Table, key_columns};

/// The percentiles that are computed.
pub const PERCENTILES: [u32; 5] = [5, 25, 50, 75, 95];
/// Pixels from this true distance on are left out, metres: counting takes memory for every metre up to the farthest.
pub(crate) const FARTHEST_M: u32 = 4096;

/// Absolute errors of an estimate in one metre of true distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceBin {
    /// Index of the estimate.
    pub estimate: usize,
    /// The bin holds true distances from this many metres up to, not including, one metre more.
    pub bin_m: u32,
    /// Over all pixels for which the estimate is valid.
    pub valid: Spread,
    /// Over those for which all that it is compared with are valid too; `None` if there is none.
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

/// Error against distance, and how many true distances are in each metre.
pub(crate) struct Distances {
    /// By estimate, then by metre.
    pub(crate) bins: Vec<DistanceBin>,
    /// By estimate: how many pixels were left out because they are beyond [`FARTHEST_M`].
    pub(crate) beyond: Vec<u64>,
    /// Scored pixels with ground truth by stage run and metre, over the frames whose values were recorded; each ground
    /// truth counts once.
    truth: BTreeMap<(RunId, u32), u64>,
}

/// Computes the error against distance of a recording, and its table. The maps of frames with `recorded` samples are
/// not read. The bins of equal maps come from one of the `reports` of earlier runs, given by their folders.
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
            let none = || Taken::none_yet(Samples::new(estimates.len(), samples_in_memory, output));
            let taken = recorded.map_or_else(none, |recorded| recorded.0);
            maps::distances(recording, estimates, |_| true, output, taken)?
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
        let key = |run: RunId| keys.of_those(&plan.runs[run].stage, &plan.runs[run].variants);
        let rows: Vec<(RowKey, u64)> = self.truth.iter().map(|((run, _), count)| (key(*run), *count)).collect();
        let mut columns = key_columns(&rows, |(key, _)| key, Vec::new());
        columns.extend(bin_columns(self.truth.keys().map(|(_, metre)| *metre)));
        columns.push(Rows(&rows).count("count", |(_, count)| *count).unit("pixels"));
        Table::new(columns)
    }

    /// The table `error_vs_distance`: estimate by estimate, first on the pixels for which each is valid (`valid`),
    /// then on the shared ones.
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

/// The edges of bins of a metre of true distance: from the first up to, not including, the second.
fn bin_columns(metres: impl Iterator<Item = u32> + Clone) -> [Column; 2] {
    let column = |name: &str, metres| Column::new(name, Cells::Metres(metres)).unit("m");
    [column("bin_from_m", metres.clone().collect()), column("bin_to_m", metres.map(|metre| metre + 1).collect())]
}
