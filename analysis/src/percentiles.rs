//! Percentiles of many groups of samples at once, exact, in one to three passes over them: by counting.
//!
//! Polars' quantiles hold all samples of a group, and sort them: memory would grow with the samples (`bench/analysis.sh` measures both). Here a sample that is no negative number is an integer of 31 bits that sorts as it does. A pass counts
//! the samples of each group by their upper bits; from the counts follows in which cell each wanted statistic lies, and which of that cell it is.
//! Once all samples of the wanted cells fit in memory (as a rule after the first pass) the next one gathers them; else it counts on, by more bits. Where a
//! [trial](Trial) over some of the samples said [where they are likely to be](guess), the first pass gathers them already, and is the only one if that was right.

mod guess;

use crate::error::AnalysisError;
use guess::Guess;

/// Bits of a sample that is no negative number.
const BITS: u32 = 31;
/// No cell of interest.
const NONE: u32 = u32::MAX;
/// A row that is in no bin.
pub(crate) const OUTSIDE: u32 = u32::MAX;

/// What may be held.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Room {
    /// Counters a thread, of 4 bytes.
    pub(crate) counters: usize,
    /// Samples that are gathered, of 4 bytes.
    pub(crate) gathered: u64,
}

impl Room {
    /// 256 MiB of counters and as much of samples, whatever the number of threads.
    pub(super) fn for_threads(threads: usize) -> Self {
        Self { counters: (1 << 26) / threads.max(1), gathered: 1 << 26 }
    }
}

/// Where a percentile lies among `count` sorted samples: the rank below it, and how far it is from there to the next (NumPy's `linear`).
pub(crate) fn position(percentile: f64, count: u64) -> (u64, f64) {
    let exact = percentile / 100.0 * (count - 1) as f64;
    (exact.floor() as u64, exact - exact.floor())
}

/// The percentile between its two neighbours among sorted samples.
pub(crate) fn between(lower: f32, upper: f32, share: f64) -> f64 {
    let (lower, upper) = (f64::from(lower), f64::from(upper));
    lower + (upper - lower) * share
}

/// What was found of a group.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Percentiles {
    /// How many samples it has.
    pub(crate) count: u64,
    /// The percentiles asked for, between neighbours as NumPy's `linear`; none of no sample.
    pub(crate) values: Vec<f64>,
}

/// Whether some of the samples are looked at first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Trial {
    None,
    /// Of [such a pass](Pass::is_trial) `scan` takes some of the samples; all together are so many times as many.
    Some(f64),
}

/// The percentiles (0 to 100) of every group; the rest is as of [`order_statistics`].
///
/// # Errors
/// What `scan` gives.
pub(crate) fn percentiles(
    groups: usize,
    percentiles: &[f64],
    room: Room,
    trial: Trial,
    scan: impl FnMut(&Pass) -> Result<Vec<Tally>, AnalysisError>,
) -> Result<Vec<Percentiles>, AnalysisError> {
    let ranks_of = |count: u64| -> Vec<u64> {
        let below = percentiles.iter().map(|percentile| position(*percentile, count).0);
        below.flat_map(|below| [below, (below + 1).min(count - 1)]).collect()
    };
    let found = order_statistics(groups, &ranks_of, room, trial, scan)?;
    let of_group = |(count, neighbours): (u64, Vec<f32>)| {
        let value = |(percentile, pair): (&f64, &[f32])| between(pair[0], pair[1], position(*percentile, count).1);
        Percentiles { count, values: percentiles.iter().zip(neighbours.chunks(2)).map(value).collect() }
    };
    Ok(found.into_iter().map(of_group).collect())
}

/// Finds, for every group, how many samples it has, and those of the ranks that `ranks_of(count)` names, in its order.
///
/// `scan(pass)` calls [`Tally::take`] for all samples, on any threads, and gives their tallies; it is asked several times.
///
/// # Errors
/// What `scan` gives.
fn order_statistics(
    groups: usize,
    ranks_of: &dyn Fn(u64) -> Vec<u64>,
    room: Room,
    trial: Trial,
    mut scan: impl FnMut(&Pass) -> Result<Vec<Tally>, AnalysisError>,
) -> Result<Vec<(u64, Vec<f32>)>, AnalysisError> {
    let bits = bits_for(groups, BITS, room);
    let mut pass =
        Pass { levels: Vec::new(), left: BITS, next: Next::Count(bits), cells: groups, is_trial: false, guess: None };
    if let Trial::Some(times) = trial {
        pass.is_trial = true;
        if let (Merged::Counts(counts), _) = Tally::merged(scan(&pass)?) {
            pass.guess = Guess::of(&counts, bits, times, ranks_of, room);
        }
        pass.is_trial = false;
    }
    let mut wanted: Vec<Wanted> = Vec::new();
    let mut counts = vec![0; groups];
    loop {
        let (merged, mut guessed) = Tally::merged(scan(&pass)?);
        match (pass.next, merged) {
            (Next::Count(bits), Merged::Counts(cells)) => {
                if pass.levels.is_empty() {
                    for (group, cells) in cells.chunks(1 << bits).enumerate() {
                        counts[group] = cells.iter().sum();
                        let ranks = if counts[group] == 0 { Vec::new() } else { ranks_of(counts[group]) };
                        wanted.extend(ranks.into_iter().map(|rank| Wanted {
                            group,
                            cell: group,
                            rank,
                            prefix: 0,
                            at: 0,
                            in_group: rank,
                        }));
                    }
                }
                let samples = pass.narrow(bits, &cells, &mut wanted);
                if let (Some(guess), Some(gathered)) = (pass.guess.take(), &mut guessed)
                    && wanted.iter().all(|wanted| guess.gathering(wanted.at).is_some())
                {
                    let before = guess.before(&cells);
                    for wanted in &mut wanted {
                        let gathering = guess.gathering(wanted.at).expect("all are gathered");
                        wanted.select(&mut gathered[gathering], wanted.in_group - before[gathering]);
                    }
                } else if pass.left > 0 && pass.cells > 0 {
                    let gathers = samples <= room.gathered;
                    pass.next = if gathers { Next::Gather } else { Next::Count(bits_for(pass.cells, pass.left, room)) };
                    continue;
                }
            }
            (_, Merged::Gathered(mut cells)) => {
                for wanted in &mut wanted {
                    wanted.select(&mut cells[wanted.cell], wanted.rank);
                }
            }
            (Next::Gather, Merged::Counts(_)) => unreachable!("a pass that gathers tallies samples"),
        }
        let mut found: Vec<(u64, Vec<f32>)> = counts.into_iter().map(|count| (count, Vec::new())).collect();
        wanted.iter().for_each(|wanted| found[wanted.group].1.push(f32::from_bits(wanted.prefix)));
        return Ok(found);
    }
}

/// By how many more bits so many cells can be split.
fn bits_for(cells: usize, left: u32, room: Room) -> u32 {
    (room.counters / cells.max(1)).max(2).ilog2().min(left).min(16)
}

/// An order statistic on the way to being found.
struct Wanted {
    group: usize,
    /// The cell it lies in.
    cell: usize,
    /// Its rank among the samples of that cell, from 0.
    rank: u64,
    /// Its upper bits, as far as they are known.
    prefix: u32,
    /// The place of its cell among all groups' parts, where it was narrowed last.
    at: usize,
    /// Its rank among all samples of its group.
    in_group: u64,
}

impl Wanted {
    /// Finds it by its rank among samples.
    fn select(&mut self, samples: &mut [u32], rank: u64) {
        self.prefix = *samples.select_nth_unstable(rank as usize).1;
    }
}

/// What a pass looks for.
pub(crate) struct Pass {
    /// By how many bits cells were split, and for each part the cell that it became, or [`NONE`].
    levels: Vec<(u32, Vec<u32>)>,
    /// Bits that are not known yet.
    left: u32,
    next: Next,
    /// The cells in which something is wanted; at first the groups.
    cells: usize,
    is_trial: bool,
    /// What the first pass gathers, too.
    guess: Option<Guess>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    Count(u32),
    Gather,
}

impl Pass {
    /// Whether it is the first over all samples.
    pub(crate) const fn is_first(&self) -> bool {
        self.levels.is_empty() && !self.is_trial
    }

    /// Whether it is the one over some of them.
    pub(crate) const fn is_trial(&self) -> bool {
        self.is_trial
    }

    /// The cell of a sample, if anything is wanted there.
    fn cell(&self, group: usize, sample: u32) -> Option<usize> {
        let (mut cell, mut left) = (group, BITS);
        for (bits, children) in &self.levels {
            left -= bits;
            match children[cell << bits | (sample >> left) as usize & ((1 << bits) - 1)] {
                NONE => return None,
                child => cell = child as usize,
            }
        }
        Some(cell)
    }

    /// Finds the parts of cells in which something is wanted; gives how many samples these have.
    fn narrow(&mut self, bits: u32, counts: &[u64], wanted: &mut [Wanted]) -> u64 {
        let mut children = vec![NONE; counts.len()];
        let (mut cells, mut samples) = (0, 0);
        for wanted in wanted {
            let first = wanted.cell << bits;
            let mut part = 0;
            while wanted.rank >= counts[first + part] {
                wanted.rank -= counts[first + part];
                part += 1;
            }
            wanted.at = first + part;
            let child = &mut children[first + part];
            if *child == NONE {
                *child = cells;
                cells += 1;
                samples += counts[first + part];
            }
            wanted.cell = *child as usize;
            wanted.prefix = wanted.prefix << bits | part as u32;
        }
        self.levels.push((bits, children));
        self.left -= bits;
        self.cells = cells as usize;
        samples
    }
}

/// What a thread has counted or gathered in a pass.
pub(crate) enum Tally {
    /// By cell and part, and at last what is no sample. A file has fewer than 2^32 rows.
    Counts(Vec<u32>),
    /// By cell.
    Gathered(Vec<Vec<u32>>),
    /// As of the first, and of the parts that are guessed their samples; `None` once they were too many.
    Both(Vec<u32>, Option<Vec<Vec<u32>>>),
}

/// What all threads have counted or gathered in a pass.
enum Merged {
    Counts(Vec<u64>),
    Gathered(Vec<Vec<u32>>),
}

impl Tally {
    /// Nothing yet.
    pub(crate) fn of(pass: &Pass) -> Self {
        match pass.next {
            Next::Count(bits) => {
                let counts = vec![0; (pass.cells << bits) + 1];
                match &pass.guess {
                    Some(guess) => Self::Both(counts, Some(vec![Vec::new(); guess.gatherings()])),
                    None => Self::Counts(counts),
                }
            }
            Next::Gather => Self::Gathered(vec![Vec::new(); pass.cells]),
        }
    }

    /// Takes samples, of which those in bin `b` are of group `first + b`; NaN is none, nor is one that is [`OUTSIDE`].
    pub(crate) fn take(&mut self, pass: &Pass, first: usize, bins: &[u32], samples: &[f32]) {
        let is_sample = |bin: u32, sample: f32| bin != OUTSIDE && !sample.is_nan();
        let rows = bins.iter().copied().zip(samples.iter().copied());
        // Of zero there are two.
        let number = |bin: u32, sample: f32| (first + bin as usize, sample.to_bits() & (u32::MAX >> 1));
        let samples =
            || rows.clone().filter(|(bin, sample)| is_sample(*bin, *sample)).map(|(bin, sample)| number(bin, sample));
        match (self, pass.next) {
            (Self::Both(counts, gathered), Next::Count(bits)) => {
                let (shift, none) = (pass.left - bits, counts.len() - 1);
                let mut taken = 0;
                for (bin, sample) in rows {
                    let (group, number) = number(bin, sample);
                    let part = group << bits | (number >> shift) as usize;
                    let part = if is_sample(bin, sample) { part } else { none };
                    counts[part] += 1;
                    let gathering = pass.guess.as_ref().and_then(|guess| guess.gathering(part));
                    if let (Some(gathered), Some(of)) = (gathered.as_mut(), gathering) {
                        gathered[of].push(number);
                        taken += 1;
                    }
                }
                if pass.guess.as_ref().is_some_and(|guess| !guess.has_room(taken)) {
                    *gathered = None;
                }
            }
            (Self::Counts(counts), Next::Count(bits)) if pass.levels.is_empty() => {
                let (shift, none) = (pass.left - bits, counts.len() - 1);
                for (bin, sample) in rows {
                    let (group, number) = number(bin, sample);
                    let part = group << bits | (number >> shift) as usize;
                    // Without a branch, which for one row in ten is guessed wrong too often.
                    counts[if is_sample(bin, sample) { part } else { none }] += 1;
                }
            }
            (Self::Counts(counts), Next::Count(bits)) => {
                let (shift, part) = (pass.left - bits, (1 << bits) - 1);
                for (group, sample) in samples() {
                    if let Some(cell) = pass.cell(group, sample) {
                        counts[cell << bits | (sample >> shift) as usize & part] += 1;
                    }
                }
            }
            (Self::Gathered(cells), _) => {
                for (group, sample) in samples() {
                    if let Some(cell) = pass.cell(group, sample) {
                        cells[cell].push(sample);
                    }
                }
            }
            (Self::Counts(_) | Self::Both(..), Next::Gather) => unreachable!("a tally is of its pass"),
        }
    }

    /// All threads' together, and what was gathered of a guess, if all threads kept it.
    fn merged(tallies: Vec<Self>) -> (Merged, Option<Vec<Vec<u32>>>) {
        let (mut counted, mut gathered): (Vec<u64>, Option<Vec<Vec<u32>>>) = (Vec::new(), None);
        let mut is_kept = true;
        for tally in tallies {
            let (counts, of) = match tally {
                Self::Counts(counts) => (counts, None),
                Self::Gathered(cells) => (Vec::new(), Some(cells)),
                Self::Both(counts, of) => {
                    is_kept &= of.is_some();
                    (counts, of)
                }
            };
            if counted.is_empty() {
                counted = counts.iter().copied().map(u64::from).collect();
            } else {
                counted.iter_mut().zip(counts).for_each(|(all, count)| *all += u64::from(count));
            }
            match (&mut gathered, of) {
                (Some(all), Some(cells)) => all.iter_mut().zip(cells).for_each(|(all, cell)| all.extend(cell)),
                (gathered, Some(cells)) => *gathered = Some(cells),
                (_, None) => {}
            }
        }
        match (counted.is_empty(), gathered) {
            (true, gathered) => (Merged::Gathered(gathered.unwrap_or_default()), None),
            (false, gathered) => {
                // At last stands what was no sample.
                counted.pop();
                (Merged::Counts(counted), gathered.filter(|_| is_kept))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn found(groups: usize, samples: &[(u32, f32)], room: Room) -> Vec<(u64, Vec<f32>)> {
        let tried = tried(groups, samples, room, 3);
        assert_eq!(tried, tried_by(groups, samples, room, Trial::None, 1).0);
        tried
    }

    /// A trial takes every so many-th sample.
    fn tried(groups: usize, samples: &[(u32, f32)], room: Room, step: usize) -> Vec<(u64, Vec<f32>)> {
        tried_by(groups, samples, room, Trial::Some(step as f64), step).0
    }

    /// And how many passes there were over all samples.
    fn tried_by(
        groups: usize,
        samples: &[(u32, f32)],
        room: Room,
        trial: Trial,
        step: usize,
    ) -> (Vec<(u64, Vec<f32>)>, usize) {
        let mut passes = 0;
        let ranks = |count: u64| vec![0, count / 2, count / 2, count - 1];
        let halves = samples.split_at(samples.len() / 2);
        let scan = |pass: &Pass| {
            passes += usize::from(!pass.is_trial());
            let tallies = [halves.0, halves.1].map(|half| {
                let mut tally = Tally::of(pass);
                let some = half.iter().copied().step_by(if pass.is_trial() { step } else { 1 });
                let (bins, values): (Vec<u32>, Vec<f32>) = some.unzip();
                tally.take(pass, 0, &bins, &values);
                tally
            });
            Ok(Vec::from(tallies))
        };
        let found = order_statistics(groups, &ranks, room, trial, scan).unwrap();
        (found, passes)
    }

    fn sorted(groups: usize, samples: &[(u32, f32)]) -> Vec<(u64, Vec<f32>)> {
        let of_group = |group: u32| {
            let of = samples.iter().filter(|(bin, value)| *bin == group && !value.is_nan());
            let mut values: Vec<f32> = of.map(|(_, value)| *value).collect();
            values.sort_by(f32::total_cmp);
            let at = |rank: usize| values.get(rank).copied();
            let wanted = [at(0), at(values.len() / 2), at(values.len() / 2), at(values.len().wrapping_sub(1))];
            (values.len() as u64, wanted.into_iter().flatten().collect())
        };
        (0..groups as u32).map(of_group).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn ranks_are_those_of_sorting_however_little_room_there_is(
            samples in prop::collection::vec(
                (prop_oneof![8 => 0_u32..5, 1 => Just(OUTSIDE)],
                 prop_oneof![1 => Just(f32::NAN), 1 => Just(0.5_f32), 1 => Just(0.0), 4 => 0.0_f32..100.0, 1 => 0.0_f32..1e-6]),
                0..400,
            ),
        ) {
            let sorted = sorted(5, &samples);
            for room in [Room::for_threads(2), Room { counters: 64, gathered: 0 }, Room { counters: 20, gathered: 10 }] {
                prop_assert_eq!(&found(5, &samples, room), &sorted, "{:?}", room);
            }
        }
    }

    #[test]
    fn after_a_trial_one_pass_does_and_where_it_was_wrong_two() {
        let alike: Vec<(u32, f32)> =
            (0..40_000).map(|at: u32| (at % 3, at.wrapping_mul(2_654_435_761) as f32 / 4e9 + 0.5)).collect();
        let room = Room { counters: 1 << 20, gathered: 20_000 };
        // The least and the greatest are in the trial, too.
        let mut ends = alike.clone();
        (0..3).for_each(|group| ends.extend([(group, 0.1); 32].into_iter().chain([(group, 9.0); 32])));
        let (found, passes) = tried_by(3, &ends, room, Trial::Some(4.0), 4);
        assert_eq!((found, passes), (sorted(3, &ends), 1));
        // Where a trial saw others than most, the median is elsewhere.
        let of = |at: u16| if at.is_multiple_of(4) { f32::from(1 + at / 4 % 100) } else { 20.0 };
        let drifting: Vec<(u32, f32)> = (0..40_000).map(|at| (0, of(at))).collect();
        let (found, passes) = tried_by(1, &drifting, room, Trial::Some(4.0), 4);
        assert_eq!((found, passes), (sorted(1, &drifting), 2));
    }

    #[test]
    fn farthest_and_smallest_numbers_keep_their_bits() {
        let samples = [(0, f32::MAX), (0, f32::MIN_POSITIVE), (0, f32::INFINITY), (0, 1e-45), (0, -0.0)];
        let expected = vec![(5, vec![0.0, f32::MIN_POSITIVE, f32::MIN_POSITIVE, f32::INFINITY])];
        assert_eq!(found(1, &samples, Room::for_threads(2)), expected);
    }
}
