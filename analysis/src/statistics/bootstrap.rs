//! Bootstrap intervals: frames are drawn repeatedly, with replacement.

use clap::ValueEnum;
use std::sync::Mutex;

use depthloom_random::SplitMix64;
use depthloom_threads::{Budget, Tiles as _, core_count, into_unlocked, locked};

use depthloom_scores::quantile::quantile;

use super::normal;
use crate::error::AnalysisError;

/// A statistic as a function of the weight of each frame.
pub(crate) type Statistic<'a> = dyn Fn(&[f64]) -> f64 + Sync + 'a;

/// The number of resamples per task, and of statistics that are resampled together.
const AT_ONCE: usize = 250;
const NUMBERS: usize = 64;

/// The method of intervals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum IntervalMethod {
    // `scipy.stats.bootstrap(method="BCa")`.
    /// Bias-corrected and accelerated (Efron 1987).
    #[default]
    Bca,
    /// Plain percentiles.
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

/// The resampling of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resampling {
    /// The number of resamples.
    pub resamples: u32,
    /// The seed. Equal seeds and frames give equal intervals.
    pub seed: u64,
    /// The confidence level of intervals, between 0 and 1.
    pub confidence: f64,
    /// The method of intervals.
    pub method: IntervalMethod,
}

impl Default for Resampling {
    /// [`Resampling::OF_SCORES`] resamples, seed 1, 95 %, BCa.
    fn default() -> Self {
        Self { resamples: Self::OF_SCORES, seed: 1, confidence: 0.95, method: IntervalMethod::Bca }
    }
}

/// A confidence interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

impl Resampling {
    /// The default number of resamples for scores. With 10,000, the ends of intervals of few skewed scores differ
    /// between seeds by up to a tenth of the width; with this number, by a third of that.
    pub const OF_SCORES: u32 = 100_000;
    /// The default number for errors by distance, which are sums or medians over pixels.
    pub const OF_ERRORS: u32 = 10_000;

    /// Describes the intervals: `95 % BCa bootstrap over frames, 10000 resamples, seed 1`.
    #[must_use]
    pub fn about(&self) -> String {
        self.about_units("frames")
    }

    /// As [`about`](Self::about), with the units that are resampled.
    pub(crate) fn about_units(&self, units: &str) -> String {
        let (method, resamples, seed) = (self.method.name(), self.resamples, self.seed);
        format!("{} {method} bootstrap over {units}, {resamples} resamples, seed {seed}", self.level())
    }

    /// `95 %`.
    pub(crate) fn level(&self) -> String {
        format!("{} %", (self.confidence * 1e8).round() / 1e6)
    }

    /// The intervals of statistics with different numbers of frames, in their order; see [`Resampling::intervals`].
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

    /// The intervals of statistics of `frames` frames. `None` with fewer than two frames, or if the resamples give no
    /// interval: some are not finite, or all are on one side of the value.
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
            intervals
                .extend(some.iter().zip(replicates).map(|(number, values)| self.interval(frames, *number, values)));
        }
        Ok(intervals)
    }

    /// The values of each statistic on all resamples.
    pub(crate) fn replicates(
        &self,
        frames: usize,
        numbers: &[&Statistic<'_>],
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Vec<Vec<f64>>, AnalysisError> {
        let all = self.resamples as usize;
        let replicates = Mutex::new(vec![vec![0.0; all]; numbers.len()]);
        let budget = Budget::new(core_count());
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
            replicates.iter_mut().zip(values).for_each(|(all, values)| all[some.clone()].copy_from_slice(&values));
        });
        if stop() {
            return Err(AnalysisError::Stopped);
        }
        Ok(into_unlocked(replicates))
    }

    /// The percentile interval of finite replicates; `None` with fewer than two.
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
        let value = number(&times);
        if !value.is_finite() || replicates.iter().any(|replicate| !replicate.is_finite()) || replicates.is_empty() {
            return None;
        }
        replicates.sort_by(f64::total_cmp);
        if replicates[0] == value && replicates[replicates.len() - 1] == value {
            // All resamples give the same value.
            return Some(Interval { low: value, high: value });
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
                let jackknife: Vec<f64> = (0..frames).map(&mut without).collect();
                shares(alpha, value, &replicates, &jackknife)?
            }
        };
        Some(Interval { low: quantile(&replicates, low), high: quantile(&replicates, high) })
    }
}

/// The percentiles of the sorted resamples that are the ends of a BCa interval (Efron and Tibshirani 1993, 14.9 to
/// 14.15).
fn shares(alpha: f64, value: f64, replicates: &[f64], jackknife: &[f64]) -> Option<(f64, f64)> {
    let below = replicates.partition_point(|replicate| *replicate < value);
    let up_to = replicates.partition_point(|replicate| *replicate <= value);
    let bias = normal::quantile((below + up_to) as f64 / (2 * replicates.len()) as f64);
    let n = jackknife.len() as f64;
    let mean = jackknife.iter().sum::<f64>() / n;
    let (mut cubes, mut squares) = (0.0, 0.0);
    for value in jackknife {
        let influence = (n - 1.0) * (mean - value);
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
