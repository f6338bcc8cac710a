//! Counts, means and shares by bin.
//!
//! This is a loop over plain numbers: queries with lazy polars or with its column iterators took twice the CPU time
//! (`bench/analysis.sh`). The sums of parts are added in the order of the parts, so that the result does not depend on
//! the order of threads.

use std::collections::BTreeMap;

use super::{Outlier, Unit};

/// The sums of a part.
pub(super) struct PartSums {
    /// Pixels by bin, then those outside of all bins.
    pixels: Vec<u64>,
    /// The same for each estimate.
    estimates: Vec<Vec<Sums>>,
}

impl PartSums {
    /// Counts rows with these bin numbers; `count` is the number of bins.
    pub(super) fn new(bins: &[u32], count: usize) -> Self {
        let mut pixels = vec![0; count + 1];
        bins.iter().for_each(|bin| pixels[(*bin as usize).min(count)] += 1);
        Self { pixels, estimates: Vec::new() }
    }

    /// Adds the rows of the next estimate. Its values, NaN where invalid, are replaced by absolute errors.
    pub(super) fn add(
        &mut self,
        bins: &[u32],
        ground_truth_m: &[f32],
        estimates: &mut [f32],
        unit: Unit,
        outlier: Outlier,
    ) {
        let rows = bins.iter().zip(ground_truth_m).zip(estimates);
        let mut sums = vec![Sums::default(); self.pixels.len()];
        match (unit, outlier) {
            (Unit::Metres, Outlier::Metres(limit)) => add_rows(&mut sums, rows, |error, _| error, |_| limit),
            (Unit::Metres, Outlier::OfTruth(limit)) => {
                add_rows(&mut sums, rows, |error, _| error, |truth| limit * truth);
            }
            (Unit::OfTruth, Outlier::Metres(limit)) => {
                add_rows(&mut sums, rows, |error, truth| error / truth, |truth| limit / truth);
            }
            (Unit::OfTruth, Outlier::OfTruth(limit)) => {
                add_rows(&mut sums, rows, |error, truth| error / truth, |_| limit);
            }
        }
        self.estimates.push(sums);
    }

    /// The bins with pixels, in order.
    pub(super) fn bins(self) -> Vec<(usize, BinSums)> {
        let (_outside, bins) = self.pixels.split_last().expect("`pixels` has one more entry than bins");
        let bin_sums = |(bin, pixels): (usize, &u64)| {
            let estimates = self.estimates.iter().map(|sums| sums[bin]).collect();
            (*pixels > 0).then_some((bin, BinSums { pixels: *pixels, estimates }))
        };
        bins.iter().enumerate().filter_map(bin_sums).collect()
    }
}

/// Adds rows: bin, ground truth and estimate, which is replaced by the absolute error. `error` converts an error in
/// metres to the unit; `limit` is the limit of outliers.
fn add_rows<'a>(
    sums: &mut [Sums],
    rows: impl Iterator<Item = ((&'a u32, &'a f32), &'a mut f32)>,
    error: impl Fn(f64, f64) -> f64,
    limit: impl Fn(f64) -> f64,
) {
    let last = sums.len() - 1;
    for ((bin, truth), estimate) in rows {
        let truth = f64::from(*truth);
        let error = error(f64::from(*estimate) - truth, truth);
        let size = error.abs();
        *estimate = size as f32;
        // Invalid rows add zeros, because a branch would be mispredicted too often.
        let is_valid = !error.is_nan();
        let (error, size) = if is_valid { (error, size) } else { (0.0, 0.0) };
        let sums = &mut sums[(*bin as usize).min(last)];
        sums.count += u64::from(is_valid);
        sums.absolute += size;
        sums.signed += error;
        sums.squared += error * error;
        sums.outlier += u64::from(size > limit(truth));
    }
}

/// The sums of a bin.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BinSums {
    pub(super) pixels: u64,
    /// One entry per estimate.
    pub(super) estimates: Vec<Sums>,
}

/// The sums of an estimate in a bin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sums {
    pub(super) count: u64,
    pub(super) absolute: f64,
    pub(super) signed: f64,
    pub(super) squared: f64,
    pub(super) outlier: u64,
    /// The rounding errors of the three sums.
    excess: [f64; 3],
}

impl Sums {
    /// Adds the sums of another part, with Kahan's compensation.
    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.outlier += other.outlier;
        let sums = [&mut self.absolute, &mut self.signed, &mut self.squared];
        let others = [other.absolute, other.signed, other.squared];
        for ((sum, excess), other) in sums.into_iter().zip(&mut self.excess).zip(others) {
            let more = other - *excess;
            let new = *sum + more;
            *excess = (new - *sum) - more;
            *sum = new;
        }
    }
}

/// The sums of all parts by bin.
pub(super) fn total(parts: impl Iterator<Item = Vec<(usize, BinSums)>>) -> BTreeMap<usize, BinSums> {
    let mut total: BTreeMap<usize, BinSums> = BTreeMap::new();
    for (bin, sums) in parts.flatten() {
        match total.get_mut(&bin) {
            Some(all) => {
                all.pixels += sums.pixels;
                all.estimates.iter_mut().zip(&sums.estimates).for_each(|(all, sums)| all.add(sums));
            }
            None => {
                total.insert(bin, sums);
            }
        }
    }
    total
}
