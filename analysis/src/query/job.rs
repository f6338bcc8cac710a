//! One inquiry of one population: the samples of a stage that were scored in one way, over one set of pixels, by one
//! column.

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

/// Samples that are held in memory at most, and counters where there are more samples.
const SAMPLES: usize = 1 << 27;
const COUNTERS: usize = 1 << 26;

/// What is asked of which samples.
pub(super) struct Job<'a> {
    pub(super) run: &'a str,
    pub(super) file: &'a SamplesFile,
    pub(super) parts: Vec<&'a Part>,
    /// All that are compared.
    pub(super) estimates: Vec<&'a DescribedEstimate>,
    /// Those of them that are reported.
    pub(super) reported: Vec<usize>,
    /// The column that samples are put into bins by; `None`: a bin a frame.
    pub(super) by: Option<String>,
    pub(super) set: SampleSet,
}

/// What was found of a population.
pub(super) struct Found {
    pub(super) bins: FoundBins,
    /// A bin that has pixels, in order.
    pub(super) rows: Vec<FoundRow>,
}

/// What the bins are.
pub(super) enum FoundBins {
    /// Between edges.
    Edges(Edges),
    /// The frames: position and id.
    Frames(Vec<(u32, String)>),
}

/// A bin.
pub(super) struct FoundRow {
    pub(super) bin: usize,
    /// Scored pixels in it; of the common set, those that are common.
    pub(super) pixels: u64,
    /// By reported estimate: the sums, and the percentiles where it has samples.
    pub(super) estimates: Vec<(Sums, Option<Vec<f64>>)>,
}

/// A part: its rows' bins, and by reported estimate the errors, NaN where it has no estimate.
struct Read {
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

    /// Finds everything, in several passes over the file.
    pub(super) fn answer(
        &self,
        inquiry: &Inquiry,
        progress: &(dyn Fn(u64) + Sync),
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Found, AnalysisError> {
        let bins = match &self.by {
            Some(column) => FoundBins::Edges(self.edges(column, inquiry, stop)?),
            None => FoundBins::Frames(self.ids()),
        };
        let count = match &bins {
            FoundBins::Edges(edges) => edges.len(),
            FoundBins::Frames(frames) => frames.len(),
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
                    let (Read { bins, errors }, of_part) = self.read(place, &bins, inquiry, pass.is_first())?;
                    for (reported, errors) in errors.iter().enumerate() {
                        tally.add(pass, |bin| reported * count + bin, &bins, errors);
                    }
                    if let Some(of_part) = of_part {
                        *locked(&sums[place]) = of_part.bins();
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
                let of_estimates =
                    estimates.into_iter().enumerate().map(|(reported, sums)| (sums, values(reported * count + bin)));
                FoundRow { bin, pixels, estimates: of_estimates.collect() }
            });
        let rows = rows.collect();
        Ok(Found { bins, rows })
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
            let mut columns = vec!["truth_m", column];
            columns.dedup();
            let table = self.file.read(self.parts[place], &columns)?;
            binned(&table, column, inquiry).map_err(AnalysisError::compute("bins"))
        };
        let nothing = || {
            let what = format!("no sample has a value in the column `{column}`");
            AnalysisError::asked(what, "ask for another --by".to_owned())
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
        // NaN is neither less nor more than anything.
        let ends = scan(
            self.parts.len(),
            stop,
            || (f32::INFINITY, f32::NEG_INFINITY),
            |(least, most), place| {
                // Bins of one ratio have no place for an error of zero.
                let is_taken = |value: &f32| !is_log || *value > 0.0;
                for value in values(place)?.into_iter().filter(is_taken) {
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
        Ok(edges.expect("bins that are no quantiles have edges"))
    }

    /// Reads a part, and computes its sums where wanted.
    fn read(
        &self,
        place: usize,
        bins: &FoundBins,
        inquiry: &Inquiry,
        with_sums: bool,
    ) -> Result<(Read, Option<PartSums>), AnalysisError> {
        let part = self.parts[place];
        let compared: Vec<usize> = match self.set {
            SampleSet::Valid => self.reported.clone(),
            SampleSet::Common => (0..self.estimates.len()).collect(),
        };
        let mut columns: Vec<&str> = vec!["truth_m"];
        columns.extend(self.by.as_deref());
        columns.extend(compared.iter().map(|of| self.estimates[*of].column.as_str()));
        columns.sort_unstable();
        columns.dedup();
        let table = self.file.read(part, &columns)?;
        let prepared = || -> PolarsResult<(Read, Option<PartSums>)> {
            let column = |of: usize| numbers(&table, &self.estimates[of].column);
            let (mut bins, count) = match (bins, &self.by) {
                (FoundBins::Edges(edges), Some(column)) => (edges.bins(&binned(&table, column, inquiry)?), edges.len()),
                _ => (vec![place as u32; table.height()], self.parts.len()),
            };
            let mut errors = self.reported.iter().map(|of| column(*of)).collect::<PolarsResult<Vec<Vec<f32>>>>()?;
            if self.set == SampleSet::Common {
                errors.iter().for_each(|estimates| leave_out(&mut bins, estimates));
                for of in compared.iter().filter(|of| !self.reported.contains(of)) {
                    leave_out(&mut bins, &column(*of)?);
                }
            }
            let truth = numbers(&table, "truth_m")?;
            let mut sums = PartSums::new(&bins, count);
            for estimates in &mut errors {
                if with_sums {
                    sums.add(&bins, &truth, estimates, inquiry.unit, inquiry.gross);
                } else {
                    to_errors(estimates, &truth, inquiry.unit);
                }
            }
            Ok((Read { bins, errors }, with_sums.then_some(sums)))
        };
        prepared().map_err(AnalysisError::compute("errors of samples"))
    }
}

/// The numbers that samples are put into bins by.
fn binned(table: &DataFrame, column: &str, inquiry: &Inquiry) -> PolarsResult<Vec<f32>> {
    let mut of = numbers(table, column)?;
    if inquiry.by == By::Error {
        to_errors(&mut of, &numbers(table, "truth_m")?, inquiry.unit);
    }
    Ok(of)
}

/// Takes rows without an answer out of their bins.
fn leave_out(bins: &mut [u32], estimates: &[f32]) {
    for (bin, estimate) in bins.iter_mut().zip(estimates) {
        *bin = if estimate.is_nan() { OUTSIDE } else { *bin };
    }
}

/// Makes absolute errors of estimates.
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
