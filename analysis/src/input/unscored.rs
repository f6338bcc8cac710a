//! Frames without a pixel to score, and the reason. Means do not show them.

use std::collections::BTreeMap;

use depthloom_graphs::Value;
use depthloom_graphs::plan::FrameIndex;
use depthloom_recording::Recording;
use depthloom_scores::ScoredPixels;

use crate::error::AnalysisError;
use crate::estimates::Estimate;
use crate::scores::FrameScore;

/// The number of frames that are named, and of those whose ground truth is inspected.
const NAMED: usize = 5;
const LOOKED_AT: usize = 16;

/// A note on frames that were not scored.
#[derive(Default)]
pub(crate) struct Unscored {
    /// Their number, names and reason; `None` if all frames were scored.
    pub(crate) note: Option<String>,
    /// Whether there are frames, but none of them has a scored pixel.
    pub(crate) everything: bool,
}

impl Unscored {
    /// Inspects all scores of a recording.
    pub(crate) fn new(
        recording: &Recording,
        estimates: &[Estimate],
        scores: &[FrameScore],
    ) -> Result<Self, AnalysisError> {
        if scores.is_empty() {
            return Self::without_a_score(recording, estimates);
        }
        let runs = &recording.plan().runs;
        // Variants may score the same frame in several runs of a stage.
        let mut frames: BTreeMap<(&str, FrameIndex, &str), (usize, u64)> = BTreeMap::new();
        for score in scores {
            let estimate = &estimates[score.estimate];
            let place = (runs[estimate.run].stage.as_str(), score.position, &*score.frame);
            frames.entry(place).or_insert((score.estimate, 0)).1 += score.row.pixels;
        }
        let all = frames.len();
        let empty: Vec<(usize, FrameIndex, &str)> = frames
            .into_iter()
            .filter(|(_, (_, pixels))| *pixels == 0)
            .map(|((_, position, id), (estimate, _))| (estimate, position, id))
            .collect();
        if empty.is_empty() {
            return Ok(Self::default());
        }
        let everything = empty.len() == all;
        let why = cause(recording, estimates, &empty, everything)?;
        let note = if everything {
            format!("not one pixel was scored: {why}")
        } else {
            let named: Vec<&str> = empty.iter().take(NAMED).map(|(.., id)| *id).collect();
            let more = match empty.len().saturating_sub(NAMED) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            let (frames, have, are) = if empty.len() == 1 { ("frame", "has", "is") } else { ("frames", "have", "are") };
            let (count, named) = (empty.len(), named.join(", "));
            format!("{count} {frames} {have} no pixel to score and {are} excluded from all means: {named}{more}; {why}")
        };
        Ok(Self { note: Some(note), everything })
    }
}

impl Unscored {
    /// Inspects a recording without scores.
    fn without_a_score(recording: &Recording, estimates: &[Estimate]) -> Result<Self, AnalysisError> {
        let complete_frames = |estimate: &Estimate| {
            let frames = FrameIndex::enumerate(recording.frames(estimate.run));
            frames.filter(|(_, frame)| frame.failures.is_empty()).map(|(position, _)| position).collect::<Vec<_>>()
        };
        let scored = estimates.iter().filter(|estimate| estimate.score_topic.is_some());
        let mut with_frames =
            scored.map(|estimate| (estimate, complete_frames(estimate))).filter(|(_, frames)| !frames.is_empty());
        // Failures are reported elsewhere.
        let Some((first, frames)) = with_frames.next() else { return Ok(Self::default()) };
        let truth =
            first.truth_output.as_deref().or(first.truth_topic.as_deref()).unwrap_or("truth").trim_start_matches('/');
        let mut has_truth = false;
        if let Some(topic) = &first.truth_topic {
            let mut reader = recording.reader(first.run, &[topic])?;
            for position in frames.iter().take(LOOKED_AT) {
                has_truth |= reader.read(*position)?.first().is_some_and(Option::is_some);
            }
        }
        let why = match has_truth {
            true => "no frame has values of both the estimate and the ground truth".to_owned(),
            false => format!(
                "no frame has the ground truth `{truth}`: set its location in the parameters of the source, choose frames that have it, or remove `score:`"
            ),
        };
        Ok(Self { note: Some(format!("not one pixel was scored: {why}")), everything: true })
    }
}

/// The reason why frames (estimate, position, id) have no scored pixel, as far as the recording shows it.
fn cause(
    recording: &Recording,
    estimates: &[Estimate],
    frames: &[(usize, FrameIndex, &str)],
    everything: bool,
) -> Result<String, AnalysisError> {
    let first = &estimates[frames[0].0];
    let Some(settings) = &first.settings else {
        return Ok(
            "no pixel has a ground-truth disparity (and a valid estimate, if only valid pixels are scored)".to_owned()
        );
    };
    let bounds = format!("{}..{} m", settings.min_m, settings.max_m);
    let Some(topic) = &first.truth_topic else {
        return Ok(format!("only ground truth within {bounds} is scored (the ground truth was not recorded)"));
    };
    let truth = first.truth_output.as_deref().unwrap_or(topic).trim_start_matches('/');
    let mut reader = recording.reader(first.run, &[topic])?;
    let (mut nearest, mut farthest) = (f32::INFINITY, f32::NEG_INFINITY);
    let (mut within, mut scorable) = (false, false);
    for (_, position, _) in frames.iter().filter(|(estimate, ..)| estimates[*estimate].run == first.run).take(LOOKED_AT)
    {
        let values = reader.read(*position)?;
        let Some(depth) = values.first().and_then(Option::as_ref).and_then(Value::metres) else { continue };
        for &metres in depth.iter().filter(|metres| metres.is_finite()) {
            (nearest, farthest) = (nearest.min(metres), farthest.max(metres));
            within |= f64::from(metres) > settings.min_m && f64::from(metres) < settings.max_m;
        }
        let (width, height) = depth.dimensions();
        scorable |= !ScoredPixels::new(depth, width as usize, height as usize, settings).is_empty();
    }
    Ok(if nearest > farthest {
        format!("the ground truth `{truth}` has no distance there")
    } else if !within {
        let unit = if everything { "; is the baseline in metres?" } else { "" };
        let (nearest, farthest) = (short(nearest), short(farthest));
        format!(
            "the ground truth `{truth}` is between {nearest} and {farthest} m, outside of min_m..max_m of the score ({bounds}){unit}"
        )
    } else if scorable {
        "no estimate is valid on a pixel with ground truth".to_owned()
    } else {
        "the crop of the score excludes all pixels with ground truth".to_owned()
    })
}

/// A distance with about three digits.
fn short(metres: f32) -> String {
    match metres.abs() {
        size if size >= 100.0 => format!("{metres:.0}"),
        size if size >= 1.0 => format!("{metres:.1}"),
        _ => format!("{metres:.2e}"),
    }
}
