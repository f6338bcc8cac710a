//! Is it really better? Scores of runs, variants or estimates, paired over frames: differences with their intervals,
//! tests, wins and losses.
//!
//! Frames are the sample: two frames of a street are less alike than two pixels of a frame, so that frames are
//! resampled and ranked, never pixels.

mod contrast;
mod distance;
mod frames;
mod limit;
mod output;
mod side;
mod table;

use depthloom_graphs::counted;
use depthloom_recording::Recording;
use depthloom_scores::PixelSet;

pub use distance::{DistanceComparison, DistanceComparisonOutput, compare_by_distance};
pub(crate) use distance::{DistancePair, DistanceRow, Statistic};
pub use output::ComparisonOutput;
pub use side::{Side, names};
pub use table::Comparison;

use crate::ablation::{Ablation, Selection, of_frames, scored, shared_scores, source_of};
use crate::error::{AnalysisError, caught, listed, unknown};
use crate::estimates::{Estimate, estimates, names_of};
use crate::scores::FrameScore;
use crate::statistics::Resampling;
use crate::tables::Typesetting;
use contrast::contrasts;
use frames::{Paired, ScoredBy};
use limit::Limit;
use side::{Party, parties};
use table::Compared;

/// Of so few frames intervals are too narrow.
const FEW: usize = 10;

/// The probability below which a test decides, rounded for text.
fn significance(resampling: &Resampling) -> f64 {
    ((1.0 - resampling.confidence) * 1e8).round() / 1e8
}

/// The note of comparisons over few frames.
fn few_frames(frames: usize) -> Option<String> {
    let frames = (frames < FEW).then(|| counted(frames, "frame"))?;
    Some(format!("{frames}: intervals of so few are too narrow, and tests find little"))
}

/// A run that takes part.
#[derive(Clone, Copy, Debug)]
pub struct ComparedRun<'a> {
    /// What it is called.
    pub called: &'a str,
    /// Its recording.
    pub recording: &'a Recording,
}

/// What of the scores is compared, and how.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CompareOptions {
    /// Which pixels, which estimates of the sides.
    pub selection: Selection,
    /// The scores; empty: all that both have.
    pub scores: Vec<String>,
    /// What the others are held against: the name of a side, or `best`; `None`: the first.
    pub baseline: Option<String>,
    /// How frames are resampled for intervals. Its confidence is also what tests are held against.
    pub resampling: Resampling,
    /// What must not be, as `fused.abs_rel > +1%`.
    pub fail_if: Vec<String>,
    /// How the table is set.
    pub typesetting: Typesetting,
}

/// A run with its scores.
struct Opened<'a> {
    run: ComparedRun<'a>,
    estimates: Vec<Estimate>,
    scores: Vec<FrameScore>,
}

/// Two estimates over the frames that both have.
struct Pair<'a> {
    /// The place of the other among the parties, and what the two have in common by name.
    party: usize,
    name: String,
    baseline: ScoredBy<'a>,
    other: ScoredBy<'a>,
    set: PixelSet,
    paired: Paired<'a>,
}

/// Compares sides with the first, or with a baseline, from scores that were recorded; no map is read, but for the
/// pixels that are valid in all.
///
/// # Errors
/// If a recording cannot be read or is damaged where scores are; [`AnalysisError::Request`] if what was asked for is
/// not there, or has no frame in common; [`AnalysisError::Stopped`] once `stop` says so.
pub fn compare(
    runs: &[ComparedRun<'_>],
    sides: &[Side],
    options: &CompareOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Comparison, AnalysisError> {
    caught(|| {
        let limits = options.fail_if.iter().map(|text| Limit::parse(text)).collect::<Result<Vec<_>, _>>()?;
        let all = runs.iter().map(|run| estimates(run.recording.plan())).collect::<Result<Vec<_>, _>>()?;
        let (kind, parties) = parties(runs, &all, sides, options.selection.estimates.as_deref())?;
        let mut opened = Vec::new();
        for (place, (run, estimates)) in runs.iter().zip(all).enumerate() {
            let (estimates, scores) = if options.selection.common {
                of_common_pixels(run, place, &estimates, &parties, &options.selection, stop)?
            } else {
                let scores = scored(run.recording, &estimates, stop)?;
                (estimates, scores)
            };
            let scores = of_frames(run.recording, &estimates, scores, &options.selection)?;
            opened.push(Opened { run: *run, estimates, scores });
        }
        let sources: Vec<_> = runs.iter().map(|run| source_of(run.recording)).collect();
        let ablations: Vec<Ablation<'_>> = (opened.iter().zip(&sources))
            .map(|(of, source)| Ablation::new(of.run.recording.plan(), &of.estimates, &of.scores, source, None))
            .collect();
        let asked = |ablation: &Ablation<'_>| {
            ablation.zone(&options.selection)?;
            ablation.check_set(&options.selection)
        };
        ablations.iter().try_for_each(asked)?;
        for score in &options.scores {
            if ablations.iter().all(|ablation| ablation.metric(score).is_err()) {
                ablations[0].metric(score)?;
            }
        }
        let baseline = side::baseline(&parties, options, |party| best_of(party, &opened, &ablations, options))?;
        let (pairs, notes) = pairs(&opened, &ablations, &parties, baseline, options)?;
        let contrasts = contrasts(&pairs, options, stop)?;
        if contrasts.is_empty() {
            let titles: Vec<&str> = parties.iter().map(|party| party.title.as_str()).collect();
            return Err(AnalysisError::asked(
                format!("there is no score that {} have on frames of both", titles.join(" and ")),
                "`depthloom table RUN` says what was scored".to_owned(),
            ));
        }
        let limits = limit::judged(&limits, &pairs, &contrasts, options)?;
        let (opened, parties, pairs, contrasts) = (&opened, &parties, &pairs, &contrasts);
        Ok(Compared { kind, opened, parties, baseline, pairs, contrasts, options }.comparison(limits, notes))
    })
}

/// The estimates of the parties, scored again on the pixels that are valid in all of them.
fn of_common_pixels(
    run: &ComparedRun<'_>,
    place: usize,
    estimates: &[Estimate],
    parties: &[Party],
    selection: &Selection,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Vec<Estimate>, Vec<FrameScore>), AnalysisError> {
    if parties.iter().any(|party| party.run != place) {
        return Err(AnalysisError::asked(
            "the pixels that are valid in all are known of one run's estimates".to_owned(),
            "compare variants or estimates of one run, or take another --set".to_owned(),
        ));
    }
    let is_in = |of: &&Estimate| parties.iter().any(|party| party.has(&of.label));
    let some: Vec<Estimate> = estimates.iter().filter(is_in).cloned().collect();
    shared_scores(run.recording, &some, &Selection { estimates: None, ..selection.clone() }, stop)
}

/// The best value of a party by the first score that is asked for, and whether more of it is better.
fn best_of(
    party: &Party,
    opened: &[Opened<'_>],
    ablations: &[Ablation<'_>],
    options: &CompareOptions,
) -> Result<Option<(f64, bool)>, AnalysisError> {
    let (ablation, estimates) = (&ablations[party.run], &opened[party.run].estimates);
    let rows = ablation.rows(&Selection { estimates: None, common: false, ..options.selection.clone() })?;
    let metric = match options.scores.first() {
        Some(score) => ablation.metric(score)?,
        None => ablation.first_error(&rows),
    };
    let more = ablation.metrics[metric].more_is_better;
    let values =
        rows.iter().filter(|row| party.has(&estimates[row.estimate].label)).filter_map(|row| row.value(metric));
    let best = values.reduce(|best, value| if (value > best) == more { value } else { best });
    Ok(best.map(|best| (best, more)))
}

/// The pairs, other by other, and what is to be said of those that are none.
fn pairs<'a>(
    opened: &'a [Opened<'a>],
    ablations: &[Ablation<'a>],
    parties: &[Party],
    baseline: usize,
    options: &CompareOptions,
) -> Result<(Vec<Pair<'a>>, Vec<String>), AnalysisError> {
    let (mut pairs, mut notes) = (Vec::new(), Vec::new());
    let first = &parties[baseline];
    for (place, party) in parties.iter().enumerate().filter(|(place, _)| *place != baseline) {
        let mut left_out = Vec::new();
        for (name, label) in &party.entries {
            let Some((_, base)) = first.entries.iter().find(|(of, _)| of == name) else {
                left_out.push(name.as_str());
                continue;
            };
            let of = |party: &Party, label: &str| {
                let opened = &opened[party.run];
                let index = opened.estimates.iter().position(|of| of.label == label)?;
                Some((opened, index, &opened.estimates[index]))
            };
            let (Some((one, base, estimate)), Some((two, other, against))) = (of(first, base), of(party, label)) else {
                continue;
            };
            let wanted = match options.selection.set {
                _ if options.selection.common => Some(PixelSet::All),
                set => set,
            };
            let sets = [PixelSet::All, PixelSet::Valid, PixelSet::Filled].into_iter();
            let mut both = sets.filter(|set| estimate.sets.contains(set) && against.sets.contains(set));
            let Some(set) = both.find(|set| wanted.is_none_or(|wanted| wanted == *set)) else {
                left_out.push(name.as_str());
                continue;
            };
            let scores = |place: usize, index: usize| {
                ablations[place].zone(&options.selection).map(|zone| ablations[place].frames(index, set, zone).to_vec())
            };
            let baseline = ScoredBy { run: one.run, estimate, scores: scores(first.run, base)? };
            let other = ScoredBy { run: two.run, estimate: against, scores: scores(party.run, other)? };
            let paired = Paired::of(&baseline, &other);
            if paired.frames.is_empty() {
                notes.push(format!(
                    "{} and {} have no frame in common",
                    baseline.title(opened.len()),
                    other.title(opened.len())
                ));
                continue;
            }
            pairs.push(Pair { party: place, name: name.clone(), baseline, other, set, paired });
        }
        if !left_out.is_empty() {
            notes.push(format!(
                "of {} alone, or not scored on the same pixels in {}: {}",
                party.title,
                first.title,
                listed(left_out)
            ));
        }
    }
    if pairs.is_empty() {
        let what = notes
            .first()
            .cloned()
            .unwrap_or_else(|| format!("{} has no estimate of a name that another side has too", first.title));
        return Err(AnalysisError::asked(
            what,
            "name estimates to hold against each other: `compare RUN full/fused full/mono`, `compare A:fused B:fused`"
                .to_owned(),
        ));
    }
    Ok((pairs, notes))
}

/// That a side has no such name, with the nearest that is there.
fn no_such(name: &str, estimates: &[Estimate], variants: &[String]) -> AnalysisError {
    let known: Vec<&str> =
        variants.iter().map(String::as_str).filter(|name| !name.is_empty()).chain(names_of(estimates)).collect();
    unknown("variant or estimate", name, known)
}
