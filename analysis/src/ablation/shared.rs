//! Scores over the pixels that are valid in all compared estimates, computed again from recorded maps.

use depthloom_graphs::Value;
use depthloom_graphs::plan::FrameIndex;
use depthloom_recording::Recording;
use depthloom_scores::{PixelSet, ScoreRow, ScoredPixels, Settings, score_pixels};

use super::Selection;
use crate::error::AnalysisError;
use crate::estimates::{Estimate, check_patterns, matches_estimate};
use crate::input::maps::not_recorded;
use crate::scores::FrameScore;

/// The maximum number of maps of one frame in memory.
const AT_ONCE: usize = 16;

/// The selected depth estimates, and their scores on the frames whose maps were recorded. The scores have the metrics
/// of each estimate, over the pixels with ground truth that are valid in all estimates with the same ground truth and
/// settings. The alignment of an estimate is fitted on these pixels.
///
/// In a row, `truth` counts all pixels with ground truth and `valid` those that are valid in all estimates.
pub(crate) fn shared_scores(
    recording: &Recording,
    estimates: &[Estimate],
    selection: &Selection,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Vec<Estimate>, Vec<FrameScore>), AnalysisError> {
    if selection.zone.is_some() {
        return Err(AnalysisError::request(
            "`--pixels common` does not support `--zone`: it scores the whole image".to_owned(),
            "omit `--zone`, or choose another `--pixels`".to_owned(),
        ));
    }
    let is_selected = |estimate: &&Estimate| {
        selection.estimates.as_deref().is_none_or(|patterns| matches_estimate(estimate, patterns))
    };
    let named: Vec<&Estimate> = estimates.iter().filter(is_selected).collect();
    if let Some(patterns) = &selection.estimates {
        check_patterns(patterns, estimates)?;
    }
    let depths = named.into_iter().filter(|estimate| estimate.settings.is_some());
    let selected: Vec<Estimate> =
        depths.map(|estimate| Estimate { sets: vec![PixelSet::All], ..estimate.clone() }).collect();
    if selected.is_empty() {
        return Err(AnalysisError::request(
            "`--pixels common` supports only depths, and no depth is selected".to_owned(),
            "choose another `--pixels`".to_owned(),
        ));
    }
    let all: Vec<&Estimate> = selected.iter().collect();
    if let Some(missing) = not_recorded(recording.plan(), &all, "no scores for `--pixels common`") {
        return Err(AnalysisError::request(missing, "then run the experiment again".to_owned()));
    }
    let mut scores = Vec::new();
    let mut pending: Vec<usize> = (0..selected.len()).collect();
    while let Some(&first) = pending.first() {
        let scoring = |index: usize| (selected[index].run, &selected[index].truth_topic, selected[index].settings);
        let compared: Vec<usize> = pending.extract_if(.., |index| scoring(*index) == scoring(first)).collect();
        score_together(recording, &selected, &compared, stop, &mut scores)?;
    }
    if scores.is_empty() {
        return Err(AnalysisError::request(
            "no frame has recorded maps of all selected estimates".to_owned(),
            "record the maps of every frame with `record: { every: 1 }`".to_owned(),
        ));
    }
    Ok((selected, scores))
}

/// Scores estimates with the same ground truth and the same settings.
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
        // The ground truth of the pixels that are valid in all estimates.
        let mut shared: Vec<f32> = truth.as_raw().clone();
        let mut has_all = true;
        for (_, reader) in &mut readers {
            for value in reader.read(position)? {
                match value.as_ref().and_then(Value::metres) {
                    Some(estimate) if estimate.dimensions() == (width, height) => {
                        let metres = estimate.as_raw().iter();
                        shared.iter_mut().zip(metres).filter(|(_, y)| !y.is_finite()).for_each(|(t, _)| *t = f32::NAN);
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
