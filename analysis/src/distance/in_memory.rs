//! Percentiles of samples that fit in memory: polars' quantiles by bin.

use polars::frame::DataFrame;
use polars::prelude::{
    Column, DataType, IntoLazy, NamedFrom, PolarsResult, QuantileMethod, Series, SortMultipleOptions, col, len, lit,
};

use super::samples::error_from_bits;
use super::{DistanceBin, PERCENTILES};

/// The bins of one estimator, nearest first, from the errors of each metre.
pub(super) fn percentiles(estimator: usize, held: &[Vec<u32>]) -> PolarsResult<Vec<DistanceBin>> {
    let count = held.iter().map(Vec::len).sum();
    let (mut bins, mut errors) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for (metre, bits) in held.iter().enumerate() {
        bins.resize(bins.len() + bits.len(), metre as u32);
        errors.extend(bits.iter().map(|&bits| error_from_bits(bits)));
    }
    let columns =
        vec![Column::from(Series::new("bin_m".into(), bins)), Column::from(Series::new("error_m".into(), errors))];
    let mut aggregates = vec![len().alias("count")];
    aggregates.extend(PERCENTILES.map(|percentile| {
        let share = lit(f64::from(percentile) / 100.0);
        // Between two samples in f64, as numpy does.
        let error = col("error_m").cast(DataType::Float64);
        error.quantile(share, QuantileMethod::Linear).alias(format!("p{percentile}"))
    }));
    let by_bin = DataFrame::new(count, columns)?.lazy().group_by([col("bin_m")]).agg(aggregates);
    let by_bin = by_bin.sort(["bin_m"], SortMultipleOptions::default()).collect()?;
    let (bins, counts) = (by_bin.column("bin_m")?.u32()?, by_bin.column("count")?.u32()?);
    let mut columns = Vec::new();
    for percentile in PERCENTILES {
        columns.push(by_bin.column(&format!("p{percentile}"))?.f64()?);
    }
    let row = |i: usize| {
        let mut percentiles_m = [f64::NAN; 5];
        for (percentile, column) in percentiles_m.iter_mut().zip(&columns) {
            *percentile = column.get(i)?;
        }
        Some(DistanceBin { estimator, bin_m: bins.get(i)?, count: u64::from(counts.get(i)?), percentiles_m })
    };
    Ok((0..by_bin.height()).filter_map(row).collect())
}
