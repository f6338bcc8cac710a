//! Percentiles of samples of one metre that do not fit in memory: exact selection by counting, in three passes.
//!
//! An error is an integer of 32 bits that sorts as the error does. The first pass counts the errors by their upper 11 bits; from
//! the counts follows in which cell each wanted order statistic lies, and which of that cell it is. The second pass splits those
//! cells by the next 11 bits, the third by the last 10: what is left are single values. A pass holds counts only: 2048 in the
//! first, and for at most 20 cells 2048 and 1024 in the others.

use super::sample::{Which, error_bits, error_from_bits};
use super::spread::{PERCENTILES, Spread, between, position};
use crate::error::AnalysisError;

/// How many bits of an error each pass looks at.
const BITS: [u32; 3] = [11, 11, 10];
/// No cell of interest.
const NONE: u32 = u32::MAX;

/// How the errors of a metre spread, all that were answered and those that are shared. `visit(f)` calls `f(samples)` for all
/// samples, and does so again when asked again.
pub(super) fn spreads(
    visit: impl Fn(&mut dyn FnMut(&[u32])) -> Result<(), AnalysisError>,
) -> Result<[Option<Spread>; 2], AnalysisError> {
    let mut cells = Cells { children: Vec::new() };
    let mut counts = Counts::of(1 << BITS[0]);
    visit(&mut |samples| {
        for &sample in samples {
            counts.add(sample, (error_bits(sample) >> (32 - BITS[0])) as usize);
        }
    })?;
    let whiches = [Which::Answered, Which::Shared].map(|which| (which, counts.all(which)));
    let mut wanted: Vec<Wanted> = Vec::new();
    for (which, count) in whiches.into_iter().filter(|(_, count)| *count > 0) {
        wanted.extend(order_statistics(which, count));
    }
    for pass in 0..BITS.len() {
        let groups = cells.narrow(pass, &counts, &mut wanted);
        let Some(&bits) = BITS.get(pass + 1) else { break };
        counts = Counts::of(groups << bits);
        let shift = 32 - BITS[..=pass + 1].iter().sum::<u32>();
        visit(&mut |samples| {
            for &sample in samples {
                let error = error_bits(sample);
                if let Some(group) = cells.group(error) {
                    counts.add(sample, group << bits | (error >> shift) as usize & ((1 << bits) - 1));
                }
            }
        })?;
    }
    let mut found = wanted.chunks(2 * PERCENTILES.len());
    Ok(whiches.map(|(_, count)| {
        let wanted = (count > 0).then(|| found.next()).flatten()?;
        let mut percentiles_m = [f64::NAN; PERCENTILES.len()];
        for ((percentile_m, pair), percentile) in percentiles_m.iter_mut().zip(wanted.chunks(2)).zip(PERCENTILES) {
            let [lower, upper] = [0, 1].map(|i: usize| error_from_bits(pair[i].bits));
            *percentile_m = between(lower, upper, position(percentile, count).1);
        }
        Some(Spread { count, percentiles_m })
    }))
}

/// How many samples are in each cell, those that are [shared](Which::Shared) and those that are not: a sample is looked up once,
/// whichever percentiles it counts for.
struct Counts {
    shared: Vec<u64>,
    alone: Vec<u64>,
}

impl Counts {
    fn of(cells: usize) -> Self {
        Self { shared: vec![0; cells], alone: vec![0; cells] }
    }

    fn add(&mut self, sample: u32, cell: usize) {
        let counts = if Which::Shared.has(sample) { &mut self.shared } else { &mut self.alone };
        counts[cell] += 1;
    }

    fn in_cell(&self, which: Which, cell: usize) -> u64 {
        match which {
            Which::Answered => self.shared[cell] + self.alone[cell],
            Which::Shared => self.shared[cell],
        }
    }

    fn all(&self, which: Which) -> u64 {
        (0..self.shared.len()).map(|cell| self.in_cell(which, cell)).sum()
    }
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

/// The two samples beside each percentile; at first they are anywhere.
fn order_statistics(which: Which, count: u64) -> impl Iterator<Item = Wanted> {
    PERCENTILES.into_iter().flat_map(move |percentile| {
        let lower = position(percentile, count).0;
        [lower, (lower + 1).min(count - 1)].map(|rank| Wanted { which, group: 0, rank, bits: 0 })
    })
}

/// The cells in which something is wanted, pass by pass: for a group and its cell, the group that cell became, or [`NONE`].
struct Cells {
    children: Vec<Vec<u32>>,
}

impl Cells {
    /// The group a sample lies in, if anything is wanted there.
    fn group(&self, error: u32) -> Option<usize> {
        let (mut group, mut left) = (0, 32);
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
            while wanted.rank >= counts.in_cell(wanted.which, first + cell) {
                wanted.rank -= counts.in_cell(wanted.which, first + cell);
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
