//! The samples of a run: one row per scored pixel, written where a command needs them.

use std::path::{Path, PathBuf};

use depthloom_analysis::{FrameChoice, SAMPLES, SamplesWritten, samples_match, write_samples};
use depthloom_recording::{Condition, Recording};
use depthloom_runner::Interrupt;
use depthloom_runs::{failed, open_frames, run_folder};
use depthloom_terminal::{CliError, ExitCode, say};

use crate::args::RunsFolder;
use crate::output::progress::bar;

pub(crate) fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Writes a recording's samples to a file, with progress; of all frames, or of the selected ones.
pub(crate) fn write(
    recording: &Recording,
    out: &Path,
    frames: Option<&FrameChoice>,
    is_silent: bool,
    interrupt: &Interrupt,
) -> Result<SamplesWritten, CliError> {
    if *recording.condition() != Condition::Complete {
        say(format_args!("warning: {} is {}", recording.path().display(), recording.condition()));
    }
    let bar = bar(is_silent, 1, "samples: {bar:30} {pos}/{len} frames  {eta} left");
    let progress = |done: usize, all: usize| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    };
    let written = write_samples(recording, out, frames, &progress, &|| interrupt.stops_admission());
    bar.finish_and_clear();
    written.map_err(failed)
}

/// Whether this is a file of samples, not a run.
pub(crate) fn is_samples(run: &Path) -> bool {
    run.is_file() && run.extension().is_some_and(|ending| ending == "parquet")
}

/// The file of samples of a run, written if it is missing or older than the recording; or such a file itself.
pub(crate) fn samples_of(
    run: &Path,
    folder: &RunsFolder,
    is_silent: bool,
    interrupt: &Interrupt,
) -> Result<PathBuf, CliError> {
    if is_samples(run) {
        return Ok(run.to_owned());
    }
    let path = folder.recording(run, "analyse")?;
    let file = path.with_file_name(SAMPLES);
    let recording = open_frames(&path)?;
    if file.is_file() && samples_match(&file, &recording).map_err(failed)? {
        return Ok(file);
    }
    let elsewhere = || {
        format!(
            "write the samples to another folder with `depthloom analyse {} --samples-only --out FILE.parquet` and read them with `depthloom analyse FILE.parquet`; \
             for a figure copy the run to a folder that can be written",
            run.display()
        )
    };
    let _lock = run_folder::lock_if_run(folder_of(&file)).map_err(|stop| stop.remedy(elsewhere()))?;
    let written = write(&recording, &file, None, is_silent, interrupt)
        .map_err(|stop| if stop.exit == ExitCode::Engine { stop.remedy(elsewhere()) } else { stop })?;
    written.notes.iter().for_each(|note| say(format_args!("note: {note}")));
    Ok(file)
}
