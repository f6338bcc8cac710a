//! Frames without a pixel to score, and why: a mean says nothing of them.

use std::collections::BTreeMap;

use depthloom_graphs::Value;
use depthloom_graphs::plan::FrameIndex;
use depthloom_recording::Recording;
use depthloom_scores::ScoredPixels;

use crate::error::AnalysisError;
use crate::estimates::Estimate;
use crate::scores::FrameScore;

/// How many frames are named, and of how many the truth is looked at.
const NAMED: usize = 5;
const LOOKED_AT: usize = 16;

/// What is to be said of frames that were not scored.
#[derive(Default)]
pub(crate) struct Unscored {
    /// How many there are, which, and why; `None` if there are none.
    pub(crate) note: Option<String>,
    /// Whether there are frames, and on none of them a pixel was scored.
    pub(crate) everything: bool,
}

impl Unscored {
    /// Of all scores of a recording.
    pub(crate) fn of(
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
            format!("{count} {frames} {have} no pixel to score and {are} in no mean: {named}{more}; {why}")
        };
        Ok(Self { note: Some(note), everything })
    }
}

impl Unscored {
    /// Of a recording in which no score was made.
    fn without_a_score(recording: &Recording, estimates: &[Estimate]) -> Result<Self, AnalysisError> {
        let whole = |estimate: &Estimate| {
            let frames = FrameIndex::enumerate(recording.frames(estimate.run));
            frames.filter(|(_, frame)| frame.failures.is_empty()).map(|(position, _)| position).collect::<Vec<_>>()
        };
        let scored = estimates.iter().filter(|of| of.score_topic.is_some());
        let mut with_frames = scored.map(|of| (of, whole(of))).filter(|(_, frames)| !frames.is_empty());
        // Of what failed the frames tell.
        let Some((first, frames)) = with_frames.next() else { return Ok(Self::default()) };
        let truth = first.truth.as_deref().or(first.truth_topic.as_deref()).unwrap_or("truth").trim_start_matches('/');
        let mut has_truth = false;
        if let Some(topic) = &first.truth_topic {
            let mut reader = recording.reader(first.run, &[topic])?;
            for position in frames.iter().take(LOOKED_AT) {
                has_truth |= reader.read(*position)?.first().is_some_and(Option::is_some);
            }
        }
        let why = match has_truth {
            true => "no frame has a value of each that is compared".to_owned(),
            false => format!(
                "no frame has the truth `{truth}`: say in the source's parameters where it lies, choose frames that have it, or leave `score:` out"
            ),
        };
        Ok(Self { note: Some(format!("not one pixel was scored: {why}")), everything: true })
    }
}

/// Why frames (estimate, place in its run, id) have no scored pixel, as far as what was recorded shows.
fn cause(
    recording: &Recording,
    estimates: &[Estimate],
    frames: &[(usize, FrameIndex, &str)],
    everything: bool,
) -> Result<String, AnalysisError> {
    let first = &estimates[frames[0].0];
    let Some(settings) = &first.settings else {
        return Ok("no pixel has both a true disparity and, where only answers are scored, an answer".to_owned());
    };
    let wanted = format!("{}..{} m", settings.min_m, settings.max_m);
    let Some(topic) = &first.truth_topic else {
        return Ok(format!("only truth within {wanted} is scored (it was not recorded)"));
    };
    let truth = first.truth.as_deref().unwrap_or(topic).trim_start_matches('/');
    let mut reader = recording.reader(first.run, &[topic])?;
    let (mut nearest, mut farthest) = (f32::INFINITY, f32::NEG_INFINITY);
    let (mut within, mut scorable) = (false, false);
    for (_, position, _) in frames.iter().filter(|(of, ..)| estimates[*of].run == first.run).take(LOOKED_AT) {
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
        format!("the truth `{truth}` knows no distance there")
    } else if !within {
        let unit = if everything { "; is the baseline in metres?" } else { "" };
        let (nearest, farthest) = (short(nearest), short(farthest));
        format!(
            "the truth `{truth}` lies between {nearest} and {farthest} m, outside of the score's min_m..max_m ({wanted}){unit}"
        )
    } else if scorable {
        "no estimate is valid on a pixel with ground truth".to_owned()
    } else {
        "the score's crop leaves out all pixels with a truth".to_owned()
    })
}

/// A distance with three digits or so.
fn short(metres: f32) -> String {
    match metres.abs() {
        size if size >= 100.0 => format!("{metres:.0}"),
        size if size >= 1.0 => format!("{metres:.1}"),
        _ => format!("{metres:.2e}"),
    }
}
