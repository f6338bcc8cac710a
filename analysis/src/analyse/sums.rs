//! What adds up: counts, means and shares by bin, as lazy polars queries, a part of the samples at a time.

use polars::frame::DataFrame;
use polars::prelude::{DataType, PolarsResult};
use polars_lazy::dsl::{Expr, col, len, lit};
use polars_lazy::prelude::IntoLazy as _;

use super::{Gross, Unit};
use crate::percentiles::OUTSIDE;

/// The column that says a row's bin.
pub(super) const BIN: &str = "bin";
/// The column of the truth.
pub(super) const TRUTH: &str = "truth";

/// What is summed of an estimator.
const SUMS: [&str; 5] = ["count", "absolute", "signed", "squared", "gross"];

/// The column of an estimator.
pub(super) fn estimate(place: usize) -> String {
    format!("estimate_{place}")
}

fn sum(what: &str, place: usize) -> String {
    format!("{what}_{place}")
}

/// By bin, over the rows of a part: how many, and of each estimator the [`SUMS`].
pub(super) fn of_part(part: DataFrame, estimators: usize, unit: Unit, gross: Gross) -> PolarsResult<DataFrame> {
    let truth = || col(TRUTH).cast(DataType::Float64);
    let error = |place: usize| sum("error", place);
    let errors = (0..estimators).map(|place| {
        let metres = col(estimate(place)).cast(DataType::Float64) - truth();
        let of_unit = match unit {
            Unit::Metres => metres,
            Unit::OfTruth => metres / truth(),
        };
        of_unit.alias(error(place))
    });
    let sums = (0..estimators).flat_map(|place| {
        let error = || col(error(place));
        let limit = match (gross, unit) {
            (Gross::Metres(limit), Unit::Metres) | (Gross::OfTruth(limit), Unit::OfTruth) => lit(limit),
            (Gross::Metres(limit), Unit::OfTruth) => lit(limit) / truth(),
            (Gross::OfTruth(limit), Unit::Metres) => lit(limit) * truth(),
        };
        let sums: [Expr; SUMS.len()] = [
            error().count().cast(DataType::UInt64),
            error().abs().sum(),
            error().sum(),
            (error() * error()).sum(),
            error().abs().gt(limit).sum().cast(DataType::UInt64),
        ];
        SUMS.into_iter().zip(sums).map(move |(what, expr)| expr.alias(sum(what, place)))
    });
    let all = [len().cast(DataType::UInt64).alias("pixels")].into_iter().chain(sums);
    part.lazy()
        .with_columns(errors.collect::<Vec<Expr>>())
        .filter(col(BIN).neq(lit(OUTSIDE)))
        .group_by_stable([col(BIN)])
        .agg(all.collect::<Vec<Expr>>())
        .collect()
}

/// The rows of a part that all its estimators answered.
pub(super) fn common(part: DataFrame, estimators: usize) -> PolarsResult<DataFrame> {
    let answered = (0..estimators).map(|place| col(estimate(place)).is_not_null());
    match answered.reduce(Expr::and) {
        None => Ok(part),
        Some(all) => part.lazy().filter(all).collect(),
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
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sums {
    pub(super) count: u64,
    pub(super) absolute: f64,
    pub(super) signed: f64,
    pub(super) squared: f64,
    pub(super) gross: u64,
}

/// The sums of all parts, added in their order.
pub(super) fn of_all(parts: Vec<DataFrame>, estimators: usize) -> PolarsResult<Vec<BinSums>> {
    let mut parts = parts.into_iter();
    let Some(mut all) = parts.next() else { return Ok(Vec::new()) };
    for part in parts {
        all.vstack_mut_owned(part)?;
    }
    all.rechunk_mut();
    let names = (0..estimators).flat_map(|place| SUMS.map(|what| sum(what, place)));
    let sums: Vec<Expr> = ["pixels".to_owned()].into_iter().chain(names).map(|name| col(name).sum()).collect();
    let all = all.lazy().group_by_stable([col(BIN)]).agg(sums).sort([BIN], Default::default()).collect()?;
    let counts = |name: &str| -> PolarsResult<Vec<u64>> {
        Ok(all.column(name)?.u64()?.iter().map(Option::unwrap_or_default).collect())
    };
    let numbers = |name: &str| -> PolarsResult<Vec<f64>> {
        Ok(all.column(name)?.f64()?.iter().map(Option::unwrap_or_default).collect())
    };
    let bins = all.column(BIN)?.u32()?.iter().map(Option::unwrap_or_default);
    let mut rows: Vec<BinSums> = bins
        .zip(counts("pixels")?)
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
