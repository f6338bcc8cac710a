//! Percentiles of samples that do not fit in memory: exact selection by counting, in three passes.
//!
//! An error is an integer of 32 bits that sorts as the error does. The first pass counts, metre by metre, the errors by their
//! upper 11 bits; from the counts follows in which cell each wanted order statistic lies, and which of that cell it is. The
//! second pass splits those cells by the next 11 bits, the third by the last 10: what is left are single values. A pass holds
//! counts only: 2048 a metre in the first, and for at most 10 cells a metre 2048 and 1024 in the others.

use super::samples::{Which, error_from_bits};
use super::{PERCENTILES, Spread, between, position};
use crate::error::AnalysisError;

/// How many bits of an error each pass looks at.
const BITS: [u32; 3] = [11, 11, 10];
/// No cell of interest.
const NONE: u32 = u32::MAX;

/// How the errors of an estimator spread: for each of `whiches`, by metre. `visit(f)` calls `f(metre, samples)` for all samples,
/// and does so again when asked again.
pub(super) fn spreads(
    whiches: &[Which],
    visit: impl Fn(&mut dyn FnMut(u32, &[u32])) -> Result<(), AnalysisError>,
) -> Result<Vec<Vec<Option<Spread>>>, AnalysisError> {
    let mut cells = Cells { children: Vec::new() };
    let mut counts = Counts::default();
    visit(&mut |metre, samples| {
        let first = (metre as usize) << BITS[0];
        counts.grow(first + (1 << BITS[0]));
        for &sample in samples {
            counts.add(sample, first + (error_bits(sample) >> (32 - BITS[0])) as usize);
        }
    })?;
    let counts_by_metre: Vec<Vec<u64>> = whiches.iter().map(|which| counts.by_metre(*which)).collect();
    let mut wanted: Vec<Wanted> = Vec::new();
    for (which, counts) in whiches.iter().zip(&counts_by_metre) {
        let full = counts.iter().enumerate().filter(|(_, count)| **count > 0);
        wanted.extend(full.flat_map(|(metre, count)| order_statistics(*which, metre, *count)));
    }
    for pass in 0..BITS.len() {
        let groups = cells.narrow(pass, &counts, &mut wanted);
        let Some(&bits) = BITS.get(pass + 1) else { break };
        counts = Counts::default();
        counts.grow(groups << bits);
        let shift = 32 - BITS[..=pass + 1].iter().sum::<u32>();
        visit(&mut |metre, samples| {
            for &sample in samples {
                let error = error_bits(sample);
                if let Some(group) = cells.group(metre, error) {
                    counts.add(sample, group << bits | (error >> shift) as usize & ((1 << bits) - 1));
                }
            }
        })?;
    }
    let mut found = wanted.chunks(2 * PERCENTILES.len());
    let mut spread = |count: &u64| {
        let wanted = (*count > 0).then(|| found.next()).flatten()?;
        let mut percentiles_m = [f64::NAN; 5];
        for ((percentile_m, pair), percentile) in percentiles_m.iter_mut().zip(wanted.chunks(2)).zip(PERCENTILES) {
            let [lower, upper] = [0, 1].map(|i: usize| error_from_bits(pair[i].bits));
            *percentile_m = between(lower, upper, position(percentile, *count).1);
        }
        Some(Spread { count: *count, percentiles_m })
    };
    Ok(counts_by_metre.iter().map(|counts| counts.iter().map(&mut spread).collect()).collect())
}

/// How many samples are in each cell, those that are [shared](Which::Shared) and those that are not: a sample is looked up once,
/// whichever percentiles it counts for.
#[derive(Default)]
struct Counts {
    shared: Vec<u64>,
    alone: Vec<u64>,
}

impl Counts {
    /// Makes room for so many cells.
    fn grow(&mut self, cells: usize) {
        if self.shared.len() < cells {
            self.shared.resize(cells, 0);
            self.alone.resize(cells, 0);
        }
    }

    fn add(&mut self, sample: u32, cell: usize) {
        let counts = if Which::Shared.bits(sample).is_some() { &mut self.shared } else { &mut self.alone };
        counts[cell] += 1;
    }

    fn of(&self, which: Which, cell: usize) -> u64 {
        match which {
            Which::Answered => self.shared[cell] + self.alone[cell],
            Which::Shared => self.shared[cell],
        }
    }

    /// The counts of the first pass, metre by metre.
    fn by_metre(&self, which: Which) -> Vec<u64> {
        let metres = self.shared.len() >> BITS[0];
        (0..metres)
            .map(|metre| (metre << BITS[0]..(metre + 1) << BITS[0]).map(|cell| self.of(which, cell)).sum())
            .collect()
    }
}

/// The error's bits of any sample.
fn error_bits(sample: u32) -> u32 {
    Which::Answered.bits(sample).unwrap_or(sample)
}

/// An order statistic on the way to being found.
struct Wanted {
    /// Among which samples.
    which: Which,
    /// The counted group it lies in.
    group: usize,
    /// Its rank among the samples of that group, from 0.
    rank: u64,
    /// Its upper bits, as far as they are known.
    bits: u32,
}

/// The two samples beside each percentile; at first they are somewhere in their metre.
fn order_statistics(which: Which, metre: usize, count: u64) -> impl Iterator<Item = Wanted> {
    PERCENTILES.into_iter().flat_map(move |percentile| {
        let lower = position(percentile, count).0;
        [lower, (lower + 1).min(count - 1)].map(|rank| Wanted { which, group: metre, rank, bits: 0 })
    })
}

/// The cells in which something is wanted, pass by pass: for a group and its cell, the group that cell became, or [`NONE`].
struct Cells {
    children: Vec<Vec<u32>>,
}

impl Cells {
    /// The group a sample lies in, if anything is wanted there.
    fn group(&self, metre: u32, error: u32) -> Option<usize> {
        let (mut group, mut left) = (metre as usize, 32);
        for (children, bits) in self.children.iter().zip(BITS) {
            left -= bits;
            let cell = (error >> left) as usize & ((1 << bits) - 1);
            match children[group << bits | cell] {
                NONE => return None,
                child => group = child as usize,
            }
        }
        Some(group)
    }

    /// Finds the cell of everything wanted from the counts of a pass; gives the number of cells found, the next pass's groups.
    fn narrow(&mut self, pass: usize, counts: &Counts, wanted: &mut [Wanted]) -> usize {
        let bits = BITS[pass];
        let mut children = vec![NONE; counts.shared.len()];
        let mut groups = 0;
        for wanted in wanted {
            let first = wanted.group << bits;
            let mut cell = 0;
            while wanted.rank >= counts.of(wanted.which, first + cell) {
                wanted.rank -= counts.of(wanted.which, first + cell);
                cell += 1;
            }
            let child = &mut children[first + cell];
            if *child == NONE {
                *child = groups;
                groups += 1;
            }
            wanted.group = *child as usize;
            wanted.bits = wanted.bits << bits | cell as u32;
        }
        self.children.push(children);
        groups as usize
    }
}
