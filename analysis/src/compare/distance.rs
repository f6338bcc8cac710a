//! Compares the absolute errors of pairs by ground-truth distance, on the pixels that are valid in both, paired over
//! frames. Also computes the handover distance, at which the better of the two estimates changes.
//!
//! The mean and median of a bin cover all its pixels, as in `analyse --pixels common`. The sampling unit is the frame:
//! intervals resample frames with all their pixels, and tests use the means and medians of frames.

mod handover;
mod median;
mod output;
mod read;
mod table;

use std::path::PathBuf;

pub(crate) use handover::{Handover, Near};
pub use output::DistanceComparisonOutput;
pub use table::DistanceComparison;

use super::contrast::Verdict;
use super::side::{self, parties};
use super::{CompareOptions, ComparedRun, Side};
use crate::error::{AnalysisError, caught};
use crate::estimates::estimates;
use crate::input::condition::recording_notes;
use crate::query::{Bins, frames_of};
use crate::samples::SamplesFile;
use crate::statistics::{Interval, SignedRank, Statistic as FrameStatistic, holm};
use crate::titles::Titles;
use median::Median;
use read::{BinPixels, Pixels};

/// The default width of a bin, metres.
const WIDTH_M: f64 = 5.0;
/// Bins with fewer pixels are ignored for the handover distance.
pub(crate) const MIN_PIXELS: u64 = 100;

/// The statistic of the absolute errors of a bin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Statistic {
    Mean,
    Median,
}

impl Statistic {
    pub(crate) const ALL: [Self; 2] = [Self::Mean, Self::Median];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::Median => "median",
        }
    }
}

/// An estimate compared with another.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DistancePair {
    /// The baseline, then the other.
    pub(crate) estimates: [Compared; 2],
    /// The number of common frames.
    pub(crate) frames: usize,
    /// The handover distance by mean, then by median, if there is one.
    pub(crate) handovers: Vec<(Statistic, Option<Handover>)>,
    /// Statistic by statistic, near bins first.
    pub(crate) rows: Vec<DistanceRow>,
}

/// An estimate that is compared.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Compared {
    pub(crate) run: String,
    pub(crate) stage: String,
    pub(crate) variant: Option<String>,
    pub(crate) estimate: String,
    /// Its label, with its run if there are several.
    pub(crate) title: String,
}

/// A statistic of a pair in a bin.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DistanceRow {
    pub(crate) statistic: Statistic,
    pub(crate) from_m: f64,
    pub(crate) to_m: f64,
    pub(crate) pixels: u64,
    /// The number of frames with pixels in the bin.
    pub(crate) frames: usize,
    pub(crate) baseline_m: f64,
    pub(crate) value_m: f64,
    pub(crate) interval: Option<Interval>,
    pub(crate) wins: u64,
    pub(crate) ties: u64,
    pub(crate) losses: u64,
    pub(crate) test: Option<SignedRank>,
    pub(crate) p_holm: Option<f64>,
    pub(crate) verdict: Verdict,
}

impl DistanceRow {
    pub(crate) fn difference_m(&self) -> f64 {
        self.value_m - self.baseline_m
    }
}

/// Compares sides with the first side, or with a baseline, by ground-truth distance. `samples` are the samples files of
/// the runs.
///
/// # Errors
/// If a recording or samples cannot be read; [`AnalysisError::Request`] if a requested name does not exist or the sides
/// have no common pixel; [`AnalysisError::Stopped`] once `stop` returns true.
pub fn compare_by_distance(
    runs: &[ComparedRun<'_>],
    samples: &[PathBuf],
    sides: &[Side],
    options: &CompareOptions,
    bins: Option<&Bins>,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<DistanceComparison, AnalysisError> {
    caught(|| {
        let all = runs.iter().map(|run| estimates(run.recording.plan())).collect::<Result<Vec<_>, _>>()?;
        let (_, parties) = parties(runs, &all, sides, options.selection.estimates.as_deref())?;
        let baseline = side::baseline(&parties, options, |_| Ok(None))?;
        let mut files = samples.iter().map(|path| SamplesFile::open(path)).collect::<Result<Vec<_>, _>>()?;
        if let Some(choice) = &options.selection.frames {
            for (file, run) in files.iter_mut().zip(runs) {
                let frames = frames_of(run.recording, choice)?;
                file.parts.retain(|part| part.is_selected(Some(&frames)));
            }
        }
        let bins = bins.cloned().unwrap_or(Bins::Width(WIDTH_M));
        let (mut pairs, mut notes) = (Vec::new(), Vec::new());
        let first = &parties[baseline];
        for party in parties.iter().enumerate().filter(|(place, _)| *place != baseline).map(|(_, party)| party) {
            for (name, label) in &party.entries {
                let Some((_, base)) = first.entries.iter().find(|(known, _)| known == name) else { continue };
                let sides = [(first.run, base.as_str()), (party.run, label.as_str())];
                let side = |(run, label): (usize, &str)| {
                    let found = files[run].described.estimates.iter().find(|estimate| estimate.label == label)?;
                    let title = if runs.len() > 1 { format!("{}:{label}", runs[run].called) } else { label.to_owned() };
                    let (run, stage) = (runs[run].called.to_owned(), found.stage.clone());
                    let (variant, estimate) = (found.variant.clone(), found.estimate.clone());
                    Some((found, Compared { run, stage, variant, estimate, title }))
                };
                // Disparities and unrecorded depths have no samples.
                let (Some((one, baseline)), Some((two, other))) = (side(sides[0]), side(sides[1])) else {
                    notes.push(format!("{label} or {base} has no samples: only recorded depths have samples"));
                    continue;
                };
                if one.scoring != two.scoring {
                    notes.push(format!(
                        "{label} and {base} were scored in different ways ({}; {}): differences also include the difference of scoring",
                        two.scoring, one.scoring
                    ));
                }
                let pixels = read::pixels([(&files[sides[0].0], one), (&files[sides[1].0], two)], &bins, stop)?;
                notes.extend(pixels.note(&baseline.title, &other.title));
                if pixels.bins.is_empty() {
                    continue;
                }
                pairs.push(pair([baseline, other], &pixels, options, stop)?);
            }
        }
        if pairs.is_empty() {
            let what = notes
                .first()
                .cloned()
                .unwrap_or_else(|| format!("{} has no estimate whose name occurs in another side", first.title));
            let help = "name the estimates to compare: `compare RUN stereo full/mono --by distance`";
            return Err(AnalysisError::request(what, help.to_owned()));
        }
        for run in runs {
            let prefix = if runs.len() > 1 { format!("{}: ", run.called) } else { String::new() };
            notes.extend(recording_notes(run.recording).into_iter().map(|note| format!("{prefix}{note}")));
        }
        let key = crate::tables::plan_key(runs[first.run].recording.plan());
        let mut comparison = table::comparison(pairs, notes, options, key, runs.len() > 1);
        Titles::new(runs.iter().map(|run| run.recording.plan())).apply(&mut comparison.table);
        Ok(comparison)
    })
}

/// Compares one pair.
fn pair(
    estimates: [Compared; 2],
    pixels: &Pixels,
    options: &CompareOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<DistancePair, AnalysisError> {
    let mut rows = Vec::new();
    let mut handovers = Vec::new();
    for statistic in Statistic::ALL {
        let medians: Vec<[Median; 2]> = match statistic {
            Statistic::Mean => Vec::new(),
            Statistic::Median => pixels.bins.iter().map(|bin| bin.medians(pixels.frames)).collect(),
        };
        // Computes the statistic of both sides in a bin, and the number of pixels, for these weights of frames.
        let value = |at: usize, times: &[f64]| -> ([f64; 2], f64) {
            let bin = &pixels.bins[at];
            let count = bin.frames.iter().map(|own| times[own.frame] * own.count as f64).sum::<f64>();
            let values = match statistic {
                Statistic::Mean => [0, 1]
                    .map(|side| bin.frames.iter().map(|own| times[own.frame] * own.sums[side]).sum::<f64>() / count),
                Statistic::Median => [0, 1].map(|side| medians[at][side].value(times)),
            };
            (values, count)
        };
        let mut statistic_rows = Vec::new();
        let mut numbers: Vec<(usize, Box<FrameStatistic<'_>>)> = Vec::new();
        let once = vec![1.0; pixels.frames];
        for (at, bin) in pixels.bins.iter().enumerate() {
            let ([baseline_m, value_m], _) = value(at, &once);
            statistic_rows.push(row(statistic, bin, baseline_m, value_m));
            let (value, frames) = (&value, pixels.frames);
            // Only the frames with pixels in the bin are resampled.
            numbers.push((
                bin.frames.len(),
                Box::new(move |times: &[f64]| {
                    let mut all_times = vec![0.0; frames];
                    bin.frames.iter().zip(times).for_each(|(own, times)| all_times[own.frame] = *times);
                    let ([one, two], _) = value(at, &all_times);
                    two - one
                }),
            ));
        }
        let intervals = options.resampling.intervals_of(&numbers, stop)?;
        drop(numbers);
        statistic_rows.iter_mut().zip(intervals).for_each(|(row, interval)| row.interval = interval);
        correct(&mut statistic_rows, 1.0 - options.resampling.confidence);
        let middles: Vec<f64> = pixels.bins.iter().map(|bin| 0.5 * (bin.from_m + bin.to_m)).collect();
        let curve = |times: &[f64]| -> Vec<(f64, f64, f64)> {
            let bins = (0..pixels.bins.len()).map(|at| {
                let ([one, two], count) = value(at, times);
                (middles[at], two - one, count)
            });
            bins.filter(|(_, difference, count)| *count >= MIN_PIXELS as f64 && difference.is_finite()).collect()
        };
        handovers.push((statistic, handover::handover(&curve, pixels.frames, &options.resampling, stop)?));
        rows.extend(statistic_rows);
    }
    Ok(DistancePair { estimates, frames: pixels.frames, handovers, rows })
}

fn row(statistic: Statistic, bin: &BinPixels, baseline_m: f64, value_m: f64) -> DistanceRow {
    let frame_values = |frame: &read::FramePixels| match statistic {
        Statistic::Mean => frame.sums.map(|sum| sum / frame.count as f64),
        Statistic::Median => frame.medians,
    };
    let differences: Vec<f64> = bin.frames.iter().map(frame_values).map(|[one, two]| two - one).collect();
    let count = |is: &dyn Fn(f64) -> bool| differences.iter().filter(|difference| is(**difference)).count() as u64;
    DistanceRow {
        statistic,
        from_m: bin.from_m,
        to_m: bin.to_m,
        pixels: bin.frames.iter().map(|frame| frame.count).sum(),
        frames: bin.frames.len(),
        baseline_m,
        value_m,
        interval: None,
        wins: count(&|difference| difference < 0.0),
        ties: count(&|difference| difference == 0.0),
        losses: count(&|difference| difference > 0.0),
        test: SignedRank::test(&differences),
        p_holm: None,
        verdict: Verdict::Unclear,
    }
}

/// Corrects the tests of all bins and sets the verdicts.
fn correct(rows: &mut [DistanceRow], level: f64) {
    let tested: Vec<(usize, f64)> =
        rows.iter().enumerate().filter_map(|(place, row)| Some((place, row.test?.p))).collect();
    let corrected = holm(&tested.iter().map(|(_, p)| *p).collect::<Vec<_>>());
    for ((place, _), p) in tested.into_iter().zip(corrected) {
        rows[place].p_holm = Some(p);
    }
    for row in rows {
        let (Some(p), Some(Interval { low, high })) = (row.p_holm, row.interval) else { continue };
        row.verdict = match (p < level, low > 0.0, high < 0.0) {
            (true, true, _) => Verdict::Worse,
            (true, _, true) => Verdict::Better,
            _ => Verdict::Unclear,
        };
    }
}
