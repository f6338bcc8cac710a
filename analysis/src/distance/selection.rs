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
    let mut selections: Vec<Selection> = whiches.iter().map(|which| Selection::new(*which)).collect();
    for pass in 0..BITS.len() {
        visit(&mut |metre, samples| selections.iter_mut().for_each(|of| of.count(pass, metre, samples)))?;
        selections.iter_mut().for_each(|of| of.narrow(pass));
    }
    Ok(selections.into_iter().map(Selection::spreads).collect())
}

/// Some of the samples on the way to their percentiles.
struct Selection {
    which: Which,
    cells: Cells,
    counts: Vec<u64>,
    wanted: Vec<Wanted>,
    /// By metre: how many there are.
    counts_by_metre: Vec<u64>,
}

impl Selection {
    const fn new(which: Which) -> Self {
        let cells = Cells { children: Vec::new() };
        Self { which, cells, counts: Vec::new(), wanted: Vec::new(), counts_by_metre: Vec::new() }
    }

    fn count(&mut self, pass: usize, metre: u32, samples: &[u32]) {
        let errors = samples.iter().filter_map(|sample| self.which.bits(*sample));
        if pass == 0 {
            let first = (metre as usize) << BITS[0];
            if self.counts.len() < first + (1 << BITS[0]) {
                self.counts.resize(first + (1 << BITS[0]), 0);
            }
            let counts = &mut self.counts[first..first + (1 << BITS[0])];
            errors.for_each(|error| counts[(error >> (32 - BITS[0])) as usize] += 1);
            return;
        }
        let bits = BITS[pass];
        let shift = 32 - BITS[..=pass].iter().sum::<u32>();
        for error in errors {
            if let Some(group) = self.cells.group(metre, error) {
                self.counts[group << bits | (error >> shift) as usize & ((1 << bits) - 1)] += 1;
            }
        }
    }

    /// Ends a pass: the cells it counted in become the next one's groups.
    fn narrow(&mut self, pass: usize) {
        if pass == 0 {
            self.counts_by_metre = self.counts.chunks(1 << BITS[0]).map(|counts| counts.iter().sum()).collect();
            let full = self.counts_by_metre.iter().enumerate().filter(|(_, count)| **count > 0);
            self.wanted = full.flat_map(|(metre, count)| order_statistics(metre, *count)).collect();
        }
        let groups = self.cells.narrow(pass, &self.counts, &mut self.wanted);
        self.counts = vec![0; BITS.get(pass + 1).map_or(0, |bits| groups << bits)];
    }

    fn spreads(self) -> Vec<Option<Spread>> {
        let mut found = self.wanted.chunks(2 * PERCENTILES.len());
        let spread = |count: u64| {
            let wanted = (count > 0).then(|| found.next()).flatten()?;
            let mut percentiles_m = [f64::NAN; 5];
            for ((percentile_m, pair), percentile) in percentiles_m.iter_mut().zip(wanted.chunks(2)).zip(PERCENTILES) {
                let [lower, upper] = [0, 1].map(|i: usize| error_from_bits(pair[i].bits));
                *percentile_m = between(lower, upper, position(percentile, count).1);
            }
            Some(Spread { count, percentiles_m })
        };
        self.counts_by_metre.into_iter().map(spread).collect()
    }
}

/// An order statistic on the way to being found.
struct Wanted {
    /// The counted group it lies in.
    group: usize,
    /// Its rank among the samples of that group, from 0.
    rank: u64,
    /// Its upper bits, as far as they are known.
    bits: u32,
}

/// The two samples beside each percentile; at first they are somewhere in their metre.
fn order_statistics(metre: usize, count: u64) -> impl Iterator<Item = Wanted> {
    PERCENTILES.into_iter().flat_map(move |percentile| {
        let lower = position(percentile, count).0;
        [lower, (lower + 1).min(count - 1)].map(|rank| Wanted { group: metre, rank, bits: 0 })
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
    fn narrow(&mut self, pass: usize, counts: &[u64], wanted: &mut [Wanted]) -> usize {
        let bits = BITS[pass];
        let mut children = vec![NONE; counts.len()];
        let mut groups = 0;
        for wanted in wanted {
            let first = wanted.group << bits;
            let mut cell = 0;
            while wanted.rank >= counts[first + cell] {
                wanted.rank -= counts[first + cell];
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
