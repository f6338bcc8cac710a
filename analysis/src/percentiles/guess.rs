//! Where wanted order statistics are likely to be, by a trial over some of the samples: so that the pass that counts can gather them, too, and is the last one.

use std::sync::atomic::{AtomicU64, Ordering};

use super::{NONE, Room};

/// The share of a group's samples by which a rank may be off beside chance, for parts of a file are not quite alike.
const DRIFT: f64 = 0.001;
/// Standard deviations of chance that are allowed for: of thousands of ranks none should be missed.
const DEVIATIONS: f64 = 4.5;

/// The parts of groups whose samples are gathered on trial.
pub(super) struct Guess {
    /// By group and part, the number of the gathering that takes its samples, or [`NONE`].
    parts: Vec<u32>,
    bits: u32,
    /// By gathering, the first of the parts that it takes; they lie side by side.
    starts: Vec<usize>,
    /// So many samples may be gathered, and are.
    most: u64,
    taken: AtomicU64,
}

impl Guess {
    /// From the counts of a trial by group and part, each split by so many bits; of `times` as many samples all together. `None` if too many would be gathered.
    pub(super) fn of(
        counts: &[u64],
        bits: u32,
        times: f64,
        ranks_of: &dyn Fn(u64) -> Vec<u64>,
        room: Room,
    ) -> Option<Self> {
        let most = 2 * room.gathered;
        let mut parts = vec![NONE; counts.len()];
        let (mut starts, mut gathered) = (Vec::new(), 0);
        for (group, counts) in counts.chunks(1 << bits).enumerate() {
            let all: u64 = counts.iter().sum();
            let ranges: Vec<(u64, u64)> = match all {
                0 => Vec::new(),
                _ => ranks_of(all).into_iter().map(|rank| range(rank, all)).collect(),
            };
            // Of a group of few samples all are taken, of whatever part.
            let is_whole = ranges.iter().map(|(from, to)| to - from).sum::<u64>() >= all;
            let (mut before, mut is_beside) = (0, false);
            for (part, of) in counts.iter().enumerate() {
                // A part that the trial found empty may be the one, too.
                let is_near = is_whole || ranges.iter().any(|(from, to)| before <= *to && before + of >= *from);
                if is_near {
                    let place = group << bits | part;
                    if !is_beside {
                        starts.push(place);
                    }
                    parts[place] = (starts.len() - 1) as u32;
                    gathered += of;
                }
                is_beside = is_near;
                before += of;
            }
        }
        let is_likely_to_fit = gathered as f64 * times <= most as f64;
        let guess = Self { parts, bits, starts, most, taken: AtomicU64::new(0) };
        is_likely_to_fit.then_some(guess)
    }

    /// Which gathering takes the samples of a place among all groups' parts.
    pub(super) fn gathering(&self, place: usize) -> Option<usize> {
        self.parts.get(place).filter(|of| **of != NONE).map(|of| *of as usize)
    }

    /// How many gatherings there are.
    pub(super) const fn gatherings(&self) -> usize {
        self.starts.len()
    }

    /// By gathering, how many samples of its group are less than its own; from the counts of all samples.
    pub(super) fn before(&self, counts: &[u64]) -> Vec<u64> {
        let of = |start: &usize| counts[start >> self.bits << self.bits..*start].iter().sum();
        self.starts.iter().map(of).collect()
    }

    /// Says that so many more were gathered, and whether that is not too many.
    pub(super) fn has_room(&self, more: u64) -> bool {
        self.taken.fetch_add(more, Ordering::Relaxed) + more <= self.most
    }
}

/// Between which ranks that of a trial's samples lies among all, in their measure.
fn range(rank: u64, all: u64) -> (u64, u64) {
    let share = rank as f64 / all as f64;
    let chance = DEVIATIONS * (all as f64 * share * (1.0 - share)).sqrt();
    let off = (DRIFT * all as f64 + chance).ceil() as u64 + 2;
    (rank.saturating_sub(off), (rank + off + 1).min(all))
}
