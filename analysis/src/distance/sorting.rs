//! Percentiles of the samples of one metre that were read back from a spill: by counting, and by bringing the few that
//! are asked for to their places.

use depthloom_scores::quantile::{between, position};

use super::sample::{Which, error_bits, error_from_bits};
use super::{PERCENTILES, Spread};
use crate::query::place;

/// How the samples of a metre spread: all valid ones, and those that are shared.
pub(super) fn spreads(mut samples: Vec<u32>) -> [Option<Spread>; 2] {
    let valid = spread(&mut samples);
    let count = samples.len();
    samples.retain(|sample| Which::Shared.has(*sample));
    let shared = if samples.len() == count { valid } else { spread(&mut samples) };
    [valid, shared]
}

fn spread(samples: &mut [u32]) -> Option<Spread> {
    let last = samples.len().checked_sub(1)?;
    let count = samples.len() as u64;
    let below = PERCENTILES.map(|percentile| position(f64::from(percentile) / 100.0, count).0 as usize);
    let mut ranks: Vec<usize> = below.into_iter().flat_map(|below| [below, (below + 1).min(last)]).collect();
    // Of few samples the neighbours of one percentile are those of the next, too.
    ranks.sort_unstable();
    let found = at_ranks(samples, &ranks);
    let percentiles_m = PERCENTILES.map(|percentile| {
        let (below, share) = position(f64::from(percentile) / 100.0, count);
        let error = |rank: usize| {
            let place = ranks.binary_search(&rank).expect("every rank asked for is among them");
            error_from_bits(error_bits(found[place]))
        };
        between(error(below as usize).into(), error((below as usize + 1).min(last)).into(), share)
    });
    Some(Spread { count, percentiles_m })
}

/// Into how many classes samples are counted.
const CLASSES: usize = 4096;

/// What has these ranks among samples; the ranks ascend.
///
/// Samples are counted by classes of their size first, and only those of a class that has a rank are brought to their
/// places: three passes over memory, where each rank by itself takes two.
fn at_ranks(samples: &mut [u32], ranks: &[usize]) -> Vec<u32> {
    if samples.len() < CLASSES {
        place(samples, 0, ranks);
        return ranks.iter().map(|rank| samples[*rank]).collect();
    }
    let lowest = samples.iter().fold(u32::MAX, |lowest, sample| lowest.min(*sample));
    let highest = samples.iter().fold(0, |highest, sample| highest.max(*sample));
    // So that the highest falls into the last class or one before.
    let shift = (highest - lowest).checked_ilog2().map_or(0, |bits| (bits + 1).saturating_sub(CLASSES.ilog2()));
    let class = |sample: u32| ((sample - lowest) >> shift) as usize % CLASSES;
    let mut counts = [0_u32; CLASSES];
    samples.iter().for_each(|sample| counts[class(*sample)] += 1);
    // Which class each rank is in, and the first rank in it; for each class that has one, its number among these.
    let (mut of_ranks, mut numbers, mut classes) = (Vec::with_capacity(ranks.len()), [u8::MAX; CLASSES], Vec::new());
    let (mut at, mut before) = (0, 0);
    for &rank in ranks {
        while before + counts[at] as usize <= rank {
            before += counts[at] as usize;
            at += 1;
        }
        if numbers[at] == u8::MAX {
            numbers[at] = classes.len() as u8;
            classes.push((before, Vec::with_capacity(counts[at] as usize)));
        }
        of_ranks.push(usize::from(numbers[at]));
    }
    for &sample in &*samples {
        if let Some((_, of_class)) = classes.get_mut(usize::from(numbers[class(sample)])) {
            of_class.push(sample);
        }
    }
    for (number, (first, of_class)) in classes.iter_mut().enumerate() {
        let in_class = |at: usize| of_ranks[at] == number;
        let ranks: Vec<usize> = (0..ranks.len()).filter(|at| in_class(*at)).map(|at| ranks[at]).collect();
        place(of_class, *first, &ranks);
    }
    ranks.iter().zip(of_ranks).map(|(rank, number)| classes[number].1[rank - classes[number].0]).collect()
}

#[cfg(test)]
mod tests {
    use depthloom_scores::quantile::quantile;

    use super::super::sample::sample;
    use super::*;

    #[test]
    fn placing_gives_the_bits_that_sorting_gives() {
        let some: Vec<u32> = (0..40).map(|i| sample((i * i % 17) as f32 * 0.3, i % 3 != 0)).collect();
        let alone = vec![sample(0.5, false)];
        let many = (0..10_007_u64).map(|i| sample((i * i % 7919) as f32 * 0.01, i % 5 != 0)).collect();
        let few = vec![sample(3.0, true), sample(1.0, false), sample(2.0, true)];
        // All in one class, but one; and all alike.
        let far =
            (0..20_000_u64).map(|i| if i == 9 { sample(1e30, true) } else { sample((i % 97) as f32, i % 3 != 0) });
        let far = far.collect();
        let alike = vec![sample(2.0, true); 10_000];
        for samples in [some, alone, few, many, far, alike, Vec::new()] {
            let sorted = [Which::Valid, Which::Shared].map(|which| {
                let of_which = samples.iter().filter(|sample| which.has(**sample));
                let mut errors_m: Vec<f32> = of_which.map(|sample| error_from_bits(error_bits(*sample))).collect();
                errors_m.sort_by(f32::total_cmp);
                let percentiles_m = PERCENTILES.map(|percentile| quantile(&errors_m, f64::from(percentile) / 100.0));
                (!errors_m.is_empty()).then_some(Spread { count: errors_m.len() as u64, percentiles_m })
            });
            assert_eq!(spreads(samples), sorted);
        }
    }
}
