//! Percentiles of samples that fit: polars' quantiles by bin.

use polars::frame::DataFrame;
use polars::prelude::{
    Column, DataType, IntoLazy, NamedFrom, PolarsResult, QuantileMethod, Series, SortMultipleOptions, col, len, lit,
};

use super::keys::{bin_m, error_m};
use super::{DistanceBin, PERCENTILES};

/// The bins of one estimator, nearest first.
pub(super) fn percentiles(estimator: usize, keys: &[u64]) -> PolarsResult<Vec<DistanceBin>> {
    let bins: Vec<u32> = keys.iter().map(|&key| bin_m(key)).collect();
    let errors: Vec<f32> = keys.iter().map(|&key| error_m(key)).collect();
    let columns =
        vec![Column::from(Series::new("bin_m".into(), bins)), Column::from(Series::new("error_m".into(), errors))];
    let mut aggregates = vec![len().alias("count")];
    aggregates.extend(PERCENTILES.map(|percentile| {
        let share = lit(f64::from(percentile) / 100.0);
        let name = format!("p{percentile}");
        // Between two samples in f64, as numpy does.
        col("error_m").cast(DataType::Float64).quantile(share, QuantileMethod::Linear).alias(name)
    }));
    let by_bin = DataFrame::new(keys.len(), columns)?.lazy().group_by([col("bin_m")]).agg(aggregates);
    let by_bin = by_bin.sort(["bin_m"], SortMultipleOptions::default()).collect()?;
    let (bins, counts) = (by_bin.column("bin_m")?.u32()?, by_bin.column("count")?.u32()?);
    let names = PERCENTILES.map(|percentile| format!("p{percentile}"));
    let mut columns = Vec::new();
    for name in &names {
        columns.push(by_bin.column(name)?.f64()?);
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
