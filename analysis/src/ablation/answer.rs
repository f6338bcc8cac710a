//! Questions about a run's scores, each answered with a table.

use std::collections::HashSet;

use depthloom_graphs::Key;
use depthloom_graphs::contracts::FrameSelection;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::{RecordedFrame, Recording};

use super::shared::shared_scores;
use super::{Ablation, Costs, Ranking, ScoreTable, Selection, effects, zones};
use crate::error::{AnalysisError, caught};
use crate::estimates::{Estimate, estimates};
use crate::input::condition;
use crate::input::reading;
use crate::scores::{FrameScore, incomplete_frames};
use crate::statistics::Resampling;
use crate::tables::Table;

/// What a table of a run's scores shows.
#[derive(Clone, Debug, PartialEq)]
pub enum Question {
    /// A row per estimate, its variant's axes and its scores in columns.
    Ranking(Ranking),
    /// What each axis did to this score, `ms` or count of pixels.
    Effects(String),
    /// Which row is best by this score, in each zone.
    BestPerZone(String),
    /// A line per score, estimates in columns, as in Table I; with intervals if frames are resampled.
    Scores(Option<Resampling>),
}

/// Answers a question from a recording's scores alone: no map is read. `costs` are those of its run, where they are
/// known.
///
/// # Errors
/// If the recording cannot be read or is damaged where scores are; [`AnalysisError::Request`] if the question names
/// what is not there; [`AnalysisError::Stopped`] once `stop` says so.
pub fn answer(
    recording: &Recording,
    costs: Option<&Costs>,
    selection: &Selection,
    question: &Question,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Table, AnalysisError> {
    caught(|| {
        let (estimates, scores) = selected_scores(recording, selection, stop)?;
        let source = source_of(recording);
        let ablation = Ablation::new(recording.plan(), &estimates, &scores, &source, costs);
        let mut table = match question {
            Question::Ranking(ranking) => ranking.table(&ablation, selection, stop)?,
            Question::Effects(metric) => effects::table(&ablation, selection, metric)?,
            Question::BestPerZone(metric) => zones::table(&ablation, selection, metric)?,
            Question::Scores(intervals) => {
                let scored: HashSet<usize> = ablation.rows(selection)?.iter().map(|row| row.estimate).collect();
                let mut rows = ablation.rows_on_all_sets(selection)?;
                rows.retain(|row| scored.contains(&row.estimate));
                return Ok(ScoreTable::new(&ablation, &rows, selection, false, *intervals, stop)?.table());
            }
        };
        table.notes.extend(incomplete_frames(recording, &estimates, &scores));
        table.notes.extend(condition::findings(recording, &[], true).notes);
        Ok(table)
    })
}

/// The key of a frame's source values, by stage run and position.
pub(crate) fn source_of(recording: &Recording) -> impl Fn(RunId, FrameIndex) -> Option<Key> {
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
    let scores = of_frames(recording, &estimates, scores, selection)?;
    Ok((estimates, scores))
}

/// The scores that a recording holds.
pub(crate) fn scored(
    recording: &Recording,
    estimates: &[Estimate],
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<FrameScore>, AnalysisError> {
    let nothing = |what: &str, help: &str| Err(AnalysisError::asked(what.to_owned(), help.to_owned()));
    if estimates.is_empty() {
        return nothing("nothing was scored: no stage has a `score:`", "give a stage one, and run again");
    }
    let scores = reading::scores(recording, estimates, stop)?;
    if scores.is_empty() {
        return nothing("no frame was scored", "`depthloom report` says which stages have no frames");
    }
    Ok(scores)
}

/// The scores of the selected frames.
///
/// # Errors
/// If no frame is selected, or one that is asked for is not there.
pub(crate) fn of_frames(
    recording: &Recording,
    estimates: &[Estimate],
    scores: Vec<FrameScore>,
    selection: &Selection,
) -> Result<Vec<FrameScore>, AnalysisError> {
    let Some(wanted) = &selection.frames else { return Ok(scores) };
    let wanted = match wanted {
        // A frame that failed in its source is not in the recording.
        FrameSelection::Range(range) => FrameSelection::Available(range.clone()),
        other => other.clone(),
    };
    let frames = || RunId::all(recording.plan().runs.len()).flat_map(|run| recording.frames(run));
    let mut ids: Vec<(u64, &str)> = frames().map(|frame| (frame.index, &*frame.id)).collect();
    ids.sort_unstable();
    let is_file = matches!(wanted, FrameSelection::File(_));
    if is_file {
        ids.dedup();
    } else {
        ids.dedup_by_key(|(index, _)| *index);
    }
    let selected = wanted.select(&ids).map_err(|fault| {
        let help = fault.remedy_text().unwrap_or("`depthloom inspect RUN` lists the frames").to_owned();
        AnalysisError::asked(format!("failed to select frames: {}", fault.chain()), help)
    })?;
    let indices: HashSet<u64> = selected.iter().map(|at| ids[*at].0).collect();
    let names: HashSet<&str> = selected.iter().map(|at| ids[*at].1).collect();
    let runs: Vec<&[RecordedFrame]> =
        RunId::all(recording.plan().runs.len()).map(|run| recording.frames(run)).collect();
    let is_wanted = |score: &FrameScore| {
        runs[estimates[score.estimate].run].get(score.position.0).is_some_and(|frame| match is_file {
            true => names.contains(&*frame.id),
            false => indices.contains(&frame.index),
        })
    };
    let scores: Vec<FrameScore> = scores.into_iter().filter(is_wanted).collect();
    if scores.is_empty() {
        let help = "choose others with --frames".to_owned();
        return Err(AnalysisError::asked("no selected frame was scored".to_owned(), help));
    }
    Ok(scores)
}
