//! What is asked of a run's scores, and the answer in any format.

use std::collections::HashSet;

use depthloom_graphs::Key;
use depthloom_graphs::contracts::FrameSelection;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::{RecordedFrame, Recording};
use depthloom_scores::{Mean, ScoreRow};
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::shared_scores;
use super::{Ablation, Costs, Ranking, Selection, effects, zones};
use crate::condition;
use crate::error::{AnalysisError, caught};
use crate::estimators::{Estimator, estimators};
use crate::grid::{Grid, Typesetting};
use crate::reading;
use crate::scores::FrameScore;
use crate::sheet::{Sheet, SheetRow};
use crate::statistics::Resampling;
use crate::table::{Table, common, incomplete_frames};

/// What is asked of a run's scores.
#[derive(Clone, Debug, PartialEq)]
pub enum Question {
    /// A row an estimator, its variant's axes and its scores in columns.
    Ranking(Ranking),
    /// What each axis did to this score, `ms` or count of pixels.
    Effects(String),
    /// Which row is best by this score, in each zone.
    BestPerZone(String),
    /// A score a row, estimators in columns, as in Table I; with intervals, if it is said how frames are resampled.
    Scores(Option<Resampling>),
}

/// The answer to a [`Question`].
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// In any other form.
    Grid(Grid),
    /// As Table I.
    Scores(Table),
}

/// Of `table` and `analyse`: what was asked.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct TableOutput {
    /// What the numbers are.
    about: String,
    /// The columns of its CSV form, which docs/tables.md explains.
    rows: Vec<SheetRow>,
    notes: Vec<String>,
}

/// Answers a question from a recording's scores alone: no map is read. `costs` are those of its run, where they are known.
///
/// # Errors
/// If the recording cannot be read or is damaged where scores are; [`AnalysisError::Request`] if the question names what is not there;
/// [`AnalysisError::Stopped`] once `stop` says so.
pub fn answer(
    recording: &Recording,
    costs: Option<&Costs>,
    selection: &Selection,
    question: &Question,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Answer, AnalysisError> {
    caught(|| {
        let estimators = estimators(recording.plan())?;
        let (estimators, scores) = if selection.common {
            shared_scores(recording, &estimators, selection, stop)?
        } else {
            let scores = scored(recording, &estimators, stop)?;
            (estimators, scores)
        };
        let scores = of_frames(recording, &estimators, scores, selection)?;
        let source = source_of(recording);
        let ablation = Ablation::new(recording.plan(), &estimators, &scores, &source, costs);
        let mut grid = match question {
            Question::Ranking(ranking) => ranking.grid(&ablation, selection, stop)?,
            Question::Effects(metric) => effects::grid(&ablation, selection, metric)?,
            Question::BestPerZone(metric) => zones::grid(&ablation, selection, metric)?,
            Question::Scores(intervals) => {
                let (table, scores, estimators) = as_table(recording, &estimators, &scores, selection, &ablation)?;
                let table = match intervals {
                    Some(resampling) => table.with_intervals(&scores, &estimators, *resampling, stop)?,
                    None => table,
                };
                return Ok(Answer::Scores(table));
            }
        };
        grid.notes.extend(incomplete_frames(recording, &estimators, &scores));
        grid.notes.extend(condition::told(recording, &[], true).notes);
        Ok(Answer::Grid(grid))
    })
}

impl Answer {
    /// Takes a caption, label and decimals that were asked for.
    pub fn typeset(&mut self, typesetting: &Typesetting) {
        match self {
            Self::Grid(grid) => grid.typeset(typesetting),
            Self::Scores(table) => table.typeset(typesetting),
        }
    }

    /// As aligned text, the best marked by `*`; where it is wider than `width` columns of text, in blocks below each other.
    #[must_use]
    pub fn terminal(&self, width: usize) -> String {
        match self {
            Self::Grid(grid) => grid.terminal(width),
            Self::Scores(table) => table.terminal(width),
        }
    }

    /// In Markdown (GitHub's), the best in bold.
    #[must_use]
    pub fn markdown(&self) -> String {
        match self {
            Self::Grid(grid) => grid.markdown(),
            Self::Scores(table) => table.markdown(),
        }
    }

    /// In LaTeX, for the package `booktabs`, in the type's own size, with caption and label; the best in bold.
    #[must_use]
    pub fn latex(&self) -> String {
        match self {
            Self::Grid(grid) => grid.latex(),
            Self::Scores(table) => table.latex(),
        }
    }

    /// As CSV: all digits, an empty field where there is no value.
    #[must_use]
    pub fn csv(&self) -> Vec<u8> {
        self.sheet().csv()
    }

    /// The bytes of a Parquet file with the columns of [`Answer::csv`], of a run whose plan has this key.
    ///
    /// # Errors
    /// If polars makes none of them.
    pub fn parquet(&self, run: &Key) -> Result<Vec<u8>, AnalysisError> {
        caught(|| self.sheet().parquet("asked", run).map_err(AnalysisError::compute("the table")))
    }

    /// For programs, with the columns of [`Answer::csv`].
    #[must_use]
    pub fn output(&self) -> TableOutput {
        let (about, notes) = match self {
            Self::Grid(grid) => (grid.about.clone(), grid.notes.clone()),
            Self::Scores(table) => (table.about(), Vec::new()),
        };
        TableOutput { about, rows: self.sheet().rows(), notes }
    }

    fn sheet(&self) -> Sheet<'_> {
        match self {
            Self::Grid(grid) => grid.sheet(),
            Self::Scores(table) => table.long_form(),
        }
    }
}

/// The key of a frame's source values, by stage run and position.
pub(crate) fn source_of(recording: &Recording) -> impl Fn(RunId, FrameIndex) -> Option<Key> {
    |run, position| recording.frames(run).get(position.0).and_then(|frame| frame.source_key)
}

/// The scores that a recording holds.
pub(crate) fn scored(
    recording: &Recording,
    estimators: &[Estimator],
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<FrameScore>, AnalysisError> {
    let nothing = |what: &str, help: &str| Err(AnalysisError::asked(what.to_owned(), help.to_owned()));
    if estimators.is_empty() {
        return nothing("nothing was scored: no stage has a `score:`", "give a stage one, and run again");
    }
    let scores = reading::scores(recording, estimators, stop)?;
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
    estimators: &[Estimator],
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
        let help = fault.remedy_text().unwrap_or("`depthloom info RUN` lists the frames").to_owned();
        AnalysisError::asked(format!("failed to select frames: {}", fault.chain()), help)
    })?;
    let indices: HashSet<u64> = selected.iter().map(|at| ids[*at].0).collect();
    let names: HashSet<&str> = selected.iter().map(|at| ids[*at].1).collect();
    let runs: Vec<&[RecordedFrame]> =
        RunId::all(recording.plan().runs.len()).map(|run| recording.frames(run)).collect();
    let is_wanted = |score: &FrameScore| {
        runs[estimators[score.estimator].run].get(score.position.0).is_some_and(|frame| match is_file {
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

/// As Table I: of the selected estimators, in one zone.
fn as_table(
    recording: &Recording,
    estimators: &[Estimator],
    scores: &[FrameScore],
    selection: &Selection,
    ablation: &Ablation<'_>,
) -> Result<(Table, Vec<FrameScore>, Vec<Estimator>), AnalysisError> {
    if selection.mean == Some(Mean::Pixels) {
        return Err(AnalysisError::asked(
            "the table with scores in rows has means over frames".to_owned(),
            "take `--rows variant` for those over pixels".to_owned(),
        ));
    }
    let zone = ablation.zone(selection)?;
    let rows = ablation.rows(selection)?;
    let mut place = vec![None; estimators.len()];
    let mut selected: Vec<Estimator> = Vec::new();
    for row in rows {
        let estimator = &estimators[row.estimator];
        let sets = estimator.sets.iter().copied().filter(|set| selection.set.is_none_or(|wanted| wanted == *set));
        place[row.estimator] = Some(selected.len());
        selected.push(Estimator { sets: sets.collect(), ..estimator.clone() });
    }
    let of = |score: &&FrameScore| {
        let estimator = place[score.estimator]?;
        let is_wanted = score.row.zone == zone && selected[estimator].sets.contains(&score.row.set);
        // In the table a zone takes the place of the whole image.
        is_wanted.then(|| FrameScore {
            estimator,
            row: ScoreRow { zone: String::new(), ..score.row.clone() },
            ..(*score).clone()
        })
    };
    let kept: Vec<FrameScore> = common(scores, estimators).iter().filter_map(of).collect();
    let mut table = Table::new(&recording.plan().experiment, &kept, &selected, false, &source_of(recording));
    zone.clone_into(&mut table.zone);
    table.label = [vec![format!("{}-scores", recording.plan().experiment)], selection.label()].concat().join("-");
    Ok((table, kept, selected))
}
