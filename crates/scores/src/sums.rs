//! The sums of a row of metrics, computed block by block.

use crate::ln::ln;
use crate::row::ScoreRow;
use crate::{DEPTH, ScaleInvariant, Settings, SquaredRelative};

/// Pixels of a block: short enough for the first cache, long enough that its end costs nothing.
const BLOCK: usize = 256;
/// Partial sums kept side by side, so that additions vectorise; their number fixes the result's bits.
const LANES: usize = 8;

/// Pairs on their way into [`Sums`].
pub(crate) struct Block {
    t: [f64; BLOCK],
    y: [f64; BLOCK],
    filled: usize,
    sums: Sums,
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

impl Block {
    pub(crate) const fn new() -> Self {
        Self { t: [1.0; BLOCK], y: [1.0; BLOCK], filled: 0, sums: Sums::EMPTY }
    }

    /// Adds a pixel: truth and estimate, metres, both positive.
    #[inline]
    pub(crate) fn push(&mut self, t: f64, y: f64) {
        self.t[self.filled] = t;
        self.y[self.filled] = y;
        self.filled += 1;
        if self.filled == BLOCK {
            self.sums.add_block(&self.t, &self.y);
            self.filled = 0;
        }
    }

    /// The sums over all pixels pushed.
    pub(crate) fn finish(mut self) -> Sums {
        self.sums.add_block(&self.t[..self.filled], &self.y[..self.filled]);
        self.sums
    }
}

fn lanes_sum(lanes: [f64; LANES]) -> f64 {
    let half: [f64; 4] = std::array::from_fn(|i| lanes[i] + lanes[i + 4]);
    (half[0] + half[2]) + (half[1] + half[3])
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

    fn add_block(&mut self, t: &[f64], y: &[f64]) {
        if t.is_empty() {
            return;
        }
        let mut logs = [0.0; BLOCK];
        let mut within = [[0_u64; LANES]; 3];
        let mut sums = [[0.0; LANES]; 6];
        let whole = t.len() / LANES * LANES;
        let mut add = |lane: usize, t: f64, y: f64, log: &mut f64| {
            let difference = (y - t).abs();
            let relative = difference / t;
            let e = ln(y / t);
            *log = e;
            // `max(y/t, t/y) < 1.25^k` without divisions; the powers are exact in binary, so for f32 maps it is the
            // same result.
            for (count, limit) in within.iter_mut().zip([1.25, 1.5625, 1.953_125]) {
                count[lane] += u64::from(y < limit * t) & u64::from(t < limit * y);
            }
            sums[0][lane] += relative;
            sums[1][lane] += relative * difference;
            sums[2][lane] += relative * relative;
            sums[3][lane] += difference * difference;
            sums[4][lane] += e * e;
            sums[5][lane] += e;
        };
        let (rows_t, rows_y) = (t[..whole].chunks_exact(LANES), y[..whole].chunks_exact(LANES));
        for ((t, y), log) in rows_t.zip(rows_y).zip(logs.chunks_exact_mut(LANES)) {
            for lane in 0..LANES {
                add(lane, t[lane], y[lane], &mut log[lane]);
            }
        }
        for (lane, i) in (whole..t.len()).enumerate() {
            add(lane, t[i], y[i], &mut logs[i]);
        }
        let count = t.len() as f64;
        let log_mean = lanes_sum(sums[5]) / count;
        let mut spread = [0.0; LANES];
        for row in logs[..t.len()].chunks(LANES) {
            for (lane, e) in row.iter().enumerate() {
                spread[lane] += (e - log_mean) * (e - log_mean);
            }
        }
        self.merge(&Self {
            pixels: t.len() as u64,
            within: within.map(|lanes| lanes.iter().sum()),
            relative: lanes_sum(sums[0]),
            squared_by_truth: lanes_sum(sums[1]),
            squared_by_truth_squared: lanes_sum(sums[2]),
            squared: lanes_sum(sums[3]),
            log_squared: lanes_sum(sums[4]),
            log_mean,
            log_spread: lanes_sum(spread),
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
