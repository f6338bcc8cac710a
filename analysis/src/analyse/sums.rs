//! What adds up: counts, means and shares by bin.
//!
//! Within a part that is a loop over plain numbers: with a lazy polars query there, and columns read through its iterators, questions took twice the processor
//! time (`bench/analysis.sh`). polars adds the parts' sums, in the order of the parts, so that the result does not depend on which thread was first.

use polars::frame::DataFrame;
use polars::prelude::{Column, NamedFrom as _, PolarsResult, Series};

use super::{Gross, Unit};

const BIN: &str = "bin";
const PIXELS: &str = "pixels";

/// What is summed of an estimator.
const SUMS: [&str; 5] = ["count", "absolute", "signed", "squared", "gross"];

fn sum(what: &str, place: usize) -> String {
    format!("{what}_{place}")
}

/// What adds up in the bins of a part.
pub(super) struct PartSums {
    /// By bin, and of those that are in none.
    pixels: Vec<u64>,
    /// By estimator the same.
    of: Vec<Vec<Sums>>,
}

impl PartSums {
    /// Rows that are in these bins, of so many.
    pub(super) fn new(bins: &[u32], count: usize) -> Self {
        let mut pixels = vec![0; count + 1];
        bins.iter().for_each(|bin| pixels[(*bin as usize).min(count)] += 1);
        Self { pixels, of: Vec::new() }
    }

    /// Adds the next estimator's rows. Its estimates, NaN where it has none, become its absolute errors.
    pub(super) fn add(&mut self, bins: &[u32], truth_m: &[f32], estimates: &mut [f32], unit: Unit, gross: Gross) {
        let rows = bins.iter().zip(truth_m).zip(estimates);
        let mut of = vec![Sums::default(); self.pixels.len()];
        match (unit, gross) {
            (Unit::Metres, Gross::Metres(limit)) => add_rows(&mut of, rows, |error, _| error, |_| limit),
            (Unit::Metres, Gross::OfTruth(limit)) => add_rows(&mut of, rows, |error, _| error, |truth| limit * truth),
            (Unit::OfTruth, Gross::Metres(limit)) => {
                add_rows(&mut of, rows, |error, truth| error / truth, |truth| limit / truth);
            }
            (Unit::OfTruth, Gross::OfTruth(limit)) => {
                add_rows(&mut of, rows, |error, truth| error / truth, |_| limit);
            }
        }
        self.of.push(of);
    }

    /// A row a bin that has a pixel.
    pub(super) fn table(&self) -> PolarsResult<DataFrame> {
        let bins = 0..self.pixels.len() - 1;
        let held: Vec<usize> = bins.filter(|bin| self.pixels[*bin] > 0).collect();
        let of_bins: Vec<u32> = held.iter().map(|bin| *bin as u32).collect();
        let pixels: Vec<u64> = held.iter().map(|bin| self.pixels[*bin]).collect();
        let mut columns = vec![Series::new(BIN.into(), of_bins), Series::new(PIXELS.into(), pixels)];
        for (place, of) in self.of.iter().enumerate() {
            let of = || held.iter().map(|bin| &of[*bin]);
            let counts = |cell: fn(&Sums) -> u64| of().map(cell).collect::<Vec<u64>>();
            let numbers = |cell: fn(&Sums) -> f64| of().map(cell).collect::<Vec<f64>>();
            let [count, absolute, signed, squared, gross] = SUMS.map(|what| sum(what, place));
            columns.extend([
                Series::new(count.into(), counts(|of| of.count)),
                Series::new(absolute.into(), numbers(|of| of.absolute)),
                Series::new(signed.into(), numbers(|of| of.signed)),
                Series::new(squared.into(), numbers(|of| of.squared)),
                Series::new(gross.into(), counts(|of| of.gross)),
            ]);
        }
        DataFrame::new(held.len(), columns.into_iter().map(Column::from).collect())
    }
}

/// Adds rows: bin, truth and estimate, which becomes the absolute error. `error` makes the error in metres that of the unit, `limit` says from where on it is gross.
fn add_rows<'a>(
    sums: &mut [Sums],
    rows: impl Iterator<Item = ((&'a u32, &'a f32), &'a mut f32)>,
    error: impl Fn(f64, f64) -> f64,
    limit: impl Fn(f64) -> f64,
) {
    let last = sums.len() - 1;
    for ((bin, truth), estimate) in rows {
        let truth = f64::from(*truth);
        let error = error(f64::from(*estimate) - truth, truth);
        let size = error.abs();
        *estimate = size as f32;
        // A row without an answer adds zeros: a branch for one row in ten is guessed wrong too often.
        let is_answered = !error.is_nan();
        let (error, size) = if is_answered { (error, size) } else { (0.0, 0.0) };
        let of = &mut sums[(*bin as usize).min(last)];
        of.count += u64::from(is_answered);
        of.absolute += size;
        of.signed += error;
        of.squared += error * error;
        of.gross += u64::from(size > limit(truth));
    }
}

/// What the parts' sums say, a bin that has a row, in order.
pub(super) struct BinSums {
    pub(super) bin: u32,
    pub(super) pixels: u64,
    /// By estimator.
    pub(super) of: Vec<Sums>,
}

/// What adds up of an estimator in a bin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sums {
    pub(super) count: u64,
    pub(super) absolute: f64,
    pub(super) signed: f64,
    pub(super) squared: f64,
    pub(super) gross: u64,
}

/// The sums of all parts, added in their order.
#[expect(
    deprecated,
    reason = "polars wants its lazy engine instead: four crates that take longer to compile than this one"
)]
pub(super) fn of_all(parts: Vec<DataFrame>, estimators: usize) -> PolarsResult<Vec<BinSums>> {
    let mut parts = parts.into_iter();
    let Some(mut all) = parts.next() else { return Ok(Vec::new()) };
    for part in parts {
        all.vstack_mut_owned(part)?;
    }
    all.rechunk_mut();
    // Of every column but that of the bins. polars calls the sum of `a` `a_sum`.
    let all = all.group_by_stable([BIN])?.sum()?.sort([BIN], Default::default())?;
    let summed = |name: &str| all.column(&format!("{name}_sum"));
    let counts = |name: &str| -> PolarsResult<Vec<u64>> {
        Ok(summed(name)?.u64()?.iter().map(Option::unwrap_or_default).collect())
    };
    let numbers = |name: &str| -> PolarsResult<Vec<f64>> {
        Ok(summed(name)?.f64()?.iter().map(Option::unwrap_or_default).collect())
    };
    let bins = all.column(BIN)?.u32()?.iter().map(Option::unwrap_or_default);
    let mut rows: Vec<BinSums> = bins
        .zip(counts(PIXELS)?)
        .map(|(bin, pixels)| BinSums { bin, pixels, of: Vec::with_capacity(estimators) })
        .collect();
    for place in 0..estimators {
        let [count, absolute, signed, squared, gross] = SUMS.map(|what| sum(what, place));
        let (count, gross) = (counts(&count)?, counts(&gross)?);
        let (absolute, signed, squared) = (numbers(&absolute)?, numbers(&signed)?, numbers(&squared)?);
        for (at, row) in rows.iter_mut().enumerate() {
            row.of.push(Sums {
                count: count[at],
                absolute: absolute[at],
                signed: signed[at],
                squared: squared[at],
                gross: gross[at],
            });
        }
    }
    Ok(rows)
}
