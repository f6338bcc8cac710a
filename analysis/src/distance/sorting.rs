//! Percentiles of the samples of one metre that were read back from a spill: by bringing the few that are asked for to their places.

use super::sample::{Which, error_bits, error_from_bits};
use super::spread::{PERCENTILES, Spread, between, position};

/// How the samples of a metre spread: all that were answered, and those that are shared.
pub(super) fn spreads(mut samples: Vec<u32>) -> [Option<Spread>; 2] {
    let answered = spread(&mut samples);
    let count = samples.len();
    samples.retain(|sample| Which::Shared.has(*sample));
    let shared = if samples.len() == count { answered } else { spread(&mut samples) };
    [answered, shared]
}

fn spread(samples: &mut [u32]) -> Option<Spread> {
    let last = samples.len().checked_sub(1)?;
    let count = samples.len() as u64;
    let below = PERCENTILES.map(|percentile| position(percentile, count).0 as usize);
    let mut ranks: Vec<usize> = below.into_iter().flat_map(|below| [below, (below + 1).min(last)]).collect();
    // Of few samples the neighbours of one percentile are those of the next, too.
    ranks.sort_unstable();
    place(samples, 0, &ranks);
    let percentiles_m = PERCENTILES.map(|percentile| {
        let (below, share) = position(percentile, count);
        let error = |rank: usize| error_from_bits(error_bits(samples[rank]));
        between(error(below as usize), error((below as usize + 1).min(last)), share)
    });
    Some(Spread { count, percentiles_m })
}

/// Brings what has these ranks among samples that begin at rank `first` to where sorting would; the ranks ascend.
///
/// Sorting all would take three times as long.
fn place(samples: &mut [u32], first: usize, ranks: &[usize]) {
    let Some(&rank) = ranks.get(ranks.len() / 2) else { return };
    let (below, _, above) = samples.select_nth_unstable(rank - first);
    place(below, first, &ranks[..ranks.partition_point(|of| *of < rank)]);
    place(above, rank + 1, &ranks[ranks.partition_point(|of| *of <= rank)..]);
}

#[cfg(test)]
mod tests {
    use super::super::in_memory;
    use super::super::sample::sample;
    use super::*;

    #[test]
    fn placing_gives_the_bits_that_polars_gives() {
        let some: Vec<u32> = (0..40).map(|i| sample(f64::from(i * i % 17) * 0.3, i % 3 != 0)).collect();
        let alone = vec![sample(0.5, false)];
        let many = (0..10_007_u64).map(|i| sample((i * i % 7919) as f64 * 0.01, i % 5 != 0)).collect();
        let few = vec![sample(3.0, true), sample(1.0, false), sample(2.0, true)];
        for samples in [some, alone, few, many, Vec::new()] {
            let held = [samples.clone()];
            let polars = [Which::Answered, Which::Shared].map(|which| in_memory::spreads(which, &held).unwrap()[0]);
            assert_eq!(spreads(samples), polars);
        }
    }
}
