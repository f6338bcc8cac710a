//! One metric of a pair: the difference, its significance, and the number of wins and losses.

use std::collections::BTreeSet;

use depthloom_graphs::Key;
use depthloom_scores::{Mean, Metric, ScoreRow};
use schemars::JsonSchema;
use serde::Serialize;

use super::{CompareOptions, Pair};
use crate::error::AnalysisError;
use crate::scores::FrameScore;
use crate::statistics::{Grouping, Groups, Interval, SignedRank, Statistic, Weighted, holm};

/// A metric of a pair.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Contrast {
    pub(super) pair: usize,
    pub(super) metric: &'static Metric,
    /// The number of frames on which both have the metric.
    pub(super) frames: usize,
    /// The number of sampling units: of frames, or of their groups.
    pub(super) units: usize,
    /// The value of each side over these frames.
    pub(super) baseline: f64,
    pub(super) value: f64,
    pub(super) interval: Option<Interval>,
    /// The number of units on which the other side is better, equal, and worse.
    pub(super) wins: u64,
    pub(super) ties: u64,
    pub(super) losses: u64,
    pub(super) test: Option<SignedRank>,
    /// Whether both are values of the same node with the same scoring, so that there is nothing to test.
    pub(super) is_identical: bool,
    /// The probability of the test, corrected for all tests of the comparison.
    pub(super) p_holm: Option<f64>,
    /// A digest of the metric and of its values on each frame of both sides. Variants that share their estimates have
    /// one test.
    tested: Key,
    pub(super) verdict: Verdict,
}

/// The verdict on the other side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    Better,
    Worse,
    /// The frames do not decide it.
    Unclear,
}

impl Verdict {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::Worse => "worse",
            Self::Unclear => "unclear",
        }
    }
}

/// The number of rows by verdict.
#[derive(Clone, Debug, Default, PartialEq, JsonSchema, Serialize)]
pub(crate) struct Verdicts {
    better: u64,
    worse: u64,
    unclear: u64,
}

impl FromIterator<Verdict> for Verdicts {
    fn from_iter<I: IntoIterator<Item = Verdict>>(verdicts: I) -> Self {
        let mut counts = Self::default();
        for verdict in verdicts {
            *match verdict {
                Verdict::Better => &mut counts.better,
                Verdict::Worse => &mut counts.worse,
                Verdict::Unclear => &mut counts.unclear,
            } += 1;
        }
        counts
    }
}

impl Contrast {
    /// The value of the other side minus that of the baseline.
    pub(super) fn difference(&self) -> f64 {
        self.value - self.baseline
    }

    /// The difference as a share of the baseline's value.
    pub(super) fn change(&self) -> f64 {
        match self.difference() {
            0.0 => 0.0,
            difference => difference / self.baseline.abs(),
        }
    }

    /// A verdict needs both the test, which ranks the differences of frames, and the interval, which belongs to the
    /// value in the table.
    fn judged(&self, level: f64) -> Verdict {
        let (Some(p), Some(Interval { low, high })) = (self.p_holm, self.interval) else { return Verdict::Unclear };
        let is_better = match self.metric.nominal {
            None => (low > 0.0) == self.metric.more_is_better,
            Some(_) => self.metric.goodness(self.value) > self.metric.goodness(self.baseline),
        };
        let is_significant = p < level && (low > 0.0 || high < 0.0);
        match is_significant {
            false => Verdict::Unclear,
            true if is_better => Verdict::Better,
            true => Verdict::Worse,
        }
    }
}

/// A metric of a pair, before frames are resampled.
struct Sample {
    contrast: Contrast,
    baseline: Weighted,
    other: Weighted,
    /// Whether both sides have equal values on every frame.
    is_equal: bool,
}

/// The metrics of all pairs, pair by pair in the order of tables.
pub(super) fn contrasts(
    pairs: &[Pair<'_>],
    options: &CompareOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<Contrast>, AnalysisError> {
    let is_requested =
        |metric: &Metric| options.scores.is_empty() || options.scores.iter().any(|name| name == metric.name);
    let groups = options.grouping.as_ref().map(Grouping::open).transpose()?;
    let mut samples = Vec::new();
    for (place, pair) in pairs.iter().enumerate() {
        let both = pair.baseline.estimate.metrics.iter().filter(|of| pair.other.estimate.metrics.contains(of));
        for metric in both.copied().filter(|metric| is_requested(metric)) {
            samples.extend(sample(place, pair, metric, pair.mean(options), groups.as_ref())?);
        }
    }
    // Nodes with different keys may have equal values.
    let differing: BTreeSet<usize> =
        samples.iter().filter(|sample| !sample.is_equal).map(|sample| sample.contrast.pair).collect();
    for sample in samples.iter_mut().filter(|sample| !differing.contains(&sample.contrast.pair)) {
        sample.contrast.is_identical = true;
    }
    let number = |sample: &Sample| -> (usize, Box<Statistic<'_>>) {
        let (baseline, other) = (sample.baseline.clone(), sample.other.clone());
        (sample.contrast.units, Box::new(move |times: &[f64]| other.value(times) - baseline.value(times)))
    };
    let numbers: Vec<_> = samples.iter().map(number).collect();
    let intervals = options.resampling.intervals_of(&numbers, stop)?;
    samples.iter_mut().zip(intervals).for_each(|(sample, interval)| sample.contrast.interval = interval);
    let mut contrasts: Vec<Contrast> = samples.into_iter().map(|sample| sample.contrast).collect();
    // Identical values cannot differ: a test of them would only weaken the correction of the others.
    let differing = contrasts.iter().enumerate().filter(|(_, of)| !of.is_identical);
    let tested: Vec<(usize, f64)> = differing.filter_map(|(place, of)| Some((place, of.test?.p))).collect();
    let mut distinct: Vec<(Key, f64)> = Vec::new();
    for &(place, p) in &tested {
        if !distinct.iter().any(|(known, _)| *known == contrasts[place].tested) {
            distinct.push((contrasts[place].tested, p));
        }
    }
    let corrected = holm(&distinct.iter().map(|(_, p)| *p).collect::<Vec<_>>());
    for (place, _) in tested {
        let of_test = distinct.iter().position(|(known, _)| *known == contrasts[place].tested);
        contrasts[place].p_holm = of_test.map(|of_test| corrected[of_test]);
    }
    let level = 1.0 - options.resampling.confidence;
    for contrast in &mut contrasts {
        contrast.verdict = contrast.judged(level);
    }
    Ok(contrasts)
}

/// The number of different tests.
pub(super) fn tests(contrasts: &[Contrast]) -> usize {
    let tested = contrasts.iter().filter(|of| of.p_holm.is_some());
    tested.map(|of| of.tested).collect::<BTreeSet<Key>>().len()
}

/// The smallest corrected probability that this number of tests and units allows, if all differences have one sign.
/// `None` without tests.
pub(super) fn smallest_reachable(contrasts: &[Contrast]) -> Option<f64> {
    let most = contrasts.iter().filter(|of| of.p_holm.is_some()).map(|of| of.units).max()?;
    let one_sign: Vec<f64> = (1..=most).map(|unit| unit as f64).collect();
    Some((SignedRank::test(&one_sign)?.p * tests(contrasts) as f64).min(1.0))
}

/// A metric of a pair on the frames on which both have it. `None` if there is no such frame, or if the value of a data
/// set cannot be computed from the values of frames.
///
/// # Errors
/// If the file of groups has no group for a frame.
fn sample(
    place: usize,
    pair: &Pair<'_>,
    metric: &'static Metric,
    mean: Mean,
    groups: Option<&Groups>,
) -> Result<Option<Sample>, AnalysisError> {
    let both = |(one, two): (&ScoreRow, &ScoreRow)| Some((one.get(metric)?, two.get(metric)?));
    let frames = pair.paired.frames.iter().filter(|(one, two)| both((&one.row, &two.row)).is_some());
    let frames: Vec<(&FrameScore, &FrameScore)> = frames.copied().collect();
    let (ours, theirs): (Vec<&ScoreRow>, Vec<&ScoreRow>) = frames.iter().map(|(one, two)| (&one.row, &two.row)).unzip();
    if ours.is_empty() {
        return Ok(None);
    }
    let settings = |side: &super::ScoredBy<'_>| side.estimate.settings.unwrap_or_default();
    let weighted = |side: &super::ScoredBy<'_>, rows: &[&ScoreRow]| {
        Weighted::new(metric, mean, &settings(side), rows.iter().copied())
    };
    let (Some(baseline), Some(other)) = (weighted(&pair.baseline, &ours), weighted(&pair.other, &theirs)) else {
        return Ok(None);
    };
    let groups = groups.map(|groups| pair.groups(groups, &frames)).transpose()?;
    let of_frames = || ours.iter().zip(&theirs).filter_map(|(one, two)| both((one, two)));
    let (baseline, other, values): (_, _, Vec<(f64, f64)>) = match groups {
        None => (baseline, other, of_frames().collect()),
        Some(groups) => {
            let (baseline, other) = (baseline.grouped(&groups), other.grouped(&groups));
            let values = baseline.of_each().into_iter().zip(other.of_each()).collect();
            (baseline, other, values)
        }
    };
    let count = |is: &dyn Fn(f64, f64) -> bool| values.iter().filter(|(one, two)| is(*one, *two)).count() as u64;
    let good = |value| metric.goodness(value);
    let wins = count(&|one, two| good(two) > good(one));
    let losses = count(&|one, two| good(two) < good(one));
    let differences: Vec<f64> = values.iter().map(|(one, two)| two - one).collect();
    let tested = of_frames().fold(Key::build("tested").text(metric.name), |key, (one, two)| {
        key.number(one.to_bits()).number(two.to_bits())
    });
    let is_equal = of_frames().all(|(one, two)| one == two);
    let contrast = Contrast {
        pair: place,
        metric,
        frames: ours.len(),
        units: values.len(),
        baseline: baseline.of_all_frames(),
        value: other.of_all_frames(),
        interval: None,
        wins,
        ties: values.len() as u64 - wins - losses,
        losses,
        test: SignedRank::test(&differences),
        // One node may read files of several folders: then its values differ.
        is_identical: is_equal && pair.is_identical(),
        p_holm: None,
        tested: tested.finish(),
        verdict: Verdict::Unclear,
    };
    Ok(Some(Sample { contrast, baseline, other, is_equal }))
}

impl Pair<'_> {
    /// The group of each frame, by the baseline's run.
    fn groups(&self, groups: &Groups, frames: &[(&FrameScore, &FrameScore)]) -> Result<Vec<usize>, AnalysisError> {
        let recorded = self.baseline.run.recording.frames(self.baseline.estimate.run);
        let named = |(one, _): &(&FrameScore, &FrameScore)| {
            let frame = &recorded[one.position.0];
            (&*frame.id, frame.index)
        };
        groups.of_frames(&frames.iter().map(named).collect::<Vec<_>>())
    }

    /// How the value of a data set is averaged.
    pub(super) fn mean(&self, options: &CompareOptions) -> Mean {
        options.selection.mean.unwrap_or(self.baseline.estimate.mean)
    }

    /// Whether both are values of one node on frames with equal source values, with the same scoring.
    fn is_identical(&self) -> bool {
        fn node<'a>(side: &'a super::ScoredBy<'_>) -> Option<(&'a Key, &'a str)> {
            let estimate = side.estimate;
            let (topic, run) = (estimate.scored_output.as_deref()?, &side.run.recording.plan().runs[estimate.run]);
            run.nodes.iter().find_map(|node| {
                let output = node.outputs.iter().find(|output| output.topic == topic)?;
                Some((&node.node_hash, output.port.as_str()))
            })
        }
        let (one, two) = (self.baseline.estimate, self.other.estimate);
        let is_one_node = node(&self.baseline).is_some() && node(&self.baseline) == node(&self.other);
        is_one_node
            && one.settings == two.settings
            && one.truth_output == two.truth_output
            && one.uncertainty == two.uncertainty
            && self.paired.other_values == 0
    }

    /// Whether both have the same scoring. If not, differences also contain the difference of scoring.
    pub(super) fn is_scored_alike(&self, options: &CompareOptions) -> bool {
        let (one, two) = (self.baseline.estimate, self.other.estimate);
        one.settings == two.settings && (options.selection.mean.is_some() || one.mean == two.mean)
    }
}
