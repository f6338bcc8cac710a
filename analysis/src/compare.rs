//! Compares the scores of runs, variants or estimates, paired over frames: differences with intervals, tests, wins and
//! losses.
//!
//! The sampling unit is the frame, because pixels within a frame are correlated. Frames are resampled and ranked, never
//! pixels.

mod contrast;
mod distance;
mod frames;
mod limit;
mod output;
mod side;
mod table;
mod with_best;

use depthloom_graphs::counted;
use depthloom_graphs::language::glob;
use depthloom_recording::Recording;
use depthloom_scores::PixelSet;

pub use distance::{DistanceComparison, DistanceComparisonOutput, compare_by_distance};
pub(crate) use distance::{DistancePair, DistanceRow, Statistic};
pub use output::ComparisonOutput;
pub use side::{Side, names};
pub use table::Comparison;
pub(crate) use with_best::{Differences, with_best};

use crate::ablation::{Ablation, Row, Selection, scored, select_frames, shared_scores, source_keys};
use crate::error::{AnalysisError, caught, listed, unknown};
use crate::estimates::{Estimate, estimate_names, estimates};
use crate::scores::FrameScore;
use crate::statistics::{Grouping, Resampling};
use crate::tables::Typesetting;
use contrast::contrasts;
use frames::{Paired, ScoredBy};
use limit::Limit;
use side::{Kind, Party, parties};
use table::Compared;

/// With fewer frames, intervals are too narrow.
const FEW: usize = 10;

/// The number of variants from which on the best one gets a note on selection.
const SEVERAL: usize = 3;

/// The significance level of tests, rounded for text.
fn significance(resampling: &Resampling) -> f64 {
    ((1.0 - resampling.confidence) * 1e8).round() / 1e8
}

/// The note for comparisons over few frames.
pub(crate) fn few_frames(units: usize, unit: &str) -> Option<String> {
    let frames = (units < FEW).then(|| counted(units, unit))?;
    Some(format!("only {frames}: with so few, intervals are too narrow and tests have little power"))
}

/// A compared run.
#[derive(Clone, Copy, Debug)]
pub struct ComparedRun<'a> {
    /// Its name.
    pub called: &'a str,
    /// Its recording.
    pub recording: &'a Recording,
}

/// The options of a comparison.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CompareOptions {
    /// The pixels, frames and estimates that are compared.
    pub selection: Selection,
    /// The metrics; empty: all that both sides have.
    pub scores: Vec<String>,
    /// The side that the others are compared with: its name, or `best`. `None`: the first side.
    pub baseline: Option<String>,
    /// The resampling of frames for intervals. Its confidence is also that of tests.
    pub resampling: Resampling,
    /// The groups of frames that are resampled and ranked together; `None`: each frame alone.
    pub grouping: Option<Grouping>,
    /// Limits on changes that make the comparison fail, for example `fused.abs_rel > +1%`.
    pub fail_if: Vec<String>,
    /// The typesetting of the table.
    pub typesetting: Typesetting,
}

/// A run with its estimates and scores.
struct RunScores<'a> {
    run: ComparedRun<'a>,
    estimates: Vec<Estimate>,
    scores: Vec<FrameScore>,
}

/// Two estimates over their common frames.
struct Pair<'a> {
    /// The place of the other side among the parties, and the name by which both estimates were paired.
    party: usize,
    name: String,
    baseline: ScoredBy<'a>,
    other: ScoredBy<'a>,
    set: PixelSet,
    paired: Paired<'a>,
}

/// Compares sides with the first side, or with a baseline, from recorded scores. Maps are read only for `--pixels
/// common`.
///
/// # Errors
/// If a recording cannot be read or its scores are damaged; [`AnalysisError::Request`] if a requested name does not
/// exist or the sides have no common frame; [`AnalysisError::Stopped`] once `stop` returns true.
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
        let mut run_scores = Vec::new();
        for (place, (run, estimates)) in runs.iter().zip(all).enumerate() {
            let (estimates, scores) = if options.selection.common {
                scores_on_common_pixels(run, place, &estimates, &parties, &options.selection, stop)?
            } else {
                let scores = scored(run.recording, &estimates, stop)?;
                (estimates, scores)
            };
            let scores = select_frames(run.recording, &estimates, scores, &options.selection)?;
            run_scores.push(RunScores { run: *run, estimates, scores });
        }
        let sources: Vec<_> = runs.iter().map(|run| source_keys(run.recording)).collect();
        let ablations: Vec<Ablation<'_>> = (run_scores.iter().zip(&sources))
            .map(|(own, source)| Ablation::new(own.run.recording.plan(), &own.estimates, &own.scores, source, None))
            .collect();
        let check_selection = |ablation: &Ablation<'_>| {
            ablation.zone(&options.selection)?;
            ablation.check_set(&options.selection)
        };
        ablations.iter().try_for_each(check_selection)?;
        for score in &options.scores {
            if ablations.iter().all(|ablation| ablation.metric(score).is_err()) {
                ablations[0].metric(score)?;
            }
        }
        let baseline = side::baseline(&parties, options, |party| best_of(party, &run_scores, &ablations, options))?;
        let (pairs, mut notes) = pairs(&run_scores, &ablations, &parties, baseline, options)?;
        if kind != Kind::Runs && !options.selection.common {
            notes.extend(selection_notes(&parties, &run_scores, &ablations, options));
        }
        let contrasts = contrasts(&pairs, options, stop)?;
        if contrasts.is_empty() {
            let titles: Vec<&str> = parties.iter().map(|party| party.title.as_str()).collect();
            return Err(AnalysisError::request(
                format!("no metric was scored on common frames of {}", titles.join(" and ")),
                "`depthloom table RUN` shows what was scored".to_owned(),
            ));
        }
        let limits = limit::judged(&limits, &pairs, &contrasts, options)?;
        let (run_scores, parties, pairs, contrasts) = (&run_scores, &parties, &pairs, &contrasts);
        Ok(Compared { kind, run_scores, parties, baseline, pairs, contrasts, options }.comparison(limits, notes))
    })
}

/// The estimates of the parties, scored again over the pixels that are valid in all of them.
fn scores_on_common_pixels(
    run: &ComparedRun<'_>,
    place: usize,
    estimates: &[Estimate],
    parties: &[Party],
    selection: &Selection,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Vec<Estimate>, Vec<FrameScore>), AnalysisError> {
    if parties.iter().any(|party| party.run != place) {
        return Err(AnalysisError::request(
            "`--pixels common` needs estimates of a single run".to_owned(),
            "compare variants or estimates of one run, or choose another `--pixels`".to_owned(),
        ));
    }
    let is_compared = |estimate: &&Estimate| parties.iter().any(|party| party.has(&estimate.label));
    let compared: Vec<Estimate> = estimates.iter().filter(is_compared).cloned().collect();
    shared_scores(run.recording, &compared, &Selection { estimates: None, ..selection.clone() }, stop)
}

/// The best value of a party by the first requested metric, and whether higher values are better.
fn best_of(
    party: &Party,
    run_scores: &[RunScores<'_>],
    ablations: &[Ablation<'_>],
    options: &CompareOptions,
) -> Result<Option<(f64, bool)>, AnalysisError> {
    let (ablation, estimates) = (&ablations[party.run], &run_scores[party.run].estimates);
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

/// Notes on sides that are the best of several variants, not all of which are compared: such a side may have been
/// chosen because of these scores, and the correction for multiple tests does not know the other variants.
fn selection_notes(
    parties: &[Party],
    run_scores: &[RunScores<'_>],
    ablations: &[Ablation<'_>],
    options: &CompareOptions,
) -> Vec<String> {
    let mut notes = Vec::new();
    for party in parties {
        let (ablation, estimates) = (&ablations[party.run], &run_scores[party.run].estimates);
        let selection = Selection { estimates: None, ..options.selection.clone() };
        let Ok(rows) = ablation.rows(&selection) else { continue };
        let metric = match options.scores.first().map(|name| ablation.metric(name)) {
            Some(Ok(metric)) => metric,
            Some(Err(_)) => continue,
            None => ablation.first_error(&rows),
        };
        let is_compared = |row: &Row| {
            let is_own = |other: &Party| other.run == party.run && other.has(&estimates[row.estimate].label);
            parties.iter().any(is_own)
        };
        for own in rows.iter().filter(|row| party.has(&estimates[row.estimate].label)) {
            let (name, class) = (&estimates[own.estimate].name, own.comparable_by(metric));
            let is_candidate = |row: &&Row| {
                let is_variant = estimates[row.estimate].name == *name && row.comparable_by(metric) == class;
                is_variant && row.value(metric).is_some()
            };
            let candidates: Vec<&Row> = rows.iter().filter(is_candidate).collect();
            let (Some(_), Some(value)) = (class, own.value(metric)) else { continue };
            let good = |value: f64| ablation.metrics[metric].goodness(value);
            let others = candidates.iter().filter(|row| row.estimate != own.estimate);
            let is_best = others.filter_map(|row| row.value(metric)).all(|other| good(other) < good(value));
            if is_best && candidates.len() >= SEVERAL && candidates.iter().any(|row| !is_compared(row)) {
                let note = format!(
                    "{} has the best {} of {} variants on the same frames: if it was chosen because of that, its advantage is overestimated; confirm it on other frames",
                    party.title,
                    ablation.metrics[metric].name,
                    candidates.len()
                );
                if !notes.contains(&note) {
                    notes.push(note);
                }
            }
        }
    }
    notes
}

/// The pairs of each side with the baseline, and notes on estimates without a pair.
fn pairs<'a>(
    run_scores: &'a [RunScores<'a>],
    ablations: &[Ablation<'a>],
    parties: &[Party],
    baseline: usize,
    options: &CompareOptions,
) -> Result<(Vec<Pair<'a>>, Vec<String>), AnalysisError> {
    let (mut pairs, mut notes) = (Vec::new(), Vec::new());
    let first = &parties[baseline];
    for (place, party) in parties.iter().enumerate().filter(|(place, _)| *place != baseline) {
        let mut unpaired = Vec::new();
        for (name, label) in &party.entries {
            let Some((_, base)) = first.entries.iter().find(|(known, _)| known == name) else {
                unpaired.push(name.as_str());
                continue;
            };
            let estimate_of = |party: &Party, label: &str| {
                let own = &run_scores[party.run];
                let index = own.estimates.iter().position(|estimate| estimate.label == label)?;
                Some((own, index, &own.estimates[index]))
            };
            let sides = (estimate_of(first, base), estimate_of(party, label));
            let (Some((one, base, estimate)), Some((two, other, against))) = sides else {
                continue;
            };
            let selected = match options.selection.set {
                _ if options.selection.common => Some(PixelSet::All),
                set => set,
            };
            let sets = [PixelSet::All, PixelSet::Valid, PixelSet::Filled].into_iter();
            let mut both = sets.filter(|set| estimate.sets.contains(set) && against.sets.contains(set));
            let Some(set) = both.find(|set| selected.is_none_or(|selected| selected == *set)) else {
                unpaired.push(name.as_str());
                continue;
            };
            let scores = |place: usize, index: usize| {
                ablations[place].zone(&options.selection).map(|zone| ablations[place].frames(index, set, zone).to_vec())
            };
            let baseline = ScoredBy { run: one.run, estimate, scores: scores(first.run, base)? };
            let other = ScoredBy { run: two.run, estimate: against, scores: scores(party.run, other)? };
            let paired = Paired::new(&baseline, &other);
            if paired.frames.is_empty() {
                notes.push(format!(
                    "{} and {} have no common frame",
                    baseline.title(run_scores.len()),
                    other.title(run_scores.len())
                ));
                continue;
            }
            pairs.push(Pair { party: place, name: name.clone(), baseline, other, set, paired });
        }
        if !unpaired.is_empty() {
            notes.push(format!(
                "estimates of {} without a counterpart on the same pixels in {}: {}",
                party.title,
                first.title,
                listed(unpaired)
            ));
        }
    }
    if pairs.is_empty() {
        let what = notes
            .first()
            .cloned()
            .unwrap_or_else(|| format!("{} has no estimate whose name occurs in another side", first.title));
        return Err(AnalysisError::request(
            what,
            "name the estimates to compare: `compare RUN full/fused full/mono`, `compare A:fused B:fused`".to_owned(),
        ));
    }
    Ok((pairs, notes))
}

/// The error for an unknown variant or estimate, with the nearest known name.
fn no_such(name: &str, estimates: &[Estimate], variants: &[String]) -> AnalysisError {
    if let Some(variant) = variants.iter().find(|known| !known.is_empty() && glob(name, known)) {
        let others = listed(estimate_names(estimates));
        return AnalysisError::request(
            format!("cannot compare variant `{variant}`: its estimates are identical in all variants"),
            format!("name variants that differ, or estimates; available: {others}"),
        );
    }
    let known: Vec<&str> =
        variants.iter().map(String::as_str).filter(|name| !name.is_empty()).chain(estimate_names(estimates)).collect();
    unknown("variant or estimate", name, known)
}
