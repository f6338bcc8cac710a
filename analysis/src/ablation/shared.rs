//! Scores on the pixels that are valid in all compared estimates, taken again from recorded maps.

use depthloom_graphs::Value;
use depthloom_graphs::plan::FrameIndex;
use depthloom_recording::Recording;
use depthloom_scores::{PixelSet, ScoreRow, ScoredPixels, Settings, score_pixels};

use super::Selection;
use crate::error::AnalysisError;
use crate::estimates::{Estimate, each_names_one, is_of};
use crate::input::maps::not_recorded;
use crate::scores::FrameScore;

/// Maps of one frame that are held at once.
const AT_ONCE: usize = 16;

/// The selected estimates of depth, and their scores on the frames whose maps were recorded: those that were taken of
/// them, of the pixels with ground truth that are valid in all estimates with the same ground truth and settings. What
/// aligns an estimate is fitted on these pixels.
///
/// Of a row, `truth` counts all pixels with ground truth and `valid` those valid in all.
pub(crate) fn shared_scores(
    recording: &Recording,
    estimates: &[Estimate],
    selection: &Selection,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Vec<Estimate>, Vec<FrameScore>), AnalysisError> {
    if selection.zone.is_some() {
        return Err(AnalysisError::asked(
            "scores on the pixels that are valid in all are of the whole image alone".to_owned(),
            "leave out --zone, or take another --set".to_owned(),
        ));
    }
    let wanted = |of: &&Estimate| selection.estimates.as_deref().is_none_or(|pattern| is_of(of, pattern));
    let named: Vec<&Estimate> = estimates.iter().filter(wanted).collect();
    if let Some(patterns) = &selection.estimates {
        each_names_one(patterns, estimates)?;
    }
    let of_depth = named.into_iter().filter(|of| of.settings.is_some());
    let selected: Vec<Estimate> = of_depth.map(|of| Estimate { sets: vec![PixelSet::All], ..of.clone() }).collect();
    if selected.is_empty() {
        return Err(AnalysisError::asked(
            "pixels that are valid in all are known of depths alone".to_owned(),
            "take another --set".to_owned(),
        ));
    }
    let all: Vec<&Estimate> = selected.iter().collect();
    if let Some(missing) = not_recorded(recording.plan(), &all, "no scores on the pixels that are valid in all") {
        return Err(AnalysisError::asked(missing, "and run it again".to_owned()));
    }
    let mut scores = Vec::new();
    let mut left: Vec<usize> = (0..selected.len()).collect();
    while let Some(&first) = left.first() {
        let of = |index: usize| (selected[index].run, &selected[index].truth_topic, selected[index].settings);
        let compared: Vec<usize> = left.extract_if(.., |index| of(*index) == of(first)).collect();
        score_together(recording, &selected, &compared, stop, &mut scores)?;
    }
    if scores.is_empty() {
        return Err(AnalysisError::asked(
            "no frame has the maps of all selected estimates".to_owned(),
            "`record: { every: 1 }` keeps those of every frame".to_owned(),
        ));
    }
    Ok((selected, scores))
}

/// Scores estimates of one truth and one way to be scored.
fn score_together(
    recording: &Recording,
    estimates: &[Estimate],
    compared: &[usize],
    stop: &(dyn Fn() -> bool + Sync),
    scores: &mut Vec<FrameScore>,
) -> Result<(), AnalysisError> {
    let Estimate { run, settings, .. } = &estimates[compared[0]];
    let settings = settings.unwrap_or_default();
    let mut truth_reader = recording.reader(*run, estimates[compared[0]].truth_topic.as_slice())?;
    let mut readers = Vec::new();
    for some in compared.chunks(AT_ONCE) {
        let topics: Vec<&str> = some.iter().filter_map(|&index| estimates[index].estimate_topic.as_deref()).collect();
        readers.push((some, recording.reader(*run, &topics)?));
    }
    for (position, frame) in FrameIndex::enumerate(recording.frames(*run)) {
        if stop() {
            return Err(AnalysisError::Stopped);
        }
        let truth = truth_reader.read(position)?.pop().flatten();
        let Some(truth) = truth.as_ref().and_then(Value::metres) else { continue };
        let (width, height) = truth.dimensions();
        let pixels =
            |metres: &[f32], settings: &Settings| ScoredPixels::new(metres, width as usize, height as usize, settings);
        // The truth where all are valid.
        let mut shared: Vec<f32> = truth.as_raw().clone();
        let mut has_all = true;
        for (_, reader) in &mut readers {
            for value in reader.read(position)? {
                match value.as_ref().and_then(Value::metres) {
                    Some(estimate) if estimate.dimensions() == (width, height) => {
                        let answers = estimate.as_raw().iter();
                        shared.iter_mut().zip(answers).filter(|(_, y)| !y.is_finite()).for_each(|(t, _)| *t = f32::NAN);
                    }
                    _ => has_all = false,
                }
            }
        }
        if !has_all {
            continue;
        }
        let (all, shared) = (pixels(truth.as_raw(), &settings).len() as u64, pixels(&shared, &settings));
        for (some, reader) in &mut readers {
            for (&index, value) in some.iter().zip(reader.read(position)?) {
                let Some(estimate) = value.as_ref().and_then(Value::depth_estimate) else { continue };
                let metrics = &estimates[index].metrics;
                for row in score_pixels(estimate, &shared, &[PixelSet::All], metrics, &settings) {
                    let row = ScoreRow { truth: all, valid: shared.len() as u64, ..row };
                    scores.push(FrameScore { frame: frame.id.clone(), position, estimate: index, row });
                }
            }
        }
    }
    Ok(())
}
