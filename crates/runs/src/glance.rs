//! A summary of a run: what its recording's summary contains, its size on disk, and its best score.

use depthloom_graphs::plan::RunId;
use std::fs;
use std::path::Path;

use depthloom_analysis::BestValue;
use depthloom_graphs::{Remedied, chain, counted};
use depthloom_recording::{Condition, RecordedPlan, Recording};
use schemars::JsonSchema;
use serde::Serialize;

use crate::files::RECORDING;
use crate::found::FoundRun;
use crate::notes::Notes;
use crate::run_folder::is_held;

/// The state of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// A process is writing it.
    Running,
    /// It has finished, and is complete.
    Complete,
    /// It ended early.
    Unfinished,
    /// Bytes of its recording are damaged, according to its summary.
    Damaged,
    /// Its recording cannot be read.
    Unreadable,
}

impl State {
    /// All states.
    pub const ALL: [Self; 5] = [Self::Complete, Self::Unfinished, Self::Running, Self::Damaged, Self::Unreadable];

    /// Its name in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Complete => "complete",
            Self::Unfinished => "unfinished",
            Self::Damaged => "damaged",
            Self::Unreadable => "unreadable",
        }
    }
}

/// A summary of a run.
#[derive(JsonSchema, Serialize)]
pub struct Glance {
    /// Its path in the folder of runs.
    pub name: String,
    /// Its folder.
    pub path: String,
    /// When it finished; for an unfinished run, when it last wrote.
    pub time_utc: String,
    /// Its state.
    pub state: State,
    /// Its experiment; null if its recording was not read.
    pub experiment: Option<String>,
    /// The number of variants.
    pub variants: u64,
    /// The number of recorded frames, of all stages.
    pub frames: u64,
    /// The number of frames with a failure.
    pub failed_frames: u64,
    /// The size of all its files.
    pub bytes: u64,
    /// Its best score, if there is one.
    pub best: Option<Best>,
    /// What is wrong with it.
    pub trouble: Option<String>,
    /// The tags and the note that it was given.
    #[serde(flatten)]
    pub notes: Notes,
}

impl Glance {
    /// Summarises a run; a run that another process is writing is not read.
    pub fn at(run: &FoundRun) -> Self {
        Self::with_plan(run).0
    }

    /// As [`at`](Self::at), with the plan of its recording if that can be read.
    pub fn with_plan(run: &FoundRun) -> (Self, Option<RecordedPlan>) {
        let (notes, notes_trouble) = match Notes::read(&run.path) {
            Ok(notes) => (notes, None),
            Err(error) => (Notes::default(), Some(error.message.what)),
        };
        let state = if is_held(&run.path) && !run.has_finished() { State::Running } else { State::Unfinished };
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
            trouble: notes_trouble,
            notes,
        };
        if state == State::Running {
            return (glance, None);
        }
        let path = run.path.join(RECORDING);
        match Recording::open(&path) {
            Ok(recording) => (glance.with(&recording, run.has_finished()), Some(recording.plan().clone())),
            // For a run that ended before its first frame.
            Err(_) if !run.has_finished() && !path.exists() => (glance, None),
            Err(error) => {
                let trouble = match error.remedy() {
                    Some(remedy) => format!("{}; {remedy}", chain(&error)),
                    None => chain(&error),
                };
                (Self { state: State::Unreadable, trouble: Some(trouble), ..glance }, None)
            }
        }
    }

    fn with(self, recording: &Recording, has_finished: bool) -> Self {
        let plan = recording.plan();
        let (state, trouble) = match recording.condition() {
            Condition::Complete if has_finished => (State::Complete, None),
            Condition::Complete => (State::Unfinished, None),
            condition @ (Condition::Unfinished { .. } | Condition::Recovered) => {
                (State::Unfinished, has_finished.then(|| condition.to_string()))
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
            // A run without scores has no best score.
            best: depthloom_analysis::best_value(recording, &|| false).ok().flatten().map(Best::from),
            trouble: trouble.or_else(|| self.trouble.clone()),
            ..self
        }
    }

    /// Its state, in words.
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
        let BestValue { metric, value, row_key, estimate, label } = leader;
        Self { score: metric, value, stage: row_key.stage, variant: row_key.variant, estimate, label }
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
    /// Its path in the folder.
    pub name: String,
    /// Its size, bytes.
    pub bytes: u64,
}

/// The files in a folder and in its subfolders, by name.
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

/// The size of the files in a folder and in its subfolders; the targets of links are not counted.
pub fn bytes_in(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let bytes = |entry: fs::DirEntry| match entry.metadata() {
        Ok(metadata) if metadata.is_dir() => bytes_in(&entry.path()),
        Ok(metadata) if metadata.is_file() => metadata.len(),
        _ => 0,
    };
    entries.map(bytes).sum()
}
