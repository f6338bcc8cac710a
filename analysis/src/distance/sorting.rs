//! Percentiles of the samples of one metre that were read back from a spill: by sorting them.

use super::sample::{Which, error_bits, error_from_bits};
use super::spread::{PERCENTILES, Spread, between, position};

/// How the samples of a metre spread: all that were answered, and those that are shared.
pub(super) fn spreads(mut samples: Vec<u32>) -> [Option<Spread>; 2] {
    samples.sort_unstable();
    let answered = spread(&samples);
    let count = samples.len();
    samples.retain(|sample| Which::Shared.has(*sample));
    let shared = if samples.len() == count { answered } else { spread(&samples) };
    [answered, shared]
}

fn spread(sorted: &[u32]) -> Option<Spread> {
    let last = sorted.len().checked_sub(1)?;
    let count = sorted.len() as u64;
    let percentiles_m = PERCENTILES.map(|percentile| {
        let (below, share) = position(percentile, count);
        let error = |rank: usize| error_from_bits(error_bits(sorted[rank]));
        between(error(below as usize), error((below as usize + 1).min(last)), share)
    });
    Some(Spread { count, percentiles_m })
}

#[cfg(test)]
mod tests {
    use super::super::in_memory;
    use super::super::sample::sample;
    use super::*;

    #[test]
    fn sorting_gives_the_bits_that_polars_gives() {
        let some: Vec<u32> = (0..40).map(|i| sample(f64::from(i * i % 17) * 0.3, i % 3 != 0)).collect();
        let alone = vec![sample(0.5, false)];
        for samples in [some, alone, Vec::new()] {
            let held = [samples.clone()];
            let polars = [Which::Answered, Which::Shared].map(|which| in_memory::spreads(which, &held).unwrap()[0]);
            assert_eq!(spreads(samples), polars);
        }
    }
}
