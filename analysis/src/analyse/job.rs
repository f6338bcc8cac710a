//! One inquiry of one population: the samples of a stage that were scored in one way, over one set of pixels, by one column.

use std::num::NonZero;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;

use depthloom_threads::{Budget, Tiles as _};
use polars::frame::DataFrame;
use polars::prelude::{Column, DataType, Float32Chunked, NamedFrom, PolarsResult, Series};

use super::bins::{Bins, Edges};
use super::sums::{self, BIN, Sums, TRUTH};
use super::{By, Inquiry, SampleSet, Unit};
use crate::error::{AnalysisError, caught};
use crate::percentiles::{OUTSIDE, Pass, Percentiles, Room, Tally, percentiles};
use crate::samples::{DescribedEstimator, Part, SamplesFile};

/// What is asked of which samples.
pub(super) struct Job<'a> {
    pub(super) run: &'a str,
    pub(super) file: &'a SamplesFile,
    pub(super) parts: Vec<&'a Part>,
    /// All that are compared.
    pub(super) estimators: Vec<&'a DescribedEstimator>,
    /// Those of them that are told of.
    pub(super) told: Vec<usize>,
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
    /// By estimator told of: what adds up, and the percentiles where it has samples.
    pub(super) of: Vec<(Sums, Option<Vec<f64>>)>,
}

/// A part, read: its rows' bins, and by estimator told of the errors.
struct Read {
    table: DataFrame,
    bins: Vec<u32>,
    errors: Vec<Vec<f32>>,
}

impl Job<'_> {
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
            None => FoundBins::Frames(self.frames()),
        };
        let count = match &bins {
            FoundBins::Edges(edges) => edges.len(),
            FoundBins::Frames(frames) => frames.len(),
        };
        let of_parts: Vec<Mutex<Option<DataFrame>>> = self.parts.iter().map(|_| Mutex::new(None)).collect();
        let done = AtomicU64::new(0);
        let scan = |pass: &Pass| {
            self.scan(
                stop,
                || Tally::of(pass),
                |tally, place| {
                    let Read { table, bins, errors } = self.read(place, &bins, inquiry)?;
                    for (told, errors) in errors.iter().enumerate() {
                        tally.take(pass, told * count, &bins, errors);
                    }
                    if pass.is_first() {
                        let of_part = sums::of_part(table, self.told.len(), inquiry.unit, inquiry.gross);
                        *locked(&of_parts[place]) = Some(of_part.map_err(AnalysisError::compute("sums of samples"))?);
                        let rows = self.parts[place].rows as u64;
                        progress(done.fetch_add(rows, Ordering::Relaxed) + rows);
                    }
                    Ok(())
                },
            )
        };
        let room = Room::for_threads(threads());
        let found = percentiles(self.told.len() * count, &inquiry.percentiles, room, scan)?;
        let of_group = |group: usize| (found[group].count > 0).then(|| found[group].values.clone());
        let parts = of_parts.into_iter().filter_map(|of| of.into_inner().unwrap_or_else(PoisonError::into_inner));
        let sums = sums::of_all(parts.collect(), self.told.len()).map_err(AnalysisError::compute("sums of samples"))?;
        let rows = sums.into_iter().map(|sums| {
            let bin = sums.bin as usize;
            let of = sums.of.into_iter().enumerate().map(|(told, of)| (of, of_group(told * count + bin)));
            FoundRow { bin, pixels: sums.pixels, of: of.collect() }
        });
        let rows = rows.collect();
        Ok(Found { bins, rows })
    }

    /// The frames, in order.
    fn frames(&self) -> Vec<(u32, String)> {
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
        let scan = |make: &(dyn Fn() -> Tally + Sync), take: &(dyn Fn(&mut Tally, &[f32]) + Sync)| {
            self.scan(stop, make, |tally, place| {
                let mut columns = vec!["truth_m", column];
                columns.dedup();
                let table = self.file.read(self.parts[place], &columns)?;
                take(tally, &binned(&table, column, inquiry).map_err(AnalysisError::compute("bins"))?);
                Ok(())
            })
        };
        // Of quantiles all edges, of others the first and the last.
        let shares: Vec<f64> = match bins {
            Bins::Quantile(count) => (0..=count).map(|edge| 100.0 * f64::from(edge) / f64::from(count)).collect(),
            _ => vec![0.0, 100.0],
        };
        let found = percentiles(1, &shares, Room::for_threads(threads()), |pass| {
            scan(&|| Tally::of(pass), &|tally, values| tally.take(pass, 0, &vec![0; values.len()], values))
        })?;
        let Some(Percentiles { count: 1.., values: edges }) = found.into_iter().next() else {
            let what = format!("no sample has a value in the column `{column}`");
            return Err(AnalysisError::asked(what, "ask for another --by".to_owned()));
        };
        let (least, most) = (edges[0], edges[edges.len() - 1]);
        Ok(bins.edges(least, most)?.unwrap_or_else(|| Edges::new(edges, true)))
    }

    /// Reads a part.
    fn read(&self, place: usize, bins: &FoundBins, inquiry: &Inquiry) -> Result<Read, AnalysisError> {
        let part = self.parts[place];
        let mut columns: Vec<&str> = vec!["truth_m"];
        columns.extend(self.by.as_deref());
        let compared: Vec<usize> = match self.set {
            SampleSet::Answered => self.told.clone(),
            SampleSet::Common => (0..self.estimators.len()).collect(),
        };
        columns.extend(compared.iter().map(|of| self.estimators[*of].column.as_str()));
        columns.sort_unstable();
        columns.dedup();
        let table = self.file.read(part, &columns)?;
        self.prepared(&table, place, bins, &compared, inquiry).map_err(AnalysisError::compute("errors of samples"))
    }

    fn prepared(
        &self,
        table: &DataFrame,
        place: usize,
        bins: &FoundBins,
        compared: &[usize],
        inquiry: &Inquiry,
    ) -> PolarsResult<Read> {
        let of_bins = match (bins, &self.by) {
            (FoundBins::Edges(edges), Some(column)) => edges.bins(&binned(table, column, inquiry)?),
            _ => vec![place as u32; table.height()],
        };
        // Those that are told of come first.
        let others = compared.iter().filter(|of| !self.told.contains(of));
        let order: Vec<usize> = self.told.iter().chain(others).copied().collect();
        let mut columns = vec![
            Column::from(Series::new(BIN.into(), of_bins)),
            table.column("truth_m")?.clone().with_name(TRUTH.into()),
        ];
        for (at, of) in order.iter().enumerate() {
            columns.push(table.column(&self.estimators[*of].column)?.clone().with_name(sums::estimate(at).into()));
        }
        let mut table = DataFrame::new(table.height(), columns)?;
        if self.set == SampleSet::Common {
            table = sums::common(table, order.len())?;
            table.rechunk_mut();
        }
        let bins: Vec<u32> = table.column(BIN)?.u32()?.iter().map(|bin| bin.unwrap_or(OUTSIDE)).collect();
        let truth = values(&table, TRUTH)?;
        let mut errors = Vec::with_capacity(self.told.len());
        for told in 0..self.told.len() {
            let mut of = values(&table, &sums::estimate(told))?;
            to_errors(&mut of, &truth, inquiry.unit);
            errors.push(of);
        }
        Ok(Read { table, bins, errors })
    }

    /// Calls `take` for every part, on all cores, each with what `make` made for its thread; gives these.
    fn scan(
        &self,
        stop: &(dyn Fn() -> bool + Sync),
        make: impl Fn() -> Tally + Sync,
        take: impl Fn(&mut Tally, usize) -> Result<(), AnalysisError> + Sync,
    ) -> Result<Vec<Tally>, AnalysisError> {
        let idle: Mutex<Vec<Tally>> = Mutex::new(Vec::new());
        let failed: Mutex<Option<(usize, AnalysisError)>> = Mutex::new(None);
        let budget = Budget::new(threads());
        let _own = budget.permit();
        budget.run(self.parts.len(), &|place| {
            if locked(&failed).is_some() {
                return;
            }
            let taken = caught(|| {
                if stop() {
                    return Err(AnalysisError::Stopped);
                }
                let tally = locked(&idle).pop();
                let mut tally = tally.unwrap_or_else(&make);
                take(&mut tally, place)?;
                locked(&idle).push(tally);
                Ok(())
            });
            if let Err(error) = taken {
                let mut failed = locked(&failed);
                if failed.as_ref().is_none_or(|(at, _)| place < *at) {
                    *failed = Some((place, error));
                }
            }
        });
        match failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some((_, error)) => Err(error),
            None => Ok(idle.into_inner().unwrap_or_else(PoisonError::into_inner)),
        }
    }
}

/// The numbers that samples are put into bins by.
fn binned(table: &DataFrame, column: &str, inquiry: &Inquiry) -> PolarsResult<Vec<f32>> {
    let mut of = values(table, column)?;
    if inquiry.by == By::Error {
        to_errors(&mut of, &values(table, "truth_m")?, inquiry.unit);
    }
    Ok(of)
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

/// A column's numbers; NaN where it has none.
fn values(table: &DataFrame, column: &str) -> PolarsResult<Vec<f32>> {
    let column = table.column(column)?;
    let cast = if column.dtype() == &DataType::Float32 { column.clone() } else { column.cast(&DataType::Float32)? };
    let numbers: &Float32Chunked = cast.f32()?;
    Ok(match numbers.cont_slice() {
        Ok(all) => all.to_vec(),
        Err(_) => numbers.iter().map(|number| number.unwrap_or(f32::NAN)).collect(),
    })
}

fn threads() -> usize {
    thread::available_parallelism().map_or(1, NonZero::get)
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
