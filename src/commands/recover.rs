//! `depthloom recover`: a finished recording of one that was not finished.

use std::path::{Path, PathBuf};

use depthloom_recording::RecordingError;
use depthloom_runs::RECORDING;
use depthloom_runs::open;
use depthloom_runs::recording_of;
use schemars::JsonSchema;
use serde::Serialize;

use crate::args::RecoverArgs;
use crate::outputs::{self, CommandOutput, Output};
use depthloom_graphs::counted;
use depthloom_terminal::{Exit, Stop, print_path, say};

/// Of `recover`: the recording that was made.
#[derive(JsonSchema, Serialize)]
pub struct Recover {
    recording: String,
    frames: u64,
}

impl CommandOutput for Recover {
    const OUTPUT: Output = Output::Recover;
}

/// Copies what was committed, and closes it with a summary.
pub fn recover(args: &RecoverArgs) -> Result<Exit, Stop> {
    let path = recording_of(&args.file, "recover")?;
    let out = args.out.clone().unwrap_or_else(|| named_after(&path));
    if out.symlink_metadata().is_ok() {
        return Err(Stop::new(Exit::Before, format!("{} exists already", out.display())).remedy("choose another --out"));
    }
    let recording = open(&path)?;
    let partial = depthloom_durable::partial_name(&out);
    if partial.symlink_metadata().is_ok() {
        let what = format!("{} exists already: what an earlier attempt left, or one that goes on", partial.display());
        return Err(Stop::new(Exit::Before, what).remedy("remove it, or choose another --out"));
    }
    let frames = depthloom_recording::recover(&recording, &partial).map_err(|error| {
        let exit = if matches!(error, RecordingError::Missing { .. }) { Exit::Before } else { Exit::Engine };
        let _ = std::fs::remove_file(&partial);
        Stop::remedied(exit, "failed to recover the recording", &error)
    })?;
    depthloom_durable::rename(&partial, &out)
        .map_err(|error| Stop::of_writing(Exit::Engine, format_args!("failed to write {}", out.display()), &error))?;
    if args.json {
        outputs::print(&Recover { recording: out.to_string_lossy().into_owned(), frames })?;
    } else {
        say(format_args!("recovered {} of {}", counted(frames, "frame"), path.display()));
        print_path("", &out)?;
    }
    Ok(Exit::Whole)
}

/// `<run>.recovered.mcap`, or `<file>.recovered.mcap`, in the current folder.
fn named_after(path: &Path) -> PathBuf {
    let of_run = path.parent().and_then(Path::file_name).filter(|_| path.ends_with(RECORDING));
    let name = of_run.or_else(|| path.file_stem()).unwrap_or_default();
    let name = name.to_string_lossy();
    let name = name.strip_suffix(".partial").unwrap_or(&name);
    PathBuf::from(format!("{name}.recovered.mcap"))
}
