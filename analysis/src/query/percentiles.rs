//! Exact percentiles of many groups of samples at once, in bounded memory.
//!
//! A sample is not negative, so its bits sort as it does: an integer of 31 bits. A pass over the samples gathers them,
//! and percentiles are selected from what it gathered. Once more samples arrive than memory holds, the pass counts them
//! by their upper bits instead. The counts show which cell contains each required order statistic, and the next pass
//! gathers (or counts) only in these cells.
//!
//! polars' quantiles store and sort all samples of a group (`bench/analysis.sh` measures both).

use depthloom_scores::quantile::{between, position};

use crate::error::AnalysisError;

/// Bits of a sample.
const BITS: u32 = 31;
/// The bin number of rows outside of all bins.
pub(crate) const OUTSIDE: u32 = u32::MAX;

/// The memory limits of one thread.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Memory {
    /// The maximum number of samples of 4 bytes.
    pub(crate) samples: usize,
    /// The maximum number of counters of 4 bytes.
    pub(crate) counters: usize,
}

/// The percentiles of a group.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Percentiles {
    /// The number of samples.
    pub(crate) count: u64,
    /// The percentiles, interpolated like NumPy's `linear`; empty without samples.
    pub(crate) values: Vec<f64>,
}

/// Computes the percentiles (0 to 100) of every group.
///
/// `scan(pass)` calls [`Tally::add`] for all samples, on any threads, and returns the threads' tallies; it is called
/// once per pass.
///
/// # Errors
/// Those of `scan`.
pub(crate) fn percentiles(
    groups: usize,
    percentiles: &[f64],
    memory: Memory,
    scan: impl FnMut(&Pass) -> Result<Vec<Tally>, AnalysisError>,
) -> Result<Vec<Percentiles>, AnalysisError> {
    let ranks = |count: u64| -> Vec<u64> {
        let below = percentiles.iter().map(|percentile| position(percentile / 100.0, count).0);
        below.flat_map(|below| [below, (below + 1).min(count - 1)]).collect()
    };
    let found = order_statistics(groups, &ranks, memory, scan)?;
    let interpolated = |(count, neighbours): (u64, Vec<f32>)| {
        let pairs = percentiles.iter().zip(neighbours.as_chunks::<2>().0);
        let value = |(percentile, [lower, upper]): (&f64, &[f32; 2])| {
            between((*lower).into(), (*upper).into(), position(percentile / 100.0, count).1)
        };
        Percentiles { count, values: pairs.map(value).collect() }
    };
    Ok(found.into_iter().map(interpolated).collect())
}

/// For each group, the number of samples, and the samples with the ranks `ranks(count)`.
fn order_statistics(
    groups: usize,
    ranks: &dyn Fn(u64) -> Vec<u64>,
    memory: Memory,
    mut scan: impl FnMut(&Pass) -> Result<Vec<Tally>, AnalysisError>,
) -> Result<Vec<(u64, Vec<f32>)>, AnalysisError> {
    let mut pass = Pass { levels: Vec::new(), left: BITS, cells: groups, memory };
    let mut found: Vec<(u64, Vec<f32>)> = Vec::new();
    let mut statistics: Vec<OrderStatistic> = Vec::new();
    loop {
        let merged = pass.merge(scan(&pass)?);
        if pass.is_first() {
            found = merged.counts().map(|count| (count, Vec::new())).collect();
            for (group, (count, _)) in found.iter().enumerate().filter(|(_, (count, _))| *count > 0) {
                let statistic = |rank| OrderStatistic { group, cell: group, rank, bits: 0 };
                statistics.extend(ranks(*count).into_iter().map(statistic));
            }
        }
        match merged {
            Merged::Samples(cells) => {
                select(cells, &mut statistics);
                break;
            }
            Merged::Counts(_, counts) => pass.narrow(&counts, &mut statistics),
        }
        if pass.left == 0 || statistics.is_empty() {
            break;
        }
    }
    statistics.iter().for_each(|statistic| found[statistic.group].1.push(f32::from_bits(statistic.bits)));
    Ok(found)
}

/// A required order statistic.
struct OrderStatistic {
    group: usize,
    /// The cell that contains it.
    cell: usize,
    /// Its rank among the samples of that cell, from 0.
    rank: u64,
    /// Its upper bits, as far as they are known.
    bits: u32,
}

/// Finds the order statistics among the samples of their cells.
fn select(mut cells: Vec<Vec<u32>>, statistics: &mut [OrderStatistic]) {
    let mut statistics: Vec<&mut OrderStatistic> = statistics.iter_mut().collect();
    statistics.sort_by_key(|statistic| (statistic.cell, statistic.rank));
    for same_cell in statistics.chunk_by_mut(|one, other| one.cell == other.cell) {
        let samples = &mut cells[same_cell[0].cell];
        let ranks: Vec<usize> = same_cell.iter().map(|statistic| statistic.rank as usize).collect();
        place(samples, 0, &ranks);
        same_cell.iter_mut().for_each(|statistic| statistic.bits = samples[statistic.rank as usize]);
    }
}

/// Moves the samples with these ascending ranks to their sorted places, in a third of the time of sorting. The first
/// sample has the rank `first`.
pub(crate) fn place(samples: &mut [u32], first: usize, ranks: &[usize]) {
    let Some(&rank) = ranks.get(ranks.len() / 2) else { return };
    let (below, _, above) = samples.select_nth_unstable(rank - first);
    place(below, first, &ranks[..ranks.partition_point(|other| *other < rank)]);
    place(above, rank + 1, &ranks[ranks.partition_point(|other| *other <= rank)..]);
}

/// A pass over the samples.
pub(crate) struct Pass {
    /// For each earlier pass, the number of bits by which cells were split, and the cell of each part, counted from 1;
    /// 0 for parts without a required order statistic.
    levels: Vec<(u32, Vec<u32>)>,
    /// Bits that are not known yet.
    left: u32,
    /// The number of cells with a required order statistic; in the first pass, of groups.
    cells: usize,
    memory: Memory,
}

impl Pass {
    /// Whether it is the first one.
    pub(crate) const fn is_first(&self) -> bool {
        self.levels.is_empty()
    }

    /// The number of bits by which cells are split for counting.
    fn bits(&self) -> u32 {
        (self.memory.counters / self.cells.max(1)).max(2).ilog2().min(self.left).min(16)
    }

    /// The cell of a sample, if the cell contains a required order statistic.
    fn cell(&self, group: usize, sample: u32) -> Option<usize> {
        let (mut cell, mut left) = (group, BITS);
        for (bits, cells) in &self.levels {
            left -= bits;
            cell = cells[cell << bits | (sample >> left) as usize & ((1 << bits) - 1)].checked_sub(1)? as usize;
        }
        Some(cell)
    }

    /// Merges the tallies of all threads. The result has samples if no thread had to count.
    fn merge(&self, tallies: Vec<Tally>) -> Merged {
        let is_gathered = tallies.iter().all(|tally| matches!(tally.0, Content::Samples(..)));
        if is_gathered {
            let mut all = vec![Vec::new(); self.cells];
            for cells in tallies.into_iter().filter_map(Tally::samples) {
                for (all, cell) in all.iter_mut().zip(cells) {
                    if all.is_empty() { *all = cell } else { all.extend(cell) }
                }
            }
            return Merged::Samples(all);
        }
        let mut all = vec![0; self.cells << self.bits()];
        for tally in tallies {
            let counts = tally.into_counts(self);
            all.iter_mut().zip(counts).for_each(|(all, count)| *all += u64::from(count));
        }
        for parts in all.chunks_mut(1 << self.bits()) {
            let mut sum = 0;
            for count in parts {
                sum += *count;
                *count = sum;
            }
        }
        Merged::Counts(self.bits(), all)
    }

    /// Narrows each order statistic to a part of its cell; `counts` are cumulative.
    fn narrow(&mut self, counts: &[u64], statistics: &mut [OrderStatistic]) {
        let bits = self.bits();
        let mut cells = vec![0; counts.len()];
        self.cells = 0;
        for statistic in statistics {
            let first = statistic.cell << bits;
            let counts = &counts[first..first + (1 << bits)];
            let part = counts.partition_point(|count| *count <= statistic.rank);
            statistic.rank -= if part == 0 { 0 } else { counts[part - 1] };
            let cell = &mut cells[first + part];
            if *cell == 0 {
                self.cells += 1;
                *cell = self.cells as u32;
            }
            statistic.cell = *cell as usize - 1;
            statistic.bits = statistic.bits << bits | part as u32;
        }
        self.levels.push((bits, cells));
        self.left -= bits;
    }
}

/// The samples or counts of a thread in a pass.
pub(crate) struct Tally(Content);

enum Content {
    /// Samples by cell, and their total number.
    Samples(Vec<Vec<u32>>, usize),
    /// Counts by cell and part, then the count of rows that are not samples. A thread sees fewer than 2^32 samples of a
    /// part.
    Counts(Vec<u32>),
}

enum Merged {
    /// By cell.
    Samples(Vec<Vec<u32>>),
    /// The number of bits by which cells are split, and counts by cell and part, cumulative in each cell.
    Counts(u32, Vec<u64>),
}

impl Merged {
    /// The number of samples by cell.
    fn counts(&self) -> Box<dyn Iterator<Item = u64> + '_> {
        match self {
            Self::Samples(cells) => Box::new(cells.iter().map(|cell| cell.len() as u64)),
            Self::Counts(bits, counts) => Box::new(counts.chunks(1 << bits).map(|parts| parts[parts.len() - 1])),
        }
    }
}

impl Tally {
    /// An empty tally.
    pub(crate) fn new(pass: &Pass) -> Self {
        Self(Content::Samples(vec![Vec::new(); pass.cells], 0))
    }

    /// Adds samples; those in bin `b` belong to `group(b)`. NaN and samples in the bin [`OUTSIDE`] are skipped.
    pub(crate) fn add(&mut self, pass: &Pass, group: impl Fn(usize) -> usize, bins: &[u32], samples: &[f32]) {
        match &mut self.0 {
            Content::Samples(cells, count) => {
                for (bin, sample) in bins.iter().zip(samples) {
                    if *bin == OUTSIDE || sample.is_nan() {
                        continue;
                    }
                    let (group, number) = (group(*bin as usize), number(*sample));
                    let cell = if pass.is_first() { Some(group) } else { pass.cell(group, number) };
                    if let Some(cell) = cell {
                        cells[cell].push(number);
                    }
                }
                *count = cells.iter().map(Vec::len).sum();
                if *count > pass.memory.samples {
                    self.0 = Content::Counts(std::mem::replace(self, Self::new(pass)).into_counts(pass));
                }
            }
            Content::Counts(counts) => {
                let (bits, last) = (pass.bits(), counts.len() - 1);
                let shift = pass.left - bits;
                if pass.is_first() {
                    for (bin, sample) in bins.iter().zip(samples) {
                        let part = group(*bin as usize) << bits | (number(*sample) >> shift) as usize;
                        // Branch-free, because a branch would be mispredicted too often.
                        let is_sample = *bin != OUTSIDE && !sample.is_nan();
                        counts[if is_sample { part } else { last }] += 1;
                    }
                    return;
                }
                for (bin, sample) in bins.iter().zip(samples) {
                    if *bin == OUTSIDE || sample.is_nan() {
                        continue;
                    }
                    let number = number(*sample);
                    if let Some(cell) = pass.cell(group(*bin as usize), number) {
                        counts[cell << bits | (number >> shift) as usize & ((1 << bits) - 1)] += 1;
                    }
                }
            }
        }
    }

    fn samples(self) -> Option<Vec<Vec<u32>>> {
        match self.0 {
            Content::Samples(cells, _) => Some(cells),
            Content::Counts(_) => None,
        }
    }

    /// Counts by cell and part, then the count of rows that are not samples.
    fn into_counts(self, pass: &Pass) -> Vec<u32> {
        let cells = match self.0 {
            Content::Counts(counts) => return counts,
            Content::Samples(cells, _) => cells,
        };
        let bits = pass.bits();
        let shift = pass.left - bits;
        let mut counts = vec![0; (pass.cells << bits) + 1];
        for (cell, samples) in cells.into_iter().enumerate() {
            for sample in samples {
                counts[cell << bits | (sample >> shift) as usize & ((1 << bits) - 1)] += 1;
            }
        }
        counts
    }
}

/// The bits of a sample without the sign, because zero has two forms.
const fn number(sample: f32) -> u32 {
    sample.to_bits() & (u32::MAX >> 1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The order statistics, and the number of passes.
    fn found(groups: usize, samples: &[(u32, f32)], memory: Memory) -> (Vec<(u64, Vec<f32>)>, usize) {
        let mut passes = 0;
        let ranks = |count: u64| vec![0, count / 2, count / 2, count - 1];
        let halves = samples.split_at(samples.len() / 2);
        let scan = |pass: &Pass| {
            passes += 1;
            let tallies = [halves.0, halves.1].map(|half| {
                let mut tally = Tally::new(pass);
                for samples in half.chunks(7) {
                    let (bins, values): (Vec<u32>, Vec<f32>) = samples.iter().copied().unzip();
                    tally.add(pass, |bin| bin, &bins, &values);
                }
                tally
            });
            Ok(Vec::from(tallies))
        };
        (order_statistics(groups, &ranks, memory, scan).unwrap(), passes)
    }

    fn sorted(groups: usize, samples: &[(u32, f32)]) -> Vec<(u64, Vec<f32>)> {
        let statistics = |group: u32| {
            let own = samples.iter().filter(|(bin, value)| *bin == group && !value.is_nan());
            let mut values: Vec<f32> = own.map(|(_, value)| *value).collect();
            values.sort_by(f32::total_cmp);
            let at = |rank: usize| values.get(rank).copied();
            let expected = [at(0), at(values.len() / 2), at(values.len() / 2), at(values.len().wrapping_sub(1))];
            (values.len() as u64, expected.into_iter().flatten().collect())
        };
        (0..groups as u32).map(statistics).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn ranks_equal_those_of_sorting_with_any_memory(
            samples in prop::collection::vec(
                (prop_oneof![8 => 0_u32..5, 1 => Just(OUTSIDE)],
                 prop_oneof![1 => Just(f32::NAN), 1 => Just(0.5_f32), 1 => Just(0.0), 4 => 0.0_f32..100.0, 1 => 0.0_f32..1e-6]),
                0..400,
            ),
        ) {
            let sorted = sorted(5, &samples);
            for (samples_at_most, counters) in [(1000, 1000), (0, 64), (10, 20), (100, 1 << 18)] {
                let memory = Memory { samples: samples_at_most, counters };
                prop_assert_eq!(&found(5, &samples, memory).0, &sorted, "{:?}", memory);
            }
        }
    }

    #[test]
    fn samples_that_fit_in_memory_need_one_pass() {
        let samples: Vec<(u32, f32)> =
            (0..40_000).map(|at: u32| (at % 3, at.wrapping_mul(2_654_435_761) as f32 / 4e9 + 0.5)).collect();
        for (samples_at_most, counters, passes) in [(20_000, 1000, 1), (10_000, 1 << 18, 2), (100, 1000, 4)] {
            let memory = Memory { samples: samples_at_most, counters };
            assert_eq!(found(3, &samples, memory), (sorted(3, &samples), passes), "{memory:?}");
        }
    }

    #[test]
    fn farthest_and_smallest_numbers_keep_their_bits() {
        let samples = [(0, f32::MAX), (0, f32::MIN_POSITIVE), (0, f32::INFINITY), (0, 1e-45), (0, -0.0)];
        let expected = vec![(5, vec![0.0, f32::MIN_POSITIVE, f32::MIN_POSITIVE, f32::INFINITY])];
        for samples_at_most in [0, 10] {
            let memory = Memory { samples: samples_at_most, counters: 1 << 10 };
            assert_eq!(found(1, &samples, memory).0, expected);
        }
    }
}
