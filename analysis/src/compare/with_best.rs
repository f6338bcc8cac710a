//! Estimates compared with the best one by a single metric: the test and the verdict of `compare`, for tables that show
//! no intervals of differences.

use depthloom_recording::Recording;
use depthloom_scores::{Metric, PixelSet};

use super::contrast::{Verdict, contrasts, smallest_reachable, tests};
use super::{CompareOptions, ComparedRun, Pair, Paired, ScoredBy, significance};
use crate::ablation::Ablation;
use crate::error::AnalysisError;
use crate::estimates::Estimate;
use crate::statistics::{IntervalMethod, Resampling};

/// The frames that are drawn in all resamples together, and the limits of the number of resamples. A row takes a few
/// milliseconds at most.
const DRAWS: usize = 1_000_000;
const RESAMPLES: (usize, usize) = (200, 2_000);
/// With more frames, intervals are plain percentiles: the time of BCa grows with the square of their number.
const MOST_FOR_BCA: usize = 500;

/// The difference between an estimate and the best one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Difference {
    /// The probability of the test, corrected for all tests; `None` without a test.
    pub(crate) p: Option<f64>,
    pub(crate) verdict: Verdict,
    /// Whether both have the same value on every frame.
    pub(crate) is_equal: bool,
}

/// Estimates compared with the best one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Differences {
    /// One per estimate; `None` if it has no value on a frame of the best one.
    pub(crate) differences: Vec<Option<Difference>>,
    /// The number of tests.
    pub(crate) tests: usize,
    /// The number of frames of the test with the most.
    pub(crate) frames: usize,
    /// Whether these frames are too few for a verdict: the smallest corrected probability that they allow, which is not
    /// below the significance level.
    pub(crate) too_few: Option<f64>,
    /// The significance level.
    pub(crate) level: f64,
}

/// Compares estimates of a recording, given by their places, with the `best` one on a pixel set of the whole image.
///
/// # Errors
/// [`AnalysisError::Stopped`] once `stop` returns true.
pub(crate) fn with_best<'a>(
    recording: &'a Recording,
    (ablation, estimates): (&'a Ablation<'a>, &'a [Estimate]),
    (metric, set): (&'static Metric, PixelSet),
    best: usize,
    others: &[usize],
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Differences, AnalysisError> {
    let run = ComparedRun { called: "", recording };
    let scored = |place: usize| {
        let scores = ablation.frames(place, set, "").to_vec();
        ScoredBy { run, estimate: &estimates[place], scores }
    };
    let baseline = scored(best);
    let pair = |(party, &place): (usize, &usize)| {
        let other = scored(place);
        let paired = Paired::new(&baseline, &other);
        Pair { party, name: String::new(), baseline: baseline.clone(), other, set, paired }
    };
    let pairs: Vec<Pair<'_>> = others.iter().enumerate().map(pair).collect();
    let frames = baseline.scores.len();
    let resampling = Resampling {
        resamples: (DRAWS / frames.max(1)).clamp(RESAMPLES.0, RESAMPLES.1) as u32,
        method: if frames > MOST_FOR_BCA { IntervalMethod::Percentile } else { IntervalMethod::Bca },
        ..Resampling::default()
    };
    let options = CompareOptions { scores: vec![metric.name.to_owned()], resampling, ..CompareOptions::default() };
    let contrasts = contrasts(&pairs, &options, stop)?;
    let mut differences = vec![None; others.len()];
    for contrast in &contrasts {
        let is_equal = contrast.is_identical || (contrast.wins == 0 && contrast.losses == 0);
        differences[contrast.pair] = Some(Difference { p: contrast.p_holm, verdict: contrast.verdict, is_equal });
    }
    let level = significance(&resampling);
    Ok(Differences {
        differences,
        tests: tests(&contrasts),
        frames: contrasts.iter().filter(|of| of.p_holm.is_some()).map(|of| of.frames).max().unwrap_or(0),
        too_few: smallest_reachable(&contrasts).filter(|p| *p >= level),
        level,
    })
}
