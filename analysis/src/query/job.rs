//! A job of a query: the samples of one stage with one scoring, over one pixel set, binned by one column.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use depthloom_threads::{into_unlocked, locked};
use polars::frame::DataFrame;
use polars::prelude::PolarsResult;

use super::bins::{Bins, Edges};
use super::numbers::numbers;
use super::percentiles::{Memory, OUTSIDE, Percentiles, Tally, percentiles};
use super::scan::{scan, threads};
use super::sums::{self, BinSums, PartSums, Sums};
use super::{By, Inquiry, SampleSet, Unit};
use crate::error::AnalysisError;
use crate::samples::{DescribedEstimate, Part, SamplesFile};

/// The maximum number of samples in memory, and of counters if there are more samples.
const SAMPLES: usize = 1 << 27;
const COUNTERS: usize = 1 << 26;

/// A job: which samples are binned, and how.
pub(super) struct Job<'a> {
    pub(super) run: &'a str,
    pub(super) file: &'a SamplesFile,
    pub(super) parts: Vec<&'a Part>,
    /// All compared estimates.
    pub(super) estimates: Vec<&'a DescribedEstimate>,
    /// The indices of the reported estimates among them.
    pub(super) reported: Vec<usize>,
    /// The binning column; `None`: one bin per frame.
    pub(super) by: Option<String>,
    pub(super) set: SampleSet,
}

/// The result of a job.
pub(super) struct BinnedErrors {
    pub(super) bins: JobBins,
    /// The bins with pixels, in order.
    pub(super) rows: Vec<BinRow>,
}

/// The bins of a job.
pub(super) enum JobBins {
    /// Between edges.
    Edges(Edges),
    /// The frames: position and id.
    Frames(Vec<(u32, String)>),
}

/// The errors in a bin.
pub(super) struct BinRow {
    pub(super) bin: usize,
    /// The scored pixels in the bin; for the set `common`, the common ones.
    pub(super) pixels: u64,
    /// For each reported estimate, the sums, and the percentiles if it has samples.
    pub(super) estimates: Vec<(Sums, Option<Vec<f64>>)>,
}

/// A part: the bins of its rows, and the errors of each reported estimate, NaN where it is invalid.
struct PartErrors {
    bins: Vec<u32>,
    errors: Vec<Vec<f32>>,
}

impl Job<'_> {
    pub(super) fn frames(&self) -> usize {
        self.parts.len()
    }

    pub(super) fn samples(&self) -> u64 {
        self.parts.iter().map(|part| part.rows as u64).sum()
    }

    /// Computes the result in several passes over the file.
    pub(super) fn compute(
        &self,
        inquiry: &Inquiry,
        progress: &(dyn Fn(u64) + Sync),
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<BinnedErrors, AnalysisError> {
        let bins = match &self.by {
            Some(column) => JobBins::Edges(self.edges(column, inquiry, stop)?),
            None => JobBins::Frames(self.ids()),
        };
        let count = match &bins {
            JobBins::Edges(edges) => edges.len(),
            JobBins::Frames(frames) => frames.len(),
        };
        let sums: Vec<Mutex<Vec<(usize, BinSums)>>> = self.parts.iter().map(|_| Mutex::default()).collect();
        let done = AtomicU64::new(0);
        let groups = self.reported.len() * count;
        let found = percentiles(groups, &inquiry.percentiles, memory(), |pass| {
            scan(
                self.parts.len(),
                stop,
                || Tally::new(pass),
                |tally, place| {
                    let (PartErrors { bins, errors }, part_sums) = self.read(place, &bins, inquiry, pass.is_first())?;
                    for (reported, errors) in errors.iter().enumerate() {
                        tally.add(pass, |bin| reported * count + bin, &bins, errors);
                    }
                    if let Some(part_sums) = part_sums {
                        *locked(&sums[place]) = part_sums.bins();
                        let rows = self.parts[place].rows as u64;
                        progress(done.fetch_add(rows, Ordering::Relaxed) + rows);
                    }
                    Ok(())
                },
            )
        })?;
        let values = |group: usize| (found[group].count > 0).then(|| found[group].values.clone());
        let rows =
            sums::total(sums.into_iter().map(into_unlocked)).into_iter().map(|(bin, BinSums { pixels, estimates })| {
                let errors =
                    estimates.into_iter().enumerate().map(|(reported, sums)| (sums, values(reported * count + bin)));
                BinRow { bin, pixels, estimates: errors.collect() }
            });
        let rows = rows.collect();
        Ok(BinnedErrors { bins, rows })
    }

    /// The frames, in order.
    fn ids(&self) -> Vec<(u32, String)> {
        self.parts.iter().map(|part| (part.position, part.frame.to_string())).collect()
    }

    /// The edges of the bins of a column.
    fn edges(&self, column: &str, inquiry: &Inquiry, stop: &(dyn Fn() -> bool + Sync)) -> Result<Edges, AnalysisError> {
        let bins = inquiry.bins.clone().unwrap_or(match inquiry.by {
            By::Distance | By::Estimate => Bins::Width(1.0),
            By::Error if inquiry.unit == Unit::Metres => Bins::Width(1.0),
            By::Error => Bins::Width(0.1),
            By::Weight => Bins::Edges((0..=10).map(|edge| f64::from(edge) / 10.0).collect()),
            By::Row | By::Column | By::Frame | By::Named(_) => Bins::Linear(20),
        });
        if let Bins::Edges(edges) = &bins {
            return Ok(Edges::new(edges.clone(), true));
        }
        let values = |place: usize| -> Result<Vec<f32>, AnalysisError> {
            let mut columns = vec!["ground_truth_m", column];
            columns.dedup();
            let table = self.file.read(self.parts[place], &columns)?;
            binned(&table, column, inquiry).map_err(AnalysisError::compute("bins"))
        };
        let nothing = || {
            let what = format!("no sample has a value in the column `{column}`");
            AnalysisError::request(what, "choose another `--by`".to_owned())
        };
        if let Bins::Quantile(count) = bins {
            let shares: Vec<f64> = (0..=count).map(|edge| 100.0 * f64::from(edge) / f64::from(count)).collect();
            let found = percentiles(1, &shares, memory(), |pass| {
                scan(
                    self.parts.len(),
                    stop,
                    || Tally::new(pass),
                    |tally, place| {
                        let values = values(place)?;
                        tally.add(pass, |_| 0, &vec![0; values.len()], &values);
                        Ok(())
                    },
                )
            })?;
            return match found.into_iter().next() {
                Some(Percentiles { count: 1.., values: edges }) => Ok(Edges::new(edges, true)),
                _ => Err(nothing()),
            };
        }
        let is_log = inquiry.by == By::Error && matches!(bins, Bins::Log(_));
        // Comparisons with NaN are false, so NaN is skipped.
        let ends = scan(
            self.parts.len(),
            stop,
            || (f32::INFINITY, f32::NEG_INFINITY),
            |(least, most), place| {
                // Logarithmic bins exclude errors of zero.
                let is_binned = |value: &f32| !is_log || *value > 0.0;
                for value in values(place)?.into_iter().filter(is_binned) {
                    *least = if value < *least { value } else { *least };
                    *most = if value > *most { value } else { *most };
                }
                Ok(())
            },
        )?;
        let least = ends.iter().map(|(least, _)| *least).fold(f32::INFINITY, f32::min);
        let most = ends.iter().map(|(_, most)| *most).fold(f32::NEG_INFINITY, f32::max);
        if least > most {
            return Err(nothing());
        }
        let edges = bins.edges(f64::from(least), f64::from(most))?;
        Ok(edges.expect("only quantile bins lack edges"))
    }

    /// Reads a part, and computes its sums if `with_sums`.
    fn read(
        &self,
        place: usize,
        bins: &JobBins,
        inquiry: &Inquiry,
        with_sums: bool,
    ) -> Result<(PartErrors, Option<PartSums>), AnalysisError> {
        let part = self.parts[place];
        let compared: Vec<usize> = match self.set {
            SampleSet::Valid => self.reported.clone(),
            SampleSet::Common => (0..self.estimates.len()).collect(),
        };
        let mut columns: Vec<&str> = vec!["ground_truth_m"];
        columns.extend(self.by.as_deref());
        columns.extend(compared.iter().map(|index| self.estimates[*index].column.as_str()));
        columns.sort_unstable();
        columns.dedup();
        let table = self.file.read(part, &columns)?;
        let prepared = || -> PolarsResult<(PartErrors, Option<PartSums>)> {
            let column = |index: usize| numbers(&table, &self.estimates[index].column);
            let (mut bins, count) = match (bins, &self.by) {
                (JobBins::Edges(edges), Some(column)) => (edges.bins(&binned(&table, column, inquiry)?), edges.len()),
                _ => (vec![place as u32; table.height()], self.parts.len()),
            };
            let mut errors =
                self.reported.iter().map(|index| column(*index)).collect::<PolarsResult<Vec<Vec<f32>>>>()?;
            if self.set == SampleSet::Common {
                errors.iter().for_each(|estimates| exclude_invalid(&mut bins, estimates));
                for index in compared.iter().filter(|index| !self.reported.contains(index)) {
                    exclude_invalid(&mut bins, &column(*index)?);
                }
            }
            let truth = numbers(&table, "ground_truth_m")?;
            let mut sums = PartSums::new(&bins, count);
            for estimates in &mut errors {
                if with_sums {
                    sums.add(&bins, &truth, estimates, inquiry.unit, inquiry.outlier);
                } else {
                    to_errors(estimates, &truth, inquiry.unit);
                }
            }
            Ok((PartErrors { bins, errors }, with_sums.then_some(sums)))
        };
        prepared().map_err(AnalysisError::compute("errors of samples"))
    }
}

/// The values that samples are binned by.
fn binned(table: &DataFrame, column: &str, inquiry: &Inquiry) -> PolarsResult<Vec<f32>> {
    let mut values = numbers(table, column)?;
    if inquiry.by == By::Error {
        to_errors(&mut values, &numbers(table, "ground_truth_m")?, inquiry.unit);
    }
    Ok(values)
}

/// Removes rows with an invalid estimate from their bins.
fn exclude_invalid(bins: &mut [u32], estimates: &[f32]) {
    for (bin, estimate) in bins.iter_mut().zip(estimates) {
        *bin = if estimate.is_nan() { OUTSIDE } else { *bin };
    }
}

/// Converts estimates to absolute errors.
fn to_errors(estimates: &mut [f32], truth: &[f32], unit: Unit) {
    for (value, truth) in estimates.iter_mut().zip(truth) {
        let error = f64::from(*value) - f64::from(*truth);
        let error = match unit {
            Unit::Metres => error,
            Unit::OfTruth => error / f64::from(*truth),
        };
        *value = error.abs() as f32;
    }
}

fn memory() -> Memory {
    Memory { samples: SAMPLES / threads(), counters: COUNTERS / threads() }
}
