//! A run that ended early: what it kept, and how to resume.

use depthloom_graphs::counted;
use depthloom_runs::outdated_files;
use depthloom_runs::run_folder::RunFolder;
use depthloom_terminal::{CliError, ExitCode};

use super::programs::PRINTED;

pub(super) struct EarlyEnd {
    pub(super) why: CliError,
    pub(super) frames: u64,
    /// Whether frames that were written may hold wrong values.
    pub(super) is_suspect: bool,
}

impl EarlyEnd {
    /// As [`EarlyEnd::stop`], of a live run, which cannot resume.
    pub(super) fn stop_live(self, folder: RunFolder) -> CliError {
        if self.frames == 0 {
            folder.discard();
            return self.why.also("no frame was recorded");
        }
        let (count, partial) = (counted(self.frames, "frame"), folder.partial.display());
        self.why.also(format!("{count} can be read from {partial}: `depthloom inspect {partial}`"))
    }

    /// As [`EarlyEnd::stop`], of a shard, whose folder the same command finds again.
    pub(super) fn stop_shard(self, folder: RunFolder) -> CliError {
        if self.is_suspect || self.frames == 0 && outdated_files(&folder.partial).is_empty() {
            folder.discard();
            return self.why;
        }
        let count = counted(self.frames, "frame");
        self.why.also(format!("{count} of the shard are stored; when it is started again, it resumes after them"))
    }

    /// Adds what was kept and how to resume. The folder of a run that wrote no frame is removed.
    pub(super) fn stop(self, folder: RunFolder, is_remote: bool) -> CliError {
        let mut stop = self.why;
        let (partial, checkpoints) = (folder.partial.clone(), folder.checkpoints());
        let frames = self.frames;
        if self.is_suspect && folder.resumes {
            let partial = partial.display();
            return stop.also(format!("{partial} holds values that may be wrong: replace it with --fresh --overwrite"));
        }
        if self.is_suspect {
            folder.discard();
            return stop.also("nothing of this run was kept");
        }
        if frames == 0 && !outdated_files(&folder.partial).is_empty() {
            let partial = partial.display();
            return stop.also(format!(
                "no frame was recorded; {partial} keeps the frames of the interrupted run, and the same command with the same --out reuses them"
            ));
        }
        if frames == 0 {
            folder.discard();
            stop = stop.also("no frame was recorded");
        } else {
            let count = counted(frames, "frame");
            let (at, report) = (partial.display(), partial.display());
            stop = stop.also(format!("{count} can be read from {at}: `depthloom report {report}`"));
            let printed = partial.join(PRINTED);
            if printed.is_file() {
                stop = stop.also(format!("the output of programs is in {}", printed.display()));
            }
        }
        let has_checkpoint = std::fs::read_dir(&checkpoints).is_ok_and(|mut files| files.next().is_some());
        let resumes = if frames == 0 { "" } else { "after these frames, " };
        if stop.exit == ExitCode::Interrupted && has_checkpoint {
            let checkpoints = checkpoints.display();
            stop = stop.also(format!(
                "repeat the command with the same --out to resume: {resumes}training from {checkpoints}"
            ));
        } else if stop.exit != ExitCode::Usage && frames > 0 {
            let fixed = if stop.exit == ExitCode::FrameFailures { "once the cause is fixed, " } else { "" };
            stop = stop.also(if is_remote {
                format!("{fixed}`depthloom run` of the same experiment with the same --out resumes after these frames")
            } else {
                format!("{fixed}repeat the command with the same --out to resume after these frames")
            });
        }
        stop
    }
}
