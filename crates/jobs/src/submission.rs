//! A submission: what was split into which jobs, stored in the folder of the shards.

use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use depthloom_graphs::regular_file;
use depthloom_terminal::{CliError, ExitCode};
use serde::{Deserialize, Serialize};

use crate::steps::{Split, Step};

/// The name of its file.
pub const JOBS: &str = "jobs.json";
/// Held while jobs are submitted.
const LOCK: &str = "jobs.lock";
/// The most bytes of `jobs.json`: 100,000 shards and the experiment.
const LARGEST: u64 = 256 << 20;
/// What its file states first.
pub const FORMAT: &str = "depthloom jobs 1";

/// Where the jobs of a submission run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Scheduler {
    /// Job arrays of Slurm.
    Slurm,
    /// Processes on this machine.
    Local,
    /// Scripts that the user gives to another scheduler.
    Script,
}

/// What was split into which jobs.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Submission {
    /// [`FORMAT`].
    pub format: String,
    /// The name of the experiment.
    pub experiment: String,
    /// The key of its plan.
    pub plan: String,
    /// When it was submitted: UTC.
    pub submitted_utc: String,
    /// The working directory.
    pub directory: PathBuf,
    /// The experiment's files and their texts when it was submitted: later changes of the files have no effect.
    pub files: Vec<(PathBuf, String)>,
    /// The arguments of `run` that every job has.
    pub arguments: Vec<String>,
    /// The folder of the last run.
    pub out: PathBuf,
    /// Where the jobs run.
    pub scheduler: Scheduler,
    /// What the work is split by.
    pub split: Split,
    /// Options of `sbatch`.
    pub options: Vec<String>,
    /// A folder on the machine of a job, in which it records before it copies the result.
    pub scratch: Option<PathBuf>,
    /// The steps, in order.
    pub steps: Vec<Step>,
    /// The jobs of Slurm that were submitted.
    pub slurm: Vec<SlurmArray>,
}

/// A job array of Slurm.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlurmArray {
    /// The step.
    pub step: usize,
    /// Slurm's number.
    pub id: u64,
    /// The job of the step with index 0 in the array.
    pub first: usize,
    /// The jobs, by index in the step.
    pub jobs: Vec<usize>,
}

/// A job of a submission.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct JobId {
    /// The index of its step.
    pub step: usize,
    /// Its index in the step.
    pub job: usize,
}

/// Held while jobs are submitted, retried or cancelled.
#[derive(Debug)]
pub struct SubmitLock(#[expect(dead_code, reason = "it is held, not read")] File);

impl SubmitLock {
    /// Takes the lock of a folder, which is created.
    ///
    /// # Errors
    /// If another process has it, or the system refuses.
    pub fn take(folder: &Path) -> Result<Self, CliError> {
        let path = folder.join(LOCK);
        let failed = |error: &io::Error| {
            CliError::because(ExitCode::Usage, format_args!("failed to lock {}", path.display()), error)
        };
        std::fs::create_dir_all(folder).map_err(|error| failed(&error))?;
        let file = depthloom_durable::open_or_create(&path).map_err(|error| failed(&error))?;
        match file.try_lock() {
            Ok(()) => Ok(Self(file)),
            // Then nothing prevents two submissions at once; their jobs still have folders with one writer each.
            Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => Ok(Self(file)),
            Err(TryLockError::WouldBlock) => {
                let what = format!("another process submits, or runs, the jobs in {}", folder.display());
                Err(CliError::usage(what, "wait for it; `depthloom jobs` shows its state"))
            }
            Err(TryLockError::Error(error)) => Err(failed(&error)),
        }
    }
}

impl Submission {
    /// Reads the submission in a folder of shards.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(folder: &Path) -> Result<Self, CliError> {
        let path = folder.join(JOBS);
        let failed = |error: &dyn std::error::Error| {
            CliError::because(ExitCode::Usage, format_args!("failed to read {}", path.display()), error)
                .remedy("the folder may have been moved, or the file is damaged: submit the experiment again")
        };
        let bytes = regular_file::read(&path, LARGEST).map_err(|error| failed(&error))?;
        let submission: Self = serde_json::from_slice(&bytes).map_err(|error| failed(&error))?;
        if submission.format == FORMAT {
            return Ok(submission);
        }
        let what =
            format!("{} has the format `{}`, and this depthloom reads `{FORMAT}`", path.display(), submission.format);
        Err(CliError::usage(what, "use the version of depthloom that submitted it"))
    }

    /// Writes it to a folder of shards.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn write(&self, folder: &Path) -> Result<(), CliError> {
        let path = folder.join(JOBS);
        let text = serde_json::to_vec(self).map_err(|error| {
            CliError::because(ExitCode::Engine, format_args!("failed to write {}", path.display()), &error)
        })?;
        depthloom_durable::write(&path, &text).map_err(|error| {
            CliError::of_writing(ExitCode::Usage, format_args!("failed to write {}", path.display()), &error)
        })
    }

    /// All jobs, in order.
    pub fn jobs(&self) -> impl Iterator<Item = JobId> + '_ {
        let steps = self.steps.iter().enumerate();
        steps.flat_map(|(step, content)| (0..content.jobs()).map(move |job| JobId { step, job }))
    }

    /// Where the result of a job is when it is complete.
    #[must_use]
    pub fn result(&self, folder: &Path, job: JobId) -> PathBuf {
        if self.steps[job.step].is_run() { self.out.clone() } else { folder.join(self.name(job)) }
    }

    /// The name of a job: `1-frames-2-of-4`, `2-learn.train`, `3-run`.
    #[must_use]
    pub fn name(&self, JobId { step, job }: JobId) -> String {
        let content = &self.steps[step];
        let name = content.shards.get(job).map_or_else(|| content.name.clone(), crate::shard::Shard::name);
        format!("{}-{name}", step + 1)
    }

    /// The log of a job.
    #[must_use]
    pub fn log(&self, folder: &Path, JobId { step, job }: JobId) -> PathBuf {
        let array = self.slurm.iter().rev().find(|array| array.step == step && array.jobs.contains(&job));
        let name = match array.map_or(0, |array| array.first) {
            0 => format!("{}-{job}.log", step + 1),
            first => format!("{}-{first}+{}.log", step + 1, job - first),
        };
        folder.join(LOGS).join(name)
    }
}

/// The folder of the logs of jobs.
pub const LOGS: &str = "logs";
