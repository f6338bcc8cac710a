//! What can be said of a run at a glance: what its recording's summary tells, how much room it takes, and its best
//! score.

use depthloom_graphs::plan::RunId;
use std::fs;
use std::path::Path;

use depthloom_analysis::BestValue;
use depthloom_graphs::{Remedied, chain, counted};
use depthloom_recording::{Condition, Recording};
use schemars::JsonSchema;
use serde::Serialize;

use super::reused;
use crate::files::RECORDING;
use crate::found::FoundRun;
use crate::run_folder::is_held;

/// How far a run came.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// A process writes it.
    Running,
    /// Over, and whole.
    Whole,
    /// It ended before its end.
    Unfinished,
    /// Bytes of its recording are not what was written, as far as its summary tells.
    Damaged,
    /// Its recording cannot be read.
    Unreadable,
}

impl State {
    /// Its name, for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Whole => "whole",
            Self::Unfinished => "unfinished",
            Self::Damaged => "damaged",
            Self::Unreadable => "unreadable",
        }
    }
}

/// A run at a glance.
#[derive(JsonSchema, Serialize)]
pub struct Glance {
    /// Its path in the folder of runs.
    pub name: String,
    /// Its folder.
    pub path: String,
    /// When it was finished; of one that was not, when it last wrote.
    pub time_utc: String,
    /// How far it came.
    pub state: State,
    /// Its experiment; null where its recording was not read.
    pub experiment: Option<String>,
    /// How many.
    pub variants: u64,
    /// How many frames it recorded, of all stages.
    pub frames: u64,
    /// How many of them failed somewhere.
    pub failed_frames: u64,
    /// The size of all its files.
    pub bytes: u64,
    /// Its best score, if there is one.
    pub best: Option<Best>,
    /// What is wrong with it.
    pub trouble: Option<String>,
    /// Why its values may be wrong although it is complete.
    pub warning: Option<String>,
}

impl Glance {
    /// Looks at a run; what another process writes at this moment is not read.
    pub fn at(run: &FoundRun) -> Self {
        let state = if is_held(&run.path) && !run.is_over() { State::Running } else { State::Unfinished };
        let glance = Self {
            name: run.name.clone(),
            path: run.path.to_string_lossy().into_owned(),
            time_utc: run.time_utc(),
            state,
            experiment: None,
            variants: 0,
            frames: 0,
            failed_frames: 0,
            bytes: bytes_in(&run.path),
            best: None,
            trouble: None,
            warning: None,
        };
        if state == State::Running {
            return glance;
        }
        let path = run.path.join(RECORDING);
        match Recording::open(&path) {
            Ok(recording) => {
                Self { warning: reused::warning(&recording, &run.path), ..glance.with(&recording, run.is_over()) }
            }
            // Of a run that ended before its first frame.
            Err(_) if !run.is_over() && !path.exists() => glance,
            Err(error) => {
                let trouble = match error.remedy() {
                    Some(remedy) => format!("{}; {remedy}", chain(&error)),
                    None => chain(&error),
                };
                Self { state: State::Unreadable, trouble: Some(trouble), ..glance }
            }
        }
    }

    fn with(self, recording: &Recording, is_over: bool) -> Self {
        let plan = recording.plan();
        let (state, trouble) = match recording.condition() {
            Condition::Whole if is_over => (State::Whole, None),
            Condition::Whole => (State::Unfinished, None),
            condition @ (Condition::Unfinished { .. } | Condition::Recovered) => {
                (State::Unfinished, is_over.then(|| condition.to_string()))
            }
            condition @ Condition::Damaged { .. } => (State::Damaged, Some(condition.to_string())),
        };
        let frames = || RunId::all(plan.runs.len()).flat_map(|run| recording.frames(run));
        Self {
            state,
            experiment: Some(plan.experiment.clone()),
            variants: plan.variants.len() as u64,
            frames: frames().count() as u64,
            failed_frames: frames().filter(|frame| !frame.failures.is_empty()).count() as u64,
            // A run that scored nothing has no best score.
            best: depthloom_analysis::best_value(recording, &|| false).ok().flatten().map(Best::from),
            trouble,
            ..self
        }
    }

    /// How far it came, in words.
    pub fn state_text(&self) -> String {
        match self.failed_frames {
            0 => self.state.name().to_owned(),
            failed => format!("{}, {} failed", self.state.name(), counted(failed, "frame")),
        }
    }
}

/// The best score of a run.
#[derive(JsonSchema, Serialize)]
pub struct Best {
    /// Which score.
    pub score: &'static str,
    /// Its value.
    pub value: f64,
    /// The stage of the estimate.
    pub stage: String,
    /// Null where all variants share the estimate; of several, the first.
    pub variant: Option<String>,
    /// The estimate, as tables name it.
    pub estimate: String,
    #[serde(skip)]
    label: String,
}

impl From<BestValue> for Best {
    fn from(leader: BestValue) -> Self {
        let BestValue { metric, value, lead, estimate, label } = leader;
        Self { score: metric, value, stage: lead.stage, variant: lead.variant, estimate, label }
    }
}

impl Best {
    /// The score on a line.
    pub fn text(&self) -> String {
        format!("{} {:.4}  {}", self.score, self.value, self.label)
    }
}

/// A file.
#[derive(PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize)]
pub struct File {
    /// With the folders in which it lies.
    pub name: String,
    /// How large it is, bytes.
    pub bytes: u64,
}

/// The files in a folder and in its folders, by name.
pub fn files_in(folder: &Path) -> Vec<File> {
    files_below(folder, "")
}

fn files_below(folder: &Path, prefix: &str) -> Vec<File> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        match entry.metadata() {
            Ok(metadata) if metadata.is_dir() => files.extend(files_below(&entry.path(), &format!("{name}/"))),
            Ok(metadata) => files.push(File { name, bytes: metadata.len() }),
            Err(_) => {}
        }
    }
    files.sort();
    files
}

/// What the files in a folder and in its folders hold; what a link leads to does not lie there.
pub fn bytes_in(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let bytes = |entry: fs::DirEntry| match entry.metadata() {
        Ok(metadata) if metadata.is_dir() => bytes_in(&entry.path()),
        Ok(metadata) if metadata.is_file() => metadata.len(),
        _ => 0,
    };
    entries.map(bytes).sum()
}
