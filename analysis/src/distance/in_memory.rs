//! Percentiles of samples that fit in memory: polars' quantiles by bin.

use polars::frame::DataFrame;
use polars::prelude::{Column, DataType, IntoLazy, NamedFrom, PolarsResult, QuantileMethod, Series, col, len, lit};

use super::samples::{Which, error_bits, error_from_bits};
use super::{PERCENTILES, Spread};

/// By metre: how the errors spread. Needs [what polars needs](crate::polars_needs).
pub(super) fn spreads(which: Which, held: &[Vec<u32>]) -> PolarsResult<Vec<Option<Spread>>> {
    let (mut bins, mut errors) = (Vec::new(), Vec::new());
    for (metre, samples) in held.iter().enumerate() {
        errors.extend(
            samples.iter().filter(|sample| which.has(**sample)).map(|sample| error_from_bits(error_bits(*sample))),
        );
        bins.resize(errors.len(), metre as u32);
    }
    let height = bins.len();
    let columns =
        vec![Column::from(Series::new("bin_m".into(), bins)), Column::from(Series::new("error_m".into(), errors))];
    let mut aggregates = vec![len().alias("count")];
    aggregates.extend(PERCENTILES.map(|percentile| {
        let share = lit(f64::from(percentile) / 100.0);
        // Between two samples in f64, as numpy does.
        let error = col("error_m").cast(DataType::Float64);
        error.quantile(share, QuantileMethod::Linear).alias(format!("p{percentile}"))
    }));
    let by_bin = DataFrame::new(height, columns)?.lazy().group_by([col("bin_m")]).agg(aggregates).collect()?;
    let (metres, counts) = (by_bin.column("bin_m")?.u32()?, by_bin.column("count")?.u32()?);
    let mut columns = Vec::with_capacity(PERCENTILES.len());
    for percentile in PERCENTILES {
        columns.push(by_bin.column(&format!("p{percentile}"))?.f64()?);
    }
    let mut spreads = vec![None; held.len()];
    for row in 0..by_bin.height() {
        let (Some(metre), Some(count)) = (metres.get(row), counts.get(row)) else { continue };
        let mut percentiles_m = [f64::NAN; PERCENTILES.len()];
        for (percentile, column) in percentiles_m.iter_mut().zip(&columns) {
            *percentile = column.get(row).unwrap_or(f64::NAN);
        }
        spreads[metre as usize] = Some(Spread { count: u64::from(count), percentiles_m });
    }
    Ok(spreads)
}
