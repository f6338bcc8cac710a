//! The folder that a run writes, and what an interrupted run left in it.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::Ready;
use depthloom_graphs::regular_file;
use depthloom_recording::{EarlierRuns, Recording, RecordingError};
use depthloom_runner::Share;
use depthloom_runs::environment::{self, ENVIRONMENT};
use depthloom_runs::run_folder::{PartialContent, RunFolder};
use depthloom_runs::{RECORDING, next_outdated, outdated_files, reuse};
use depthloom_terminal::{CliError, ExitCode};
use serde_json::json;

use super::print_warnings;
use crate::args::RunArgs;

/// Which folder is written, and what may be in it.
pub(super) struct FolderRequest<'a> {
    /// That of `--out`.
    pub(super) out: Option<&'a Path>,
    pub(super) overwrite: bool,
    /// Whether nothing is resumed.
    pub(super) is_fresh: bool,
    pub(super) is_json: bool,
    /// The folder of runs.
    pub(super) runs: &'a Path,
}

/// Whether a file is absent, empty, or full of zeros: after a power cut it can have its length without its bytes.
fn has_no_bytes(path: &Path) -> bool {
    let Ok(file) = regular_file::open(path) else { return std::fs::symlink_metadata(path).is_err() };
    let mut file = BufReader::with_capacity(1 << 16, file);
    loop {
        match file.fill_buf() {
            Ok([]) => return true,
            Ok(bytes) if bytes.iter().all(|byte| *byte == 0) => {
                let length = bytes.len();
                file.consume(length);
            }
            Ok(_) | Err(_) => return false,
        }
    }
}

/// The folder to write: that of `--out`, or a new one; and the recording of the interrupted run in it, if there is one.
pub(super) fn make_folder(
    request: &FolderRequest<'_>,
    plan: &Plan,
    kept: &[(String, String)],
    read: &[PathBuf],
) -> Result<(RunFolder, Option<Arc<Recording>>), CliError> {
    let mut recording = None;
    let resumable = |partial: &Path| {
        let path = partial.join(RECORDING);
        // A run that ended before it recorded anything again leaves only what was set aside: no frame of that is lost.
        let nothing = || {
            let aside = outdated_files(partial).into_iter().map(|path| match Recording::open(path) {
                Ok(aside) if aside.is_empty() => PartialContent::Nothing,
                Ok(aside) if !request.is_fresh && aside.is_of_experiment(plan) => PartialContent::This,
                // Frames that cannot be read at the moment are not removed either.
                Ok(_) | Err(_) => PartialContent::Other,
            });
            let mut aside = aside.filter(|content| *content != PartialContent::Nothing).collect::<Vec<_>>();
            // Frames of another experiment are kept, whatever is beside them.
            aside.sort_by_key(|content| *content == PartialContent::This);
            aside.into_iter().next().unwrap_or(PartialContent::Nothing)
        };
        match Recording::open(&path) {
            Ok(found) if found.is_empty() => nothing(),
            Ok(found) if !request.is_fresh && found.is_of_experiment(plan) => {
                recording = Some(Arc::new(found));
                PartialContent::This
            }
            // It ended before the head of the recording was written, or the file was made.
            Err(RecordingError::NotARecording { .. }) => nothing(),
            Err(_) if has_no_bytes(&path) => nothing(),
            Ok(_) => PartialContent::Other,
            Err(error) => PartialContent::Unreadable(error.to_string()),
        }
    };
    let folder = match request.out {
        Some(out) if request.is_json && out.to_str().is_none() => {
            let what = format!("the output folder `{}` is not UTF-8, which --json needs", out.display());
            return Err(CliError::usage(what, "choose another --out, or leave --json out"));
        }
        Some(out) => RunFolder::create(out, request.overwrite, read, resumable)?,
        None => RunFolder::create_new(&request.runs.join(&plan.experiment), &environment::utc_stamp())?,
    };
    match write_experiment(&folder, kept, read) {
        Ok(()) => Ok((folder, recording)),
        Err(stop) if folder.resumes => Err(stop),
        Err(stop) => {
            folder.discard();
            Err(stop)
        }
    }
}

/// Writes the experiment's files beside the recording, so that they can be checked and run from there, and lists what
/// the run reads.
fn write_experiment(folder: &RunFolder, kept: &[(String, String)], read: &[PathBuf]) -> Result<(), CliError> {
    // Of a run that comes to its end it says more.
    let reads = json!({ "reads": environment::reads(read) });
    folder.write(ENVIRONMENT, &format!("{reads:#}\n"))?;
    for (name, text) in kept {
        if let Some(inner) = Path::new(name).parent().filter(|inner| !inner.as_os_str().is_empty()) {
            let inner = folder.partial.join(inner);
            depthloom_durable::create_folder(&inner).map_err(|error| {
                CliError::of_writing(ExitCode::Usage, format_args!("failed to create {}", inner.display()), &error)
            })?;
        }
        folder.write(name, text)?;
    }
    Ok(())
}

pub(super) struct Reusable {
    /// The recording of an interrupted process of the same run, which resumes after it.
    pub(super) resumable: Option<Arc<Recording>>,
    pub(super) earlier: EarlierRuns,
}

impl Reusable {
    /// Sets the recording of an interrupted process aside if it is damaged, or this run would record something else:
    /// its data, programs or engines changed.
    pub(super) fn verified(
        self,
        args: &RunArgs,
        folder: &RunFolder,
        ready: &Ready,
        share: Option<&Share>,
        is_remote: bool,
    ) -> Result<Self, CliError> {
        let Self { resumable: Some(recording), earlier } = self else { return Ok(self) };
        let outdated = if is_remote {
            Some("dora computes all values again".to_owned())
        } else {
            reuse::outdated(ready, &earlier, &recording, share)?
        };
        let Some(why) = outdated else { return Ok(Self { resumable: Some(recording), earlier }) };
        drop((recording, earlier));
        let partial = folder.partial.display();
        print_warnings(
            args,
            &[format!("cannot resume after the frames in {partial}: {why}; values that are still valid are reused")],
        );
        let (recording, aside) = (folder.file(RECORDING), next_outdated(&folder.partial));
        depthloom_durable::rename(&recording, &aside).map_err(|error| {
            CliError::of_writing(ExitCode::Engine, format_args!("failed to rename {}", recording.display()), &error)
        })?;
        Ok(Self {
            resumable: None,
            earlier: reuse::earlier_runs(args.is_fresh(), folder, &args.folder.path(), &ready.plan, &|_| false),
        })
    }
}
