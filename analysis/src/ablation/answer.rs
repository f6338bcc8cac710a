//! Queries of the scores of a run. Each gives a table.

use std::collections::HashSet;

use depthloom_graphs::Key;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::Recording;

use super::shared::shared_scores;
use super::{Ablation, Costs, FrameGroups, Ranking, ScoreTable, Selection, effects, zones};
use crate::error::{AnalysisError, caught};
use crate::estimates::{Estimate, estimates};
use crate::input::condition::recording_notes;
use crate::input::reading;
use crate::scores::{FrameScore, incomplete_frames};
use crate::statistics::Resampling;
use crate::tables::Table;
use crate::titles::Titles;

/// Selects the kind of table.
#[derive(Clone, Debug, PartialEq)]
pub enum Question {
    /// One row per estimate, with the axes of its variant and its metrics in columns.
    Ranking(Ranking),
    /// The effect of each axis on this metric, on `ms`, or on a count of pixels.
    Effects(String),
    /// The best row by this metric in each zone.
    BestPerZone(String),
    /// One line per metric, estimates in columns, as in Table I; with intervals if frames are resampled.
    Scores(Option<Resampling>),
}

/// Computes a table from the scores of a recording, without reading maps. `costs` are the costs of its run, if known.
///
/// # Errors
/// If the recording cannot be read or its scores are damaged; [`AnalysisError::Request`] if the question names an
/// unknown metric, estimate, zone or pixel set; [`AnalysisError::Stopped`] once `stop` returns true.
pub fn answer(
    recording: &Recording,
    costs: Option<&Costs>,
    selection: &Selection,
    question: &Question,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Table, AnalysisError> {
    caught(|| {
        let (estimates, scores) = selected_scores(recording, selection, stop)?;
        let source = source_keys(recording);
        let groups = selection.grouping.as_ref();
        let groups = groups.map(|grouping| FrameGroups::new(recording, &estimates, &scores, grouping)).transpose()?;
        let ablation = Ablation::new(recording.plan(), &estimates, &scores, &source, costs).with_groups(groups);
        let mut table = match question {
            Question::Ranking(ranking) => ranking.table(&ablation, selection, stop)?,
            Question::Effects(metric) => effects::table(&ablation, selection, metric)?,
            Question::BestPerZone(metric) => zones::table(&ablation, selection, metric)?,
            Question::Scores(intervals) => {
                let scored: HashSet<usize> = ablation.rows(selection)?.iter().map(|row| row.estimate).collect();
                let mut rows = ablation.rows_on_all_sets(selection)?;
                rows.retain(|row| scored.contains(&row.estimate));
                ScoreTable::new(&ablation, &rows, selection, false, *intervals, stop)?.table()
            }
        };
        Titles::new([recording.plan()]).apply(&mut table);
        table.notes.extend(ablation.few_groups());
        let frames = selected_frames(recording, selection)?;
        table.notes.extend(incomplete_frames(recording, &estimates, &scores, frames.as_ref()));
        table.notes.extend(recording_notes(recording));
        Ok(table)
    })
}

/// Looks up the key of a frame's source values by stage run and position.
pub(crate) fn source_keys(recording: &Recording) -> impl Fn(RunId, FrameIndex) -> Option<Key> {
    |run, position| recording.frames(run).get(position.0).and_then(|frame| frame.source_key)
}

/// The estimates of a recording and their scores on the selected pixels and frames.
pub(crate) fn selected_scores(
    recording: &Recording,
    selection: &Selection,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Vec<Estimate>, Vec<FrameScore>), AnalysisError> {
    let all = estimates(recording.plan())?;
    let (estimates, scores) = match selection.common {
        true => shared_scores(recording, &all, selection, stop)?,
        false => {
            let scores = scored(recording, &all, stop)?;
            (all, scores)
        }
    };
    let scores = select_frames(recording, &estimates, scores, selection)?;
    Ok((estimates, scores))
}

/// The recorded scores.
pub(crate) fn scored(
    recording: &Recording,
    estimates: &[Estimate],
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<FrameScore>, AnalysisError> {
    let no_scores = |what: &str, help: &str| Err(AnalysisError::request(what.to_owned(), help.to_owned()));
    if estimates.is_empty() {
        return no_scores("nothing was scored: no stage has a `score:`", "add a `score:` to a stage, and run again");
    }
    let scores = reading::scores(recording, estimates, stop)?;
    if scores.is_empty() {
        return no_scores("no frame was scored", "`depthloom report` lists the stages without frames");
    }
    Ok(scores)
}

/// Frames of a recording: stage run and position.
pub(crate) type FrameSet = HashSet<(RunId, FrameIndex)>;

/// The selected frames; `None`: all.
///
/// # Errors
/// If no frame is selected, or a selected frame does not exist.
pub(crate) fn selected_frames(recording: &Recording, selection: &Selection) -> Result<Option<FrameSet>, AnalysisError> {
    let Some(choice) = &selection.frames else { return Ok(None) };
    let (mut places, mut frames) = (Vec::new(), Vec::new());
    for run in RunId::all(recording.plan().runs.len()) {
        for (position, frame) in FrameIndex::enumerate(recording.frames(run)) {
            places.push((run, position));
            frames.push(frame);
        }
    }
    let positions = choice.of_recorded().positions(&frames)?;
    Ok(Some(positions.into_iter().map(|at| places[at]).collect()))
}

/// The scores of the selected frames.
///
/// # Errors
/// As [`selected_frames`]; also if no selected frame was scored.
pub(crate) fn select_frames(
    recording: &Recording,
    estimates: &[Estimate],
    mut scores: Vec<FrameScore>,
    selection: &Selection,
) -> Result<Vec<FrameScore>, AnalysisError> {
    let Some(frames) = selected_frames(recording, selection)? else { return Ok(scores) };
    scores.retain(|score| frames.contains(&(estimates[score.estimate].run, score.position)));
    if scores.is_empty() {
        let help = "choose other frames with `--frames`".to_owned();
        return Err(AnalysisError::request("no selected frame was scored".to_owned(), help));
    }
    Ok(scores)
}
