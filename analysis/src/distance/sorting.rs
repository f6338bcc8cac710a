//! Percentiles of the samples of one metre in memory: counts classes of samples, then selects the few required order
//! statistics.

use depthloom_scores::quantile::{between, position};

use super::sample::{Which, error_bits, error_from_bits};
use super::{PERCENTILES, Spread};
use crate::query::place;

/// The number of classes for counting. Fewer samples are sorted partially without it.
const CLASSES: usize = 4096;
/// Samples that are looked at together.
const BATCH: usize = 1024;
/// The number of a class that contains no rank.
const UNNUMBERED: u8 = u8::MAX;

/// The spreads of the samples of a metre: over all valid pixels, and over shared ones.
///
/// Samples are first counted in classes by size. Only classes that contain a required rank are then sorted partially.
/// This takes three passes over memory in total, where selecting each rank separately takes two per rank.
pub(super) fn spreads(mut samples: Vec<u32>) -> [Option<Spread>; 2] {
    if samples.len() < CLASSES {
        let valid = spread_of_few(&mut samples);
        samples.retain(|sample| Which::Shared.has(*sample));
        return [valid, spread_of_few(&mut samples)];
    }
    let lowest = samples.iter().fold(u32::MAX, |lowest, sample| lowest.min(*sample));
    let highest = samples.iter().fold(0, |highest, sample| highest.max(*sample));
    // The highest sample falls into the last class or an earlier one.
    let shift = (highest - lowest).checked_ilog2().map_or(0, |bits| (bits + 1).saturating_sub(CLASSES.ilog2()));
    let class = |sample: u32| ((sample - lowest) >> shift) as usize % CLASSES;
    // By class: the samples of shared pixels, and the others.
    let mut counts = vec![[0_u32; 2]; CLASSES];
    for &sample in &samples {
        counts[class(sample)][usize::from(!Which::Shared.has(sample))] += 1;
    }
    let mut selected = [Selected::new(|class| counts[class].iter().sum()), Selected::new(|class| counts[class][0])];
    let is_selected: Vec<bool> =
        (0..CLASSES).map(|class| selected.iter().any(|set| set.numbers[class] != UNNUMBERED)).collect();
    let mut picked = vec![0; BATCH];
    for samples in samples.chunks(BATCH) {
        // Without a branch: one sample in ten is in a selected class, in no order.
        let mut count = 0;
        for &sample in samples {
            picked[count] = sample;
            count += usize::from(is_selected[class(sample)]);
        }
        for &sample in &picked[..count] {
            let class = class(sample);
            for (selected, which) in selected.iter_mut().zip([Which::Valid, Which::Shared]) {
                if selected.numbers[class] != UNNUMBERED && which.has(sample) {
                    selected.classes[usize::from(selected.numbers[class])].members.push(sample);
                }
            }
        }
    }
    selected.map(Selected::spread)
}

fn spread_of_few(samples: &mut [u32]) -> Option<Spread> {
    let ranks = ranks(samples.len());
    place(samples, 0, &ranks);
    spread(samples.len(), |rank| samples[rank])
}

/// The ranks that the percentiles of this many samples depend on, ascending. With few samples, neighbouring percentiles
/// share them.
fn ranks(count: usize) -> Vec<usize> {
    let Some(last) = count.checked_sub(1) else { return Vec::new() };
    let below = PERCENTILES.map(|percentile| position(f64::from(percentile) / 100.0, count as u64).0 as usize);
    let mut ranks: Vec<usize> = below.into_iter().flat_map(|below| [below, (below + 1).min(last)]).collect();
    ranks.sort_unstable();
    ranks
}

/// The spread of this many samples, given those with the [`ranks`].
fn spread(count: usize, at_rank: impl Fn(usize) -> u32) -> Option<Spread> {
    let last = count.checked_sub(1)?;
    let error_m = |rank: usize| f64::from(error_from_bits(error_bits(at_rank(rank))));
    let percentiles_m = PERCENTILES.map(|percentile| {
        let (below, share) = position(f64::from(percentile) / 100.0, count as u64);
        between(error_m(below as usize), error_m((below as usize + 1).min(last)), share)
    });
    Some(Spread { count: count as u64, percentiles_m })
}

/// The classes that contain a required rank.
struct Selected {
    /// The number of samples.
    count: usize,
    ranks: Vec<usize>,
    /// By class its index in `classes`.
    numbers: Vec<u8>,
    classes: Vec<Class>,
}

struct Class {
    /// The rank of its first sample.
    first: usize,
    members: Vec<u32>,
}

impl Selected {
    /// Given the number of samples in each class.
    fn new(count_of: impl Fn(usize) -> u32) -> Self {
        let count = (0..CLASSES).map(|class| count_of(class) as usize).sum();
        let (ranks, mut numbers, mut classes) = (ranks(count), vec![UNNUMBERED; CLASSES], Vec::new());
        let (mut at, mut first) = (0, 0);
        for &rank in &ranks {
            while first + count_of(at) as usize <= rank {
                first += count_of(at) as usize;
                at += 1;
            }
            if numbers[at] == UNNUMBERED {
                numbers[at] = classes.len() as u8;
                classes.push(Class { first, members: Vec::with_capacity(count_of(at) as usize) });
            }
        }
        Self { count, ranks, numbers, classes }
    }

    /// The spread, once the classes have their members.
    fn spread(mut self) -> Option<Spread> {
        for Class { first, members } in &mut self.classes {
            let (below, end) = (|rank: &usize| *rank < *first, *first + members.len());
            let ranks = &self.ranks[self.ranks.partition_point(below)..self.ranks.partition_point(|rank| *rank < end)];
            place(members, *first, ranks);
        }
        spread(self.count, |rank| {
            let class = &self.classes[self.classes.partition_point(|class| class.first <= rank) - 1];
            class.members[rank - class.first]
        })
    }
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
