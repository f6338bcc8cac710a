//! Percentiles of samples that fit in memory: polars' quantiles, bin by bin.

use polars::prelude::{ChunkQuantile, Float64Chunked, PolarsResult, QuantileMethod};

use super::sample::{Which, error_bits, error_from_bits};
use super::spread::{PERCENTILES, Spread};

/// By metre: how the errors spread.
pub(super) fn spreads(which: Which, held: &[Vec<u32>]) -> PolarsResult<Vec<Option<Spread>>> {
    held.iter().map(|samples| spread(which, samples)).collect()
}

fn spread(which: Which, samples: &[u32]) -> PolarsResult<Option<Spread>> {
    let mut samples: Vec<u32> = samples.iter().copied().filter(|sample| which.has(*sample)).collect();
    if samples.is_empty() {
        return Ok(None);
    }
    // Integers sort faster than what they stand for, and what is sorted polars sorts in one pass. It must not be told so: it
    // would start its threads to look at its own flag, and where the system gives no more threads, wait for them for ever.
    samples.sort_unstable();
    // Between two samples in f64, as numpy does.
    let errors = samples.into_iter().map(|sample| f64::from(error_from_bits(error_bits(sample)))).collect();
    let errors = Float64Chunked::from_vec("error_m".into(), errors);
    let shares = PERCENTILES.map(|percentile| f64::from(percentile) / 100.0);
    let mut percentiles_m = [f64::NAN; PERCENTILES.len()];
    for (percentile_m, found) in percentiles_m.iter_mut().zip(errors.quantiles(&shares, QuantileMethod::Linear)?) {
        *percentile_m = found.unwrap_or(f64::NAN);
    }
    Ok(Some(Spread { count: errors.len() as u64, percentiles_m }))
}
