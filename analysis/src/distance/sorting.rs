//! Percentiles of the samples of one metre in memory: counts classes of samples, then selects the few required order
//! statistics.

use depthloom_scores::quantile::{between, position};

use super::sample::{Which, error_bits, error_from_bits};
use super::{PERCENTILES, Spread};
use crate::query::place;

/// The spreads of the samples of a metre: over all valid pixels, and over shared ones.
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
    // With few samples, neighbouring percentiles share their order statistics.
    ranks.sort_unstable();
    let found = at_ranks(samples, &ranks);
    let percentiles_m = PERCENTILES.map(|percentile| {
        let (below, share) = position(f64::from(percentile) / 100.0, count);
        let error = |rank: usize| {
            let place = ranks.binary_search(&rank).expect("`ranks` contains the ranks of all percentiles");
            error_from_bits(error_bits(found[place]))
        };
        between(error(below as usize).into(), error((below as usize + 1).min(last)).into(), share)
    });
    Some(Spread { count, percentiles_m })
}

/// The number of classes for counting.
const CLASSES: usize = 4096;

/// The samples with these ascending ranks.
///
/// Samples are first counted in classes by size. Only classes that contain a rank are then sorted partially. This takes
/// three passes over memory in total, where selecting each rank separately takes two per rank.
fn at_ranks(samples: &mut [u32], ranks: &[usize]) -> Vec<u32> {
    if samples.len() < CLASSES {
        place(samples, 0, ranks);
        return ranks.iter().map(|rank| samples[*rank]).collect();
    }
    let lowest = samples.iter().fold(u32::MAX, |lowest, sample| lowest.min(*sample));
    let highest = samples.iter().fold(0, |highest, sample| highest.max(*sample));
    // The highest sample falls into the last class or an earlier one.
    let shift = (highest - lowest).checked_ilog2().map_or(0, |bits| (bits + 1).saturating_sub(CLASSES.ilog2()));
    let class = |sample: u32| ((sample - lowest) >> shift) as usize % CLASSES;
    let mut counts = [0_u32; CLASSES];
    samples.iter().for_each(|sample| counts[class(*sample)] += 1);
    // The class of each rank and the first rank in that class; each class with a rank is numbered.
    let (mut class_of_rank, mut numbers, mut classes) =
        (Vec::with_capacity(ranks.len()), [u8::MAX; CLASSES], Vec::new());
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
        class_of_rank.push(usize::from(numbers[at]));
    }
    for &sample in &*samples {
        if let Some((_, members)) = classes.get_mut(usize::from(numbers[class(sample)])) {
            members.push(sample);
        }
    }
    for (number, (first, members)) in classes.iter_mut().enumerate() {
        let in_class = |at: usize| class_of_rank[at] == number;
        let ranks: Vec<usize> = (0..ranks.len()).filter(|at| in_class(*at)).map(|at| ranks[at]).collect();
        place(members, *first, &ranks);
    }
    ranks.iter().zip(class_of_rank).map(|(rank, number)| classes[number].1[rank - classes[number].0]).collect()
}

#[cfg(test)]
mod tests {
    use depthloom_scores::quantile::quantile;

    use super::super::sample::sample;
    use super::*;

    #[test]
    fn selection_gives_the_same_bits_as_sorting() {
        let some: Vec<u32> = (0..40).map(|i| sample((i * i % 17) as f32 * 0.3, i % 3 != 0)).collect();
        let alone = vec![sample(0.5, false)];
        let many = (0..10_007_u64).map(|i| sample((i * i % 7919) as f32 * 0.01, i % 5 != 0)).collect();
        let few = vec![sample(3.0, true), sample(1.0, false), sample(2.0, true)];
        // All samples except one in one class; and all samples equal.
        let far =
            (0..20_000_u64).map(|i| if i == 9 { sample(1e30, true) } else { sample((i % 97) as f32, i % 3 != 0) });
        let far = far.collect();
        let alike = vec![sample(2.0, true); 10_000];
        for samples in [some, alone, few, many, far, alike, Vec::new()] {
            let sorted = [Which::Valid, Which::Shared].map(|which| {
                let selected = samples.iter().filter(|sample| which.has(**sample));
                let mut errors_m: Vec<f32> = selected.map(|sample| error_from_bits(error_bits(*sample))).collect();
                errors_m.sort_by(f32::total_cmp);
                let percentiles_m = PERCENTILES.map(|percentile| quantile(&errors_m, f64::from(percentile) / 100.0));
                (!errors_m.is_empty()).then_some(Spread { count: errors_m.len() as u64, percentiles_m })
            });
            assert_eq!(spreads(samples), sorted);
        }
    }
}
