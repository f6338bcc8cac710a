//! Percentiles of samples that do not fit in memory: exact selection by counting, in three passes.
//!
//! An error is an integer of 32 bits that sorts as the error does. The first pass counts, metre by metre, the errors by their
//! upper 11 bits; from the counts follows in which cell each wanted order statistic lies, and which of that cell it is. The
//! second pass splits those cells by the next 11 bits, the third by the last 10: what is left are single values. A pass holds
//! counts only: 2048 a metre in the first, and for at most 10 cells a metre 2048 and 1024 in the others.

use std::io;

use super::samples::error_from_bits;
use super::{DistanceBin, PERCENTILES};

/// How many bits of an error each pass looks at.
const BITS: [u32; 3] = [11, 11, 10];
/// No cell of interest.
const NONE: u32 = u32::MAX;

/// The bins of one estimator, nearest first. `visit(f)` calls `f(metre, errors)` for all samples, and does so again when asked
/// again.
pub(super) fn percentiles(
    estimator: usize,
    visit: impl Fn(&mut dyn FnMut(u32, &[u32])) -> io::Result<()>,
) -> io::Result<Vec<DistanceBin>> {
    let mut cells = Cells { children: Vec::new() };
    let mut counts: Vec<u64> = Vec::new();
    visit(&mut |metre, errors| {
        let first = (metre as usize) << BITS[0];
        if counts.len() < first + (1 << BITS[0]) {
            counts.resize(first + (1 << BITS[0]), 0);
        }
        let counts = &mut counts[first..];
        errors.iter().for_each(|error| counts[(error >> (32 - BITS[0])) as usize] += 1);
    })?;
    let mut bins: Vec<DistanceBin> = Vec::new();
    let mut wanted: Vec<Wanted> = Vec::new();
    for (metre, counts) in counts.chunks(1 << BITS[0]).enumerate() {
        let count = counts.iter().sum();
        if count > 0 {
            wanted.extend(order_statistics(metre, count));
            bins.push(DistanceBin { estimator, bin_m: metre as u32, count, percentiles_m: [f64::NAN; 5] });
        }
    }
    for pass in 0..BITS.len() {
        let groups = cells.narrow(pass, &counts, &mut wanted);
        if let Some(&bits) = BITS.get(pass + 1) {
            counts = vec![0; groups << bits];
            let shift = 32 - BITS[..=pass + 1].iter().sum::<u32>();
            visit(&mut |metre, errors| {
                for &error in errors {
                    if let Some(group) = cells.group(metre, error) {
                        counts[group << bits | (error >> shift) as usize & ((1 << bits) - 1)] += 1;
                    }
                }
            })?;
        }
    }
    for (bin, wanted) in bins.iter_mut().zip(wanted.chunks(2 * PERCENTILES.len())) {
        let pairs = wanted.chunks(2).zip(PERCENTILES);
        bin.percentiles_m = std::array::from_fn(|_| f64::NAN);
        for (percentile_m, (pair, percentile)) in bin.percentiles_m.iter_mut().zip(pairs) {
            let [lower, upper] = [0, 1].map(|i: usize| f64::from(error_from_bits(pair[i].bits)));
            *percentile_m = lower + (upper - lower) * position(percentile, bin.count).1;
        }
    }
    Ok(bins)
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

/// Where a percentile lies among `count` sorted samples: the rank below it, and how far it is from there to the next.
fn position(percentile: u32, count: u64) -> (u64, f64) {
    let exact = f64::from(percentile) / 100.0 * (count - 1) as f64;
    (exact.floor() as u64, exact - exact.floor())
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
