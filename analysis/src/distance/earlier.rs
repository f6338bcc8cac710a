//! Reads the error against distance from the report of an earlier run, so that it is not recomputed for equal maps.

use std::collections::BTreeSet;
use std::path::Path;

use depthloom_graphs::{Key, regular_file};
use polars::prelude::{ParallelStrategy, ParquetReader, PolarsResult, SerReader as _};
use serde::{Deserialize, Serialize};

use super::inputs::Input;
use super::{DistanceBin, PERCENTILES, Spread};
use crate::error::caught;

/// The name under which [`Origin`] is stored in the metadata of the table.
pub(super) const ORIGIN: &str = "depthloom.computed_from";

/// What the rows of `error_vs_distance.parquet` were computed from.
#[derive(Debug, PartialEq, Deserialize, Serialize)]
pub(super) struct Origin {
    /// In the order of the rows. Each estimate has one row per bin of its valid pixels, then one per bin of
    /// the pixels that are valid in all.
    estimates: Vec<EstimateOrigin>,
    /// A checksum of the above and of the rows.
    rows: Key,
}

/// What the rows of an estimate were computed from.
#[derive(Debug, PartialEq, Deserialize, Serialize)]
struct EstimateOrigin {
    /// See [`Input::key`].
    input: Option<Key>,
    /// See [`Input::group`].
    group: usize,
    valid_rows: usize,
    common_rows: usize,
    /// The number of pixels that were excluded because they are too far.
    beyond: u64,
}

impl Origin {
    /// The origin of the bins. `beyond` is, by estimate, the number of excluded pixels.
    pub(super) fn new(bins: &[DistanceBin], inputs: &[Option<Input>], beyond: &[u64]) -> Self {
        let estimates = bins.chunk_by(|a, b| a.estimate == b.estimate).map(|bins| {
            let index = bins[0].estimate;
            let input = inputs[index];
            EstimateOrigin {
                input: input.and_then(|input| input.key),
                group: input.map_or(usize::MAX, |input| input.group),
                valid_rows: bins.len(),
                common_rows: bins.iter().filter(|bin| bin.shared.is_some()).count(),
                beyond: beyond[index],
            }
        });
        let estimates: Vec<EstimateOrigin> = estimates.collect();
        let rows = checksum(&estimates, bins);
        Self { estimates, rows }
    }

    pub(super) fn json(&self) -> String {
        serde_json::to_string(self).expect("keys and numbers have a text")
    }
}

/// A checksum of the origin of bins and of the bins: of every column of the table except the labels.
fn checksum(estimates: &[EstimateOrigin], bins: &[DistanceBin]) -> Key {
    let mut numbers: Vec<u64> = Vec::new();
    for origin in estimates {
        let input = origin.input.map_or(0, |key| u128::from_le_bytes(*key.as_bytes()));
        numbers.extend([input as u64, (input >> 64) as u64]);
        numbers.extend([origin.group, origin.valid_rows, origin.common_rows].map(|number| number as u64));
        numbers.push(origin.beyond);
    }
    for bin in bins {
        numbers.extend([u64::from(bin.bin_m), u64::from(bin.shared.is_some())]);
        for spread in std::iter::once(&bin.valid).chain(&bin.shared) {
            numbers.push(spread.count);
            numbers.extend(spread.percentiles_m.map(f64::to_bits));
        }
    }
    let bytes: Vec<u8> = numbers.into_iter().flat_map(u64::to_le_bytes).collect();
    Key::of_content(&bytes)
}

/// The bins of an earlier report.
#[derive(Debug)]
pub(super) struct EarlierBins {
    estimates: Vec<EarlierEstimate>,
}

/// The bins of an estimate in an earlier report.
#[derive(Debug)]
struct EarlierEstimate {
    origin: EstimateOrigin,
    /// By metre, the estimate's index in the earlier report.
    bins: Vec<DistanceBin>,
}

impl EarlierBins {
    /// Reads `error_vs_distance.parquet` in a run's folder. `None` if the file is missing or damaged, or an earlier
    /// version wrote it.
    pub(super) fn read(folder: &Path) -> Option<Self> {
        // polars panics on some damaged files.
        caught(|| Ok(Self::read_sound(folder))).ok().flatten()
    }

    fn read_sound(folder: &Path) -> Option<Self> {
        let file = regular_file::open(&folder.join("error_vs_distance.parquet")).ok()?;
        let mut reader = ParquetReader::new(file).read_parallel(ParallelStrategy::None);
        let metadata = reader.get_metadata().ok()?.clone();
        let origin = metadata.key_value_metadata().as_ref()?.iter().find(|entry| entry.key.as_str() == ORIGIN)?;
        let origin: Origin = serde_json::from_str(origin.value.as_ref()?.as_str()).ok()?;
        let rows = rows(reader).ok()?;
        let (estimates, checked) = (origin.estimates, origin.rows);
        let bins_by_estimate = Self::split(&estimates, &rows)?;
        if checksum(&estimates, &bins_by_estimate.concat()) != checked {
            return None;
        }
        let estimates =
            estimates.into_iter().zip(bins_by_estimate).map(|(origin, bins)| EarlierEstimate { origin, bins });
        Some(Self { estimates: estimates.collect() })
    }

    /// The bins of each estimate. `None` if there are more or fewer rows than the origin says.
    fn split(estimates: &[EstimateOrigin], mut rows: &[(u32, Spread)]) -> Option<Vec<Vec<DistanceBin>>> {
        let mut bins_by_estimate = Vec::with_capacity(estimates.len());
        for (estimate, origin) in estimates.iter().enumerate() {
            let (valid, rest) = rows.split_at_checked(origin.valid_rows)?;
            let (shared, rest) = rest.split_at_checked(origin.common_rows)?;
            rows = rest;
            let shared_in = |bin: u32| shared.iter().find(|(bin_m, _)| *bin_m == bin).map(|(_, spread)| *spread);
            let bin =
                |&(bin_m, valid): &(u32, Spread)| DistanceBin { estimate, bin_m, valid, shared: shared_in(bin_m) };
            bins_by_estimate.push(valid.iter().map(bin).collect());
        }
        rows.is_empty().then_some(bins_by_estimate)
    }

    /// Finds estimates of the report by the keys of their inputs: by key, the index of the estimate. All of them are
    /// in one group of the report, the group with the most matches.
    pub(super) fn matches(&self, inputs: &[Option<Key>]) -> Vec<Option<usize>> {
        let matches_in_group = |group: usize| -> Vec<Option<usize>> {
            let with = |key: Key| {
                let is_match =
                    |earlier: &EarlierEstimate| earlier.origin.group == group && earlier.origin.input == Some(key);
                self.estimates.iter().position(is_match)
            };
            inputs.iter().map(|key| key.and_then(with)).collect()
        };
        let groups: BTreeSet<usize> = self.estimates.iter().map(|earlier| earlier.origin.group).collect();
        let found = groups.into_iter().map(matches_in_group);
        let best = found.max_by_key(|found| found.iter().flatten().count());
        best.unwrap_or_else(|| vec![None; inputs.len()])
    }

    /// Whether every valid pixel of an estimate of the report is valid in its whole group.
    pub(super) fn is_valid_only_where_shared(&self, estimate: usize) -> bool {
        let count = |bin: &DistanceBin| bin.shared.map_or(0, |shared| shared.count);
        self.estimates[estimate].bins.iter().all(|bin| bin.valid.count == count(bin))
    }

    /// The bins of an estimate of the report, with the index that the estimate has today.
    pub(super) fn bins(&self, estimate: usize, index: usize) -> impl Iterator<Item = DistanceBin> {
        self.estimates[estimate].bins.iter().map(move |bin| DistanceBin { estimate: index, ..*bin })
    }

    /// The number of pixels of an estimate of the report that were excluded because they are too far.
    pub(super) fn beyond(&self, estimate: usize) -> u64 {
        self.estimates[estimate].origin.beyond
    }
}

/// The bin and the spread of each row.
fn rows(reader: ParquetReader<std::fs::File>) -> PolarsResult<Vec<(u32, Spread)>> {
    let table = reader.finish()?;
    let bins = table.column("bin_from_m")?.u32()?;
    let counts = table.column("count")?.u64()?;
    let mut errors = Vec::with_capacity(PERCENTILES.len());
    for percentile in PERCENTILES {
        errors.push(table.column(&format!("error_p{percentile}_m"))?.f64()?);
    }
    let row = |row: usize| {
        let mut percentiles_m = [f64::NAN; PERCENTILES.len()];
        for (percentile_m, errors) in percentiles_m.iter_mut().zip(&errors) {
            *percentile_m = errors.get(row).unwrap_or(f64::NAN);
        }
        let spread = Spread { count: counts.get(row).unwrap_or(0), percentiles_m };
        (bins.get(row).unwrap_or(u32::MAX), spread)
    };
    Ok((0..table.height()).map(row).collect())
}
