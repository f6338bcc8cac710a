//! The sums of a row of metrics, computed block by block.

use crate::ln::ln;
use crate::pixels::{CHUNK, EachChunk};
use crate::row::ScoreRow;
use crate::{DEPTH, ScaleInvariant, Settings, SquaredRelative};

/// Pixels of a block: short enough for the first cache, long enough that its end costs nothing.
const BLOCK: usize = CHUNK;
/// Partial sums kept side by side, so that additions vectorise; their number fixes the result's bits.
const LANES: usize = 8;

/// The sums over the pixels with an estimate, and over those without one as far as they count.
pub(crate) struct ValidAndMissing {
    valid: Blocks,
    missing: Blocks,
    /// What a missing estimate counts as, metres; `None`: it does not count.
    missing_m: Option<f64>,
}

impl ValidAndMissing {
    pub(crate) const fn new(missing_m: Option<f64>) -> Self {
        Self { valid: Blocks::new(), missing: Blocks::new(), missing_m }
    }

    /// Over the valid pixels, and over the missing ones.
    pub(crate) fn finish(self) -> [Sums; 2] {
        [self.valid.finish(), self.missing.finish()]
    }
}

impl EachChunk for ValidAndMissing {
    #[inline(always)]
    fn chunk(&mut self, ground_truth_m: &[f32], estimate_m: &[f64]) {
        let is_complete = self.valid.extend(ground_truth_m, estimate_m);
        if let (Some(missing_m), false) = (self.missing_m, is_complete) {
            let mut replaced = [f64::NAN; CHUNK];
            for (replaced, y) in replaced.iter_mut().zip(estimate_m) {
                *replaced = if y.is_nan() { missing_m } else { f64::NAN };
            }
            self.missing.extend(ground_truth_m, &replaced);
        }
    }
}

/// Pixels on their way into [`Sums`].
struct Blocks {
    /// Truth and estimate, metres.
    t: [f64; 2 * BLOCK],
    y: [f64; 2 * BLOCK],
    /// How many pixels wait, less than a block.
    waiting: usize,
    sums: Sums,
}

impl Blocks {
    const fn new() -> Self {
        Self { t: [1.0; 2 * BLOCK], y: [1.0; 2 * BLOCK], waiting: 0, sums: Sums::EMPTY }
    }

    /// Adds the pixels of a chunk whose estimate is not NaN: truth and estimate, metres, both positive. Returns whether
    /// these are all.
    #[inline(always)]
    fn extend(&mut self, t: &[f32], y: &[f64]) -> bool {
        let mut waiting = self.waiting;
        for (&t, &y) in t.iter().zip(y) {
            // Without a branch: valid pixels have no pattern to predict.
            (self.t[waiting], self.y[waiting]) = (f64::from(t), y);
            waiting += usize::from(!y.is_nan());
        }
        let is_complete = waiting - self.waiting == y.len();
        if let Some(more) = waiting.checked_sub(BLOCK) {
            let ([t, _], [y, _]) = (halves(&self.t), halves(&self.y));
            self.sums.add_block(t, y, BLOCK);
            self.t.copy_within(BLOCK..waiting, 0);
            self.y.copy_within(BLOCK..waiting, 0);
            waiting = more;
        }
        self.waiting = waiting;
        is_complete
    }

    fn finish(mut self) -> Sums {
        self.t[self.waiting..].fill(1.0);
        self.y[self.waiting..].fill(1.0);
        let ([t, _], [y, _]) = (halves(&self.t), halves(&self.y));
        self.sums.add_block(t, y, self.waiting);
        self.sums
    }
}

#[inline(always)]
fn halves(both: &[f64; 2 * BLOCK]) -> [&[f64; BLOCK]; 2] {
    let (first, second) = both.split_at(BLOCK);
    [first, second].map(|half| half.try_into().expect("half as many"))
}

/// The sums over some pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sums {
    pixels: u64,
    within: [u64; 3],
    relative: f64,
    squared_by_truth: f64,
    squared_by_truth_squared: f64,
    squared: f64,
    log_squared: f64,
    /// Mean of the log error, and sum of squared differences from it: no cancellation where all errors are alike.
    log_mean: f64,
    log_spread: f64,
}

const ZEROS: [f64; LANES] = [0.0; LANES];

#[inline(always)]
fn rows(block: &[f64; BLOCK]) -> impl Iterator<Item = &[f64; LANES]> {
    block.as_chunks::<LANES>().0.iter()
}

#[inline(always)]
fn lanes_sum(lanes: [f64; LANES]) -> f64 {
    let half: [f64; 4] = std::array::from_fn(|i| lanes[i] + lanes[i + 4]);
    (half[0] + half[2]) + (half[1] + half[3])
}

#[inline(always)]
fn sum(numbers: &[f64; BLOCK]) -> f64 {
    let mut lanes = ZEROS;
    for row in rows(numbers) {
        for lane in 0..LANES {
            lanes[lane] += row[lane];
        }
    }
    lanes_sum(lanes)
}

#[inline(always)]
fn sum_of_products(some: &[f64; BLOCK], others: &[f64; BLOCK]) -> f64 {
    let mut lanes = ZEROS;
    for (some, others) in rows(some).zip(rows(others)) {
        for lane in 0..LANES {
            lanes[lane] += some[lane] * others[lane];
        }
    }
    lanes_sum(lanes)
}

impl Sums {
    const EMPTY: Self = Self {
        pixels: 0,
        within: [0; 3],
        relative: 0.0,
        squared_by_truth: 0.0,
        squared_by_truth_squared: 0.0,
        squared: 0.0,
        log_squared: 0.0,
        log_mean: 0.0,
        log_spread: 0.0,
    };

    /// Adds the first `count` pixels of a block; the others are 1 m, truth and estimate.
    #[inline(always)]
    fn add_block(&mut self, t: &[f64; BLOCK], y: &[f64; BLOCK], count: usize) {
        if count == 0 {
            return;
        }
        // A loop for each step: each is done in vectors. With several sums in a loop, the compiler packs these into a
        // vector instead of the pixels.
        let [mut logs, mut differences, mut quotients] = [[0.0; BLOCK]; 3];
        for ((e, t), y) in logs.iter_mut().zip(t).zip(y) {
            *e = ln(y / t);
        }
        for ((difference, t), y) in differences.iter_mut().zip(t).zip(y) {
            *difference = (y - t).abs();
        }
        for ((quotient, t), difference) in quotients.iter_mut().zip(t).zip(&differences) {
            *quotient = difference / t;
        }
        // `max(y/t, t/y) < 1.25^k` without divisions; the powers are exact in binary, so for f32 maps it is the same
        // result. Counted in floats, which have as many lanes as the conditions.
        let mut within = [0; 3];
        for (within, limit) in within.iter_mut().zip([1.25, 1.5625, 1.953_125]) {
            let mut lanes = ZEROS;
            for (t, y) in rows(t).zip(rows(y)) {
                for lane in 0..LANES {
                    let is_within = (y[lane] < limit * t[lane]) & (t[lane] < limit * y[lane]);
                    lanes[lane] += if is_within { 1.0 } else { 0.0 };
                }
            }
            *within = lanes.iter().sum::<f64>() as u64 - (BLOCK - count) as u64;
        }
        let log_mean = sum(&logs) / count as f64;
        let mut deviations = [0.0; BLOCK];
        for (deviation, e) in deviations[..count].iter_mut().zip(&logs) {
            *deviation = e - log_mean;
        }
        self.merge(&Self {
            pixels: count as u64,
            within,
            relative: sum(&quotients),
            squared_by_truth: sum_of_products(&quotients, &differences),
            squared_by_truth_squared: sum_of_products(&quotients, &quotients),
            squared: sum_of_products(&differences, &differences),
            log_squared: sum_of_products(&logs, &logs),
            log_mean,
            log_spread: sum_of_products(&deviations, &deviations),
        });
    }

    /// Adds the sums over other pixels (mean and spread as in Chan, Golub, LeVeque 1979).
    pub(crate) fn merge(&mut self, other: &Self) {
        if other.pixels == 0 {
            return;
        }
        let (ours, theirs) = (self.pixels as f64, other.pixels as f64);
        let apart = other.log_mean - self.log_mean;
        self.log_spread += other.log_spread + apart * apart * (ours * theirs / (ours + theirs));
        self.log_mean += apart * (theirs / (ours + theirs));
        self.pixels += other.pixels;
        for (a, b) in self.within.iter_mut().zip(other.within) {
            *a += b;
        }
        self.relative += other.relative;
        self.squared_by_truth += other.squared_by_truth;
        self.squared_by_truth_squared += other.squared_by_truth_squared;
        self.squared += other.squared;
        self.log_squared += other.log_squared;
    }

    /// How many pixels were added.
    pub(crate) const fn pixels(&self) -> u64 {
        self.pixels
    }

    /// The row with the metrics of Table I; without metrics if no pixel counted.
    pub(crate) fn row(&self, row: ScoreRow, settings: &Settings) -> ScoreRow {
        if self.pixels == 0 {
            return row;
        }
        let count = self.pixels as f64;
        let [a1, a2, a3] = self.within.map(|within| within as f64 / count);
        let sq_rel = match settings.sq_rel {
            SquaredRelative::ByTruth => self.squared_by_truth,
            SquaredRelative::ByTruthSquared => self.squared_by_truth_squared,
        };
        let silog = match settings.silog {
            ScaleInvariant::HalfVariance => 0.5 * (self.log_spread / count),
            ScaleInvariant::HundredDeviation => 100.0 * (self.log_spread / count).sqrt(),
        };
        let (rmse, rmse_log) = ((self.squared / count).sqrt(), (self.log_squared / count).sqrt());
        let scores = [a1, a2, a3, self.relative / count, sq_rel / count, rmse, rmse_log, silog];
        let row = ScoreRow { pixels: self.pixels, log_mean: Some(self.log_mean), ..row };
        DEPTH.iter().zip(scores).fold(row, |row, (metric, score)| row.with(metric, score))
    }
}

#[cfg(test)]
mod tests {
    use depthloom_simd::Level;

    use super::{Sums, ValidAndMissing};
    use crate::pixels::Alignment;
    use crate::{DepthEstimate, ScoredPixels, Settings};

    fn bits(sums: Sums) -> [u64; 11] {
        let Sums { pixels, within: [a, b, c], relative, squared_by_truth, squared_by_truth_squared, .. } = sums;
        let Sums { squared, log_squared, log_mean, log_spread, .. } = sums;
        let floats = [relative, squared_by_truth, squared_by_truth_squared, squared, log_squared, log_mean, log_spread];
        let [d, e, f, g, h, i, j] = floats.map(f64::to_bits);
        [pixels, a, b, c, d, e, f, g, h, i, j]
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let number = |i: u32| f64::from(i.wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0;
        let truth: Vec<f32> = (0..5000).map(|i| if i % 7 == 0 { f32::NAN } else { 1.0 + 90.0 * number(i) }).collect();
        let metres = |i: u32| if number(i + 1) < 0.2 { f32::INFINITY } else { 100.0 * number(7 * i) - 1.0 };
        let estimate: Vec<f32> = (0..5000).map(metres).collect();
        let settings = Settings::default();
        for alignment in [Alignment::Factor(1.1), Alignment::Inverse { scale: 0.9, shift: -0.01 }] {
            // Whole blocks, a part of one, less than a row of lanes, nothing.
            for count in [5000, 700, 6, 1] {
                let pixels = ScoredPixels::new(&truth[..count], count, 1, &settings);
                let sums = |level: Level| {
                    let mut sums = ValidAndMissing::new(Some(80.0));
                    let estimate = DepthEstimate::from(&estimate[..count]);
                    pixels.each_chunk_at(level, estimate, alignment, &settings, &mut sums);
                    sums.finish().map(bits)
                };
                let expected = sums(Level::PORTABLE);
                assert_eq!(expected[0][0] + expected[1][0], pixels.len() as u64);
                for level in Level::available() {
                    assert_eq!(sums(level), expected, "{} with {count} pixels", level.name());
                }
            }
        }
    }
}
