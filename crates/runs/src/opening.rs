//! Opens the recording of a run, and reports why that fails.

use std::fmt::Display;
use std::io::{ErrorKind, Read as _};
use std::path::{Path, PathBuf};

use depthloom_analysis::AnalysisError;
use depthloom_graphs::plan::RunId;
use depthloom_graphs::regular_file;
use depthloom_recording::{Condition, Recording, RecordingError};
use depthloom_runner::RunError;
use depthloom_terminal::{CliError, ExitCode, say};

use crate::files::RECORDING;
use crate::named::named;

const NAME_A_RUN: &str = "name a run's folder, a recording, or a run that `depthloom runs` lists";

/// The recording of a run that is [named](named()) in a folder of runs, or the recording itself; `command` is for
/// messages.
///
/// # Errors
/// If no recording has this name, or several have.
pub fn recording_in(folder: &Path, run: &Path, command: &str) -> Result<PathBuf, CliError> {
    let run = &named(run, folder)?;
    let failed = |what: String| CliError::new(ExitCode::Usage, format!("failed to open {}: {what}", run.display()));
    let kind = match std::fs::metadata(run) {
        Ok(metadata) => metadata.file_type(),
        Err(error) => {
            let stop = failed(error.to_string());
            return Err(match partial_with(run, RECORDING) {
                Some(partial) => stop.remedy(remedy_of_partial(&partial, command)),
                None => stop.remedy(NAME_A_RUN),
            });
        }
    };
    if kind.is_file() {
        return Ok(run.to_owned());
    }
    if !kind.is_dir() {
        return Err(failed("it is neither a file nor a folder".to_owned()).remedy(NAME_A_RUN));
    }
    let recording = run.join(RECORDING);
    match std::fs::metadata(&recording) {
        Ok(metadata) if metadata.is_file() => return Ok(recording),
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(failed(error.to_string())),
        Ok(_) | Err(_) => {}
    }
    let runs = runs_below(run, 2);
    let stop = failed(format!("it has no {RECORDING}"));
    Err(match runs.as_slice() {
        [] => stop.remedy(NAME_A_RUN),
        [one] => stop.remedy(format!("it contains a run: `depthloom {command} {}`", one.display())),
        [.., newest] => stop.remedy(format!(
            "it contains {} runs, for example `depthloom {command} {}`",
            runs.len(),
            newest.display()
        )),
    })
}

/// The unfinished run with this file: `<run>.partial`, or the same if `run` is a file in a run's folder.
#[must_use]
pub fn partial_with(run: &Path, file: &str) -> Option<PathBuf> {
    let partial_of = |run: &Path| {
        let partial = run.file_name().map(|_| depthloom_durable::partial_name(run))?;
        partial.join(file).is_file().then_some(partial)
    };
    partial_of(run).or_else(|| partial_of(run.parent()?))
}

/// The remedy if only an unfinished run exists; `command` is the command that failed.
#[must_use]
pub fn remedy_of_partial(partial: &Path, command: &str) -> String {
    let partial = partial.display();
    format!(
        "{partial} exists: a run that is running, or was interrupted; `depthloom {command} {partial}` reads its complete frames"
    )
}

/// The runs in a folder and its subfolders, up to a depth; by name, and so by time.
fn runs_below(folder: &Path, depth: u32) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut folders: Vec<_> = entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    let below = |folder: PathBuf| match (folder.join(RECORDING).is_file(), depth) {
        (true, _) => vec![folder],
        (false, 0 | 1) => Vec::new(),
        (false, _) => runs_below(&folder, depth - 1),
    };
    folders.into_iter().flat_map(below).collect()
}

/// Whether a file starts like a recording.
#[must_use]
pub fn is_recording(path: &Path) -> bool {
    let mut start = [0; 8];
    let read = regular_file::open(path).and_then(|mut file| file.read_exact(&mut start));
    read.is_ok() && start == *b"\x89MCAP0\r\n"
}

/// The exit code of a command that read these recordings: [`ExitCode::FrameFailures`] if one of them is damaged, with a
/// warning.
pub fn end<'a>(recordings: impl IntoIterator<Item = &'a Recording>) -> ExitCode {
    let mut exit = ExitCode::Success;
    for recording in recordings {
        if let damaged @ Condition::Damaged { .. } = recording.condition() {
            say(format_args!(
                "warning: {} is {damaged}; the result covers its complete frames only",
                recording.path().display()
            ));
            exit = ExitCode::FrameFailures;
        }
    }
    exit
}

/// Opens a recording.
///
/// # Errors
/// If it cannot be read.
pub fn open(path: &Path) -> Result<Recording, CliError> {
    Recording::open(path).map_err(|error| {
        let exit = if error.is_damage() { ExitCode::FrameFailures } else { ExitCode::Usage };
        CliError::remedied(exit, "failed to read the recording", &error)
    })
}

/// The error of a value that cannot be read: [`ExitCode::FrameFailures`] if the recording is damaged there.
pub fn read_failed(intent: impl Display, error: &RecordingError) -> CliError {
    let exit = if error.is_damage() { ExitCode::FrameFailures } else { ExitCode::Engine };
    CliError::remedied(exit, intent, error)
}

/// Opens a recording whose frames are needed.
///
/// # Errors
/// As [`open`], and if the recording is damaged before the first complete frame of a stage with metrics.
pub fn open_frames(path: &Path) -> Result<Recording, CliError> {
    let recording = open(path)?;
    let runs = &recording.plan().runs;
    let has_metrics = runs.iter().any(|run| !run.estimates.is_empty());
    let needed: Vec<RunId> =
        RunId::enumerate(runs).filter(|(_, run)| !has_metrics || !run.estimates.is_empty()).map(|(id, _)| id).collect();
    let has_frames = |run: &RunId| !recording.frames(*run).is_empty();
    match recording.condition() {
        Condition::Damaged { offset, what, .. } if !needed.iter().any(has_frames) => {
            let (path, mut of_stage) = (path.display(), String::new());
            if let Some(run) = needed.first().filter(|_| RunId::all(runs.len()).any(|run| has_frames(&run))) {
                of_stage = format!(" of stage `{}`", runs[*run].stage);
            }
            let what = format!(
                "failed to read the recording: {path} is damaged at byte {offset}: {what}; no complete frame{of_stage} comes before it"
            );
            Err(CliError::new(ExitCode::FrameFailures, what).remedy("copy the file again, or run the experiment again"))
        }
        _ => Ok(recording),
    }
}

/// Why a request to an analysis failed: the request, the recording or the analysis is at fault.
#[must_use]
pub fn failed(error: AnalysisError) -> CliError {
    let exit = match error {
        AnalysisError::Stopped => return CliError::new(ExitCode::Interrupted, "interrupted while analysing"),
        AnalysisError::Request(message) => return CliError { exit: ExitCode::Usage, message, problems: Vec::new() },
        ref error if error.is_damage() => ExitCode::FrameFailures,
        _ => ExitCode::Engine,
    };
    CliError::remedied(exit, "failed to analyse the recording", &error)
}

/// Why a run ended early.
#[must_use]
pub fn run_failed(error: &RunError) -> CliError {
    let exit = match error {
        RunError::Aborted => ExitCode::Interrupted,
        error if error.is_of_a_frame() => ExitCode::FrameFailures,
        _ => ExitCode::Engine,
    };
    CliError::from_error(exit, error)
}
