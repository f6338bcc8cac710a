//! Intervals by the bootstrap: frames are drawn again and again, with replacement.

use clap::ValueEnum;
use std::num::NonZero;
use std::sync::Mutex;
use std::thread;

use depthloom_random::SplitMix64;
use depthloom_threads::{Budget, Tiles as _, into_unlocked, locked};

use depthloom_scores::quantile::quantile;

use super::normal;
use crate::error::AnalysisError;

/// A number of frames, by how often each of them counts.
pub(crate) type Statistic<'a> = dyn Fn(&[f64]) -> f64 + Sync + 'a;

/// So many resamples a thread takes at a time, and of so many numbers.
const AT_ONCE: usize = 250;
const NUMBERS: usize = 64;

/// How an interval is read off the resamples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum IntervalMethod {
    // `scipy.stats.bootstrap(method="BCa")`.
    /// Bias-corrected and accelerated (Efron 1987).
    #[default]
    Bca,
    /// The percentiles themselves.
    Percentile,
}

impl IntervalMethod {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bca => "BCa",
            Self::Percentile => "percentile",
        }
    }
}

/// How frames are resampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resampling {
    /// How often.
    pub resamples: u32,
    /// The seed: of equal seeds and frames, intervals are equal.
    pub seed: u64,
    /// How often an interval is to hold the number that it is of, between 0 and 1.
    pub confidence: f64,
    /// How an interval is read off the resamples.
    pub method: IntervalMethod,
}

impl Default for Resampling {
    /// [`Resampling::OF_SCORES`] resamples, seed 1, 95 %, BCa.
    fn default() -> Self {
        Self { resamples: Self::OF_SCORES, seed: 1, confidence: 0.95, method: IntervalMethod::Bca }
    }
}

/// An interval that holds a number, as sure as it was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

impl Resampling {
    /// How often frames are resampled for intervals of scores: of 10,000, the ends of intervals of few, skewed scores
    /// lie up to a tenth of the interval's width apart from one seed to another; of so many, a third of that.
    pub const OF_SCORES: u32 = 100_000;
    /// How often for errors by distance, each of which is a sum or median over pixels.
    pub const OF_ERRORS: u32 = 10_000;

    /// What intervals are, in words: `95 % BCa bootstrap over frames, 10000 resamples, seed 1`.
    #[must_use]
    pub fn about(&self) -> String {
        let (method, resamples, seed) = (self.method.name(), self.resamples, self.seed);
        format!("{} {method} bootstrap over frames, {resamples} resamples, seed {seed}", self.level())
    }

    /// `95 %`.
    pub(crate) fn level(&self) -> String {
        format!("{} %", (self.confidence * 1e8).round() / 1e6)
    }

    /// The intervals of numbers, each of its own number of frames, in their order; see [`Resampling::intervals`].
    pub(crate) fn intervals_of(
        &self,
        numbers: &[(usize, Box<Statistic<'_>>)],
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Vec<Option<Interval>>, AnalysisError> {
        let mut intervals = vec![None; numbers.len()];
        let mut counts: Vec<usize> = numbers.iter().map(|(frames, _)| *frames).collect();
        counts.sort_unstable();
        counts.dedup();
        for frames in counts {
            let places: Vec<usize> = (0..numbers.len()).filter(|&place| numbers[place].0 == frames).collect();
            let some: Vec<&Statistic<'_>> = places.iter().map(|&place| &*numbers[place].1).collect();
            let found = self.intervals(frames, &some, stop)?;
            places.into_iter().zip(found).for_each(|(place, interval)| intervals[place] = interval);
        }
        Ok(intervals)
    }

    /// The intervals of numbers of `frames` frames; `None` where there are fewer than two, or the resamples say
    /// nothing: some are no numbers, or none lies on one side of the number.
    pub(crate) fn intervals(
        &self,
        frames: usize,
        numbers: &[&Statistic<'_>],
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Vec<Option<Interval>>, AnalysisError> {
        let mut intervals = Vec::with_capacity(numbers.len());
        if frames < 2 {
            intervals.resize(numbers.len(), None);
            return Ok(intervals);
        }
        for some in numbers.chunks(NUMBERS) {
            let replicates = self.replicates(frames, some, stop)?;
            intervals.extend(some.iter().zip(replicates).map(|(number, of)| self.interval(frames, *number, of)));
        }
        Ok(intervals)
    }

    /// By number, its value on every resample.
    pub(crate) fn replicates(
        &self,
        frames: usize,
        numbers: &[&Statistic<'_>],
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Vec<Vec<f64>>, AnalysisError> {
        let all = self.resamples as usize;
        let replicates = Mutex::new(vec![vec![0.0; all]; numbers.len()]);
        let budget = Budget::new(thread::available_parallelism().map_or(1, NonZero::get));
        let _own = budget.permit();
        budget.run(all.div_ceil(AT_ONCE), &|tile| {
            if stop() {
                return;
            }
            let some = tile * AT_ONCE..all.min((tile + 1) * AT_ONCE);
            let mut values = vec![Vec::with_capacity(some.len()); numbers.len()];
            let mut times = vec![0.0; frames];
            for resample in some.clone() {
                times.fill(0.0);
                let mut random = SplitMix64::part(self.seed, resample as u64);
                (0..frames).for_each(|_| times[random.below(frames)] += 1.0);
                values.iter_mut().zip(numbers).for_each(|(values, number)| values.push(number(&times)));
            }
            let mut replicates = locked(&replicates);
            replicates.iter_mut().zip(values).for_each(|(of, values)| of[some.clone()].copy_from_slice(&values));
        });
        if stop() {
            return Err(AnalysisError::Stopped);
        }
        Ok(into_unlocked(replicates))
    }

    /// The percentile interval of replicates that are numbers; `None` of fewer than two.
    pub(crate) fn percentiles_of(&self, mut replicates: Vec<f64>) -> Option<Interval> {
        if replicates.len() < 2 {
            return None;
        }
        replicates.sort_by(f64::total_cmp);
        let alpha = (1.0 - self.confidence) / 2.0;
        Some(Interval { low: quantile(&replicates, alpha), high: quantile(&replicates, 1.0 - alpha) })
    }

    fn interval(&self, frames: usize, number: &Statistic<'_>, mut replicates: Vec<f64>) -> Option<Interval> {
        let mut times = vec![1.0; frames];
        let whole = number(&times);
        if !whole.is_finite() || replicates.iter().any(|of| !of.is_finite()) || replicates.is_empty() {
            return None;
        }
        replicates.sort_by(f64::total_cmp);
        if replicates[0] == whole && replicates[replicates.len() - 1] == whole {
            // However frames are drawn, it is the same.
            return Some(Interval { low: whole, high: whole });
        }
        let alpha = (1.0 - self.confidence) / 2.0;
        let (low, high) = match self.method {
            IntervalMethod::Percentile => (alpha, 1.0 - alpha),
            IntervalMethod::Bca => {
                let mut without = |frame: usize| {
                    times[frame] = 0.0;
                    let value = number(&times);
                    times[frame] = 1.0;
                    value
                };
                let left_out: Vec<f64> = (0..frames).map(&mut without).collect();
                shares(alpha, whole, &replicates, &left_out)?
            }
        };
        Some(Interval { low: quantile(&replicates, low), high: quantile(&replicates, high) })
    }
}

/// Of which shares of the sorted resamples the ends of a BCa interval are percentiles (Efron and Tibshirani 1993, 14.9
/// to 14.15).
fn shares(alpha: f64, whole: f64, replicates: &[f64], left_out: &[f64]) -> Option<(f64, f64)> {
    let (below, up_to) = (replicates.partition_point(|of| *of < whole), replicates.partition_point(|of| *of <= whole));
    let bias = normal::quantile((below + up_to) as f64 / (2 * replicates.len()) as f64);
    let n = left_out.len() as f64;
    let mean = left_out.iter().sum::<f64>() / n;
    let (mut cubes, mut squares) = (0.0, 0.0);
    for of in left_out {
        let influence = (n - 1.0) * (mean - of);
        cubes += influence * influence * influence;
        squares += influence * influence;
    }
    let (cubes, squares) = (cubes / (n * n * n), squares / (n * n));
    let acceleration = cubes / (6.0 * squares * squares.sqrt());
    let share = |z: f64| {
        let from = bias + z;
        normal::cdf(bias + from / (1.0 - acceleration * from))
    };
    let z = normal::quantile(alpha);
    let (low, high) = (share(z), share(-z));
    (low.is_finite() && high.is_finite() && bias.is_finite()).then_some((low, high))
}
