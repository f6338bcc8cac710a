//! What a job reports while it runs: a small file in the folder of the shards.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use depthloom_graphs::Frame;
use depthloom_graphs::contracts::Failure;
use depthloom_graphs::plan::{NodeId, RunId};
use depthloom_graphs::regular_file;
use depthloom_runner::Observer;
use depthloom_runs::environment::utc_stamp;
use serde::{Deserialize, Serialize};

use crate::submission::JobId;

/// The folder of these files.
const FOLDER: &str = "progress";
/// The most bytes of such a file.
const LARGEST: u64 = 1 << 20;
/// The time between two reports of frames: thousands of jobs write to one file system.
const INTERVAL: Duration = Duration::from_secs(5);

/// How a job ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum JobEnd {
    /// It has not ended, or was killed.
    #[default]
    Running,
    /// Its result is complete.
    Finished,
    /// A signal ended it; it can resume.
    Interrupted,
    /// An error ended it.
    Failed,
}

/// What a job reports.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct JobProgress {
    /// How it ended.
    pub ending: JobEnd,
    /// Frames that were processed, over all stage runs so far.
    pub frames: u64,
    /// Frames of these stage runs.
    pub of: u64,
    /// What it does, of a long computation; or why it failed.
    pub message: String,
    /// The machine.
    pub host: String,
    /// The process.
    pub process: u32,
    /// When it started: UTC.
    pub started_utc: String,
    /// Its exit code, once it has ended.
    #[serde(default)]
    pub exit_code: i32,
    /// How often it was started.
    pub starts: u32,
}

impl JobProgress {
    /// What a job has reported; `None` if it never ran.
    #[must_use]
    pub fn read(folder: &Path, job: JobId) -> Option<Self> {
        let bytes = regular_file::read(&path(folder, job), LARGEST).ok()?;
        serde_json::from_slice(&bytes).ok()
    }
}

/// Reports the progress of a job, while it observes it.
pub struct ProgressFile {
    path: PathBuf,
    state: Mutex<(JobProgress, Instant)>,
}

impl ProgressFile {
    /// States that a job runs on this machine.
    #[must_use]
    pub fn start(folder: &Path, job: JobId) -> Self {
        let starts = JobProgress::read(folder, job).map_or(0, |before| before.starts) + 1;
        let progress = JobProgress {
            host: host(),
            process: std::process::id(),
            started_utc: utc_stamp(),
            starts,
            ..JobProgress::default()
        };
        let file = Self { path: path(folder, job), state: Mutex::new((progress, Instant::now())) };
        file.change(true, |_| {});
        file
    }

    /// States how the job ended.
    pub fn end(&self, ending: JobEnd, exit_code: i32, message: &str) {
        self.change(true, |progress| {
            (progress.ending, progress.exit_code) = (ending, exit_code);
            message.clone_into(&mut progress.message);
        });
    }

    fn change(&self, is_due: bool, change: impl FnOnce(&mut JobProgress)) {
        let mut state = self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        change(&mut state.0);
        if !is_due && state.1.elapsed() < INTERVAL {
            return;
        }
        state.1 = Instant::now();
        // A report that cannot be written must not end the job.
        let _ = self.path.parent().map(std::fs::create_dir_all);
        let new = self.path.with_extension("new");
        if serde_json::to_vec(&state.0).is_ok_and(|text| std::fs::write(&new, text).is_ok()) {
            let _ = std::fs::rename(new, &self.path);
        }
    }
}

impl Observer for ProgressFile {
    fn stage_started(&self, _run: RunId, frames: u64) {
        self.change(false, |progress| progress.of += frames);
    }

    fn frame_retired(&self, _run: RunId, _frame: &Frame, _failures: &[Failure]) {
        self.change(false, |progress| progress.frames += 1);
    }

    fn progress(&self, _run: RunId, _node: NodeId, done: u64, total: u64, message: &str) {
        self.change(false, |progress| progress.message = format!("{done}/{total} {message}"));
    }
}

fn path(folder: &Path, JobId { step, job }: JobId) -> PathBuf {
    folder.join(FOLDER).join(format!("{}-{job}.json", step + 1))
}

/// The name of this machine; empty if it cannot be determined.
#[must_use]
pub fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = name.trim();
    if name.is_empty() { std::env::var("HOSTNAME").unwrap_or_default() } else { name.to_owned() }
}
