//! The states of a submission's jobs: from the folder, and from Slurm.

use std::collections::BTreeMap;
use std::path::Path;

use depthloom_runs::RECORDING;
use depthloom_runs::run_folder::is_held;
use depthloom_terminal::CliError;

use crate::progress::{JobEnd, JobProgress, host};
use crate::slurm::{TaskState, task_states};
use crate::submission::{JobId, Scheduler, Submission};

/// The state of a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum JobState {
    /// It has not started.
    Waiting {
        /// Why, according to Slurm.
        reason: String,
        /// Whether a scheduler will start it.
        is_queued: bool,
    },
    /// It runs.
    Running {
        /// Processed frames.
        frames: u64,
        /// All frames of the stage runs that have started.
        of: u64,
        /// Where, and what it does.
        message: String,
    },
    /// Its result is complete.
    Finished,
    /// It ended without a result, and resumes when it is started again.
    Stopped {
        /// Why.
        message: String,
    },
    /// An error ended it.
    Failed {
        /// The error.
        message: String,
    },
}

impl JobState {
    /// One word for it.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Waiting { .. } => "waiting",
            Self::Running { .. } => "running",
            Self::Finished => "finished",
            Self::Stopped { .. } => "stopped",
            Self::Failed { .. } => "failed",
        }
    }

    /// Whether it runs, or will run without being started again.
    #[must_use]
    pub const fn is_active(&self) -> bool {
        matches!(self, Self::Running { .. } | Self::Waiting { is_queued: true, .. })
    }
}

/// The states of all jobs.
///
/// # Errors
/// If Slurm cannot be asked.
pub fn states(submission: &Submission, folder: &Path) -> Result<BTreeMap<JobId, JobState>, CliError> {
    // Slurm is not asked about finished jobs: it may not be there any more.
    let are_finished = submission.jobs().all(|job| is_finished(submission, folder, job));
    let known = if are_finished { BTreeMap::new() } else { task_states(&submission.slurm)? };
    // Of a job that was submitted again, the last task counts.
    let mut tasks = BTreeMap::new();
    for array in &submission.slurm {
        for &job in &array.jobs {
            tasks.insert(JobId { step: array.step, job }, known.get(&(array.id, job - array.first)));
        }
    }
    let state = |job: JobId| (job, state(submission, folder, job, tasks.get(&job).copied().flatten()));
    Ok(submission.jobs().map(state).collect())
}

/// Whether a job has ended with its result. The folder of a shard belongs to its job alone; that of the run may be
/// another run's, or that of a job that has yet to write the report.
fn is_finished(submission: &Submission, folder: &Path, job: JobId) -> bool {
    let has_ended = || JobProgress::read(folder, job).is_some_and(|progress| progress.ending == JobEnd::Finished);
    (!submission.steps[job.step].is_run() || has_ended()) && submission.result(folder, job).join(RECORDING).is_file()
}

fn state(submission: &Submission, folder: &Path, job: JobId, task: Option<&TaskState>) -> JobState {
    if is_finished(submission, folder, job) {
        return JobState::Finished;
    }
    let result = submission.result(folder, job);
    let progress = JobProgress::read(folder, job);
    if let Some(task) = task.filter(|task| task.is_active()) {
        return match progress {
            Some(JobProgress { frames, of, message, host, .. }) if task.is_running() => {
                JobState::Running { frames, of, message: on_host(&host, &message) }
            }
            _ if task.is_running() => JobState::Running { frames: 0, of: 0, message: String::new() },
            _ => JobState::Waiting { reason: task.reason.clone(), is_queued: true },
        };
    }
    let ended = task.map(|task| task.state.clone());
    let Some(progress) = progress else {
        return match ended {
            Some(state) => JobState::Stopped { message: format!("Slurm: {state}") },
            None => JobState::Waiting { reason: String::new(), is_queued: false },
        };
    };
    let JobProgress { ending, frames, of, message, host: machine, process, .. } = progress;
    let after = if of > 0 { format!("after {frames} of {of} frames: ") } else { String::new() };
    match ending {
        JobEnd::Failed => JobState::Failed { message },
        JobEnd::Interrupted => JobState::Stopped { message: format!("{after}{message}") },
        JobEnd::Finished => JobState::Stopped { message: "its result was removed".to_owned() },
        // Slurm knows better.
        JobEnd::Running if submission.scheduler != Scheduler::Slurm && is_alive(&result, &machine, process) => {
            JobState::Running { frames, of, message: on_host(&machine, &message) }
        }
        JobEnd::Running => {
            let why = ended.map_or_else(|| "it was killed".to_owned(), |state| format!("Slurm: {state}"));
            JobState::Stopped { message: format!("{after}{why} (on {machine})") }
        }
    }
}

/// Whether a process computes the result now: it runs on this machine, or has the lock of the result.
fn is_alive(result: &Path, machine: &str, process: u32) -> bool {
    let runs_here = machine == host() && Path::new("/proc").join(process.to_string()).exists();
    runs_here || is_held(&depthloom_durable::partial_name(result))
}

fn on_host(host: &str, message: &str) -> String {
    if message.is_empty() { format!("on {host}") } else { format!("on {host}: {message}") }
}
