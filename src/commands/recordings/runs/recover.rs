//! `depthloom runs recover`: a finished recording from an unfinished one.

use std::path::{Path, PathBuf};

use depthloom_recording::{RecordingError, Recovered};
use depthloom_runs::{RECORDING, open};
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::{RecoverArgs, RunsArgs};
use crate::output;
use depthloom_graphs::{chain, counted};
use depthloom_terminal::{CliError, ExitCode, print_path, say};

/// Output of `runs recover`: the recording that was written.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Recover {
    /// The file that was written.
    recording: String,
    /// The number of complete frames in it.
    frames: u64,
}

/// Copies the complete frames, and closes the copy with a summary.
pub(super) fn recover(args: &RunsArgs, command: &RecoverArgs) -> Result<ExitCode, CliError> {
    let path = args.folder.recording(&command.run, "runs recover")?;
    let out = command.out.clone().unwrap_or_else(|| named_after(&path));
    if out.symlink_metadata().is_ok() {
        return Err(CliError::usage(format!("{} exists already", out.display()), "choose another --out"));
    }
    let recording = open(&path)?;
    let partial = depthloom_durable::partial_name(&out);
    if partial.symlink_metadata().is_ok() {
        let what =
            format!("{} exists already: another `runs recover` was interrupted, or is writing it", partial.display());
        return Err(CliError::usage(what, "remove it, or choose another --out"));
    }
    let recovered = depthloom_recording::recover(&recording, &partial).map_err(|error| {
        let _ = std::fs::remove_file(&partial);
        let exit = match error {
            RecordingError::Missing { .. } => ExitCode::Usage,
            ref error if error.is_damage() => ExitCode::FrameFailures,
            _ => ExitCode::Engine,
        };
        CliError::remedied(exit, "failed to recover the recording", &error)
    })?;
    depthloom_durable::rename(&partial, &out).map_err(|error| {
        CliError::of_writing(ExitCode::Engine, format_args!("failed to write {}", out.display()), &error)
    })?;
    let Recovered { frames, lost, damage } = recovered;
    if let Some(damage) = &damage {
        let lost = if lost > 0 { format!("; {} left out", counted(lost, "frame")) } else { String::new() };
        say(format_args!("warning: {}{lost}", chain(damage)));
    }
    if args.json {
        output::print(&Recover { recording: out.to_string_lossy().into_owned(), frames })?;
    } else {
        say(format_args!("recovered {} of {}; the new recording is:", counted(frames, "frame"), path.display()));
        print_path("", &std::path::absolute(&out).unwrap_or(out))?;
    }
    Ok(if damage.is_some() { ExitCode::FrameFailures } else { ExitCode::Success })
}

/// `<run>.recovered.mcap`, or `<file>.recovered.mcap`, in the current folder.
fn named_after(path: &Path) -> PathBuf {
    let of_run = path.parent().and_then(Path::file_name).filter(|_| path.ends_with(RECORDING));
    let name = of_run.or_else(|| path.file_stem()).unwrap_or_default();
    let name = name.to_string_lossy();
    let name = name.strip_suffix(".partial").unwrap_or(&name);
    PathBuf::from(format!("{name}.recovered.mcap"))
}
