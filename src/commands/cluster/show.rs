//! `depthloom jobs`: how far the jobs of a submission are.

use std::fmt::Write as _;
use std::path::Path;

use depthloom_graphs::counted;
use depthloom_jobs::{JobId, JobState, Scheduler, Submission, states};
use depthloom_terminal::{CliError, ExitCode, aligned, print};
use schemars::JsonSchema;
use serde::Serialize;

use super::{SubmissionFolder, name_of};
use crate::output;

/// The most jobs of a kind that are listed.
const MOST_LISTED: usize = 10;
/// The last lines of an error.
const ERROR_LINES: usize = 6;

/// Output of `jobs`: the states of a submission's jobs.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Jobs {
    experiment: String,
    /// The folder of the shards.
    folder: String,
    /// The folder of the last run.
    run: String,
    scheduler: Scheduler,
    submitted_utc: String,
    jobs: Vec<Job>,
}

/// A job.
#[derive(JsonSchema, Serialize)]
struct Job {
    name: String,
    /// Its step, from 1.
    step: usize,
    /// Its index in the step, from 0.
    job: usize,
    /// `waiting`, `running`, `finished`, `stopped` or `failed`.
    state: String,
    /// Frames that were processed, of a running job.
    frames: Option<u64>,
    /// All frames of the stage runs that have started.
    of: Option<u64>,
    /// Why it waits, where it runs, or why it ended.
    message: String,
}

/// Prints the states.
pub(crate) fn show(found: &SubmissionFolder, as_json: bool) -> Result<ExitCode, CliError> {
    let SubmissionFolder { folder, submission } = found;
    let states: Vec<(JobId, JobState)> = states(submission, folder)?.into_iter().collect();
    if as_json {
        output::print(&Jobs {
            experiment: submission.experiment.clone(),
            folder: folder.display().to_string(),
            run: submission.out.display().to_string(),
            scheduler: submission.scheduler,
            submitted_utc: submission.submitted_utc.clone(),
            jobs: states.iter().map(|(id, state)| job(submission, *id, state)).collect(),
        })?;
    } else {
        print(text(found, &states))?;
    }
    let has_failed = |state: &JobState| matches!(state, JobState::Failed { .. } | JobState::Stopped { .. });
    let failed = states.iter().any(|(_, state)| has_failed(state));
    Ok(if failed { ExitCode::Engine } else { ExitCode::Success })
}

fn job(submission: &Submission, id: JobId, state: &JobState) -> Job {
    let (mut frames, mut of, mut message) = (None, None, String::new());
    match state {
        JobState::Waiting { reason, .. } => message.clone_from(reason),
        JobState::Running { frames: done, of: all, message: what } => {
            (frames, of) = (Some(*done), Some(*all));
            message.clone_from(what);
        }
        JobState::Finished => {}
        JobState::Stopped { message: what } | JobState::Failed { message: what } => message.clone_from(what),
    }
    let JobId { step, job } = id;
    Job { name: submission.name(id), step: step + 1, job, state: state.name().to_owned(), frames, of, message }
}

fn text(SubmissionFolder { folder, submission }: &SubmissionFolder, states: &[(JobId, JobState)]) -> String {
    let scheduler = match submission.scheduler {
        Scheduler::Slurm => "slurm",
        Scheduler::Local => "local",
        Scheduler::Script => "script",
    };
    let mut text = format!(
        "{} ({scheduler}), submitted {}, in {}\n\n",
        submission.experiment,
        submission.submitted_utc,
        folder.display()
    );
    let names = ["finished", "running", "waiting", "stopped", "failed"];
    let mut rows = vec![["step", "jobs", names[0], names[1], names[2], names[3], names[4]].map(str::to_owned)];
    for (step, content) in submission.steps.iter().enumerate() {
        let count = |name: &str| states.iter().filter(|(id, state)| id.step == step && state.name() == name).count();
        let [finished, running, waiting, stopped, failed] = names.map(|name| count(name).to_string());
        let name = format!("{} {}", step + 1, content.name);
        rows.push([name, content.jobs().to_string(), finished, running, waiting, stopped, failed]);
    }
    text.push_str(&aligned(&rows, &[1, 2, 3, 4, 5, 6]));
    for name in ["running", "stopped", "failed"] {
        let jobs: Vec<_> = states.iter().filter(|(_, state)| state.name() == name).collect();
        if jobs.is_empty() {
            continue;
        }
        let _ = write!(text, "\n{name}:\n");
        for (id, state) in jobs.iter().take(MOST_LISTED) {
            let Job { name, frames, of, message, .. } = job(submission, *id, state);
            let frames = match (frames, of) {
                (Some(frames), Some(of)) if of > 0 => format!(" {frames} of {} ", counted(of, "frame")),
                _ => " ".to_owned(),
            };
            let _ = writeln!(text, "  {name}:{frames}{}", last_lines(&message).replace('\n', "\n    "));
        }
        if jobs.len() > MOST_LISTED {
            let _ = writeln!(text, "  and {} more", jobs.len() - MOST_LISTED);
        }
    }
    let is_finished = states.iter().all(|(_, state)| *state == JobState::Finished);
    let is_active = states.iter().any(|(_, state)| state.is_active());
    let name = name_of(folder);
    let _ = match () {
        () if is_finished => writeln!(text, "\nrun: {}", submission.out.display()),
        () if states.iter().any(|(_, state)| matches!(state, JobState::Failed { .. } | JobState::Stopped { .. })) => {
            writeln!(
                text,
                "\nlogs are in {}; `depthloom jobs retry {name}` resumes",
                folder.join(depthloom_jobs::LOGS).display()
            )
        }
        () if !is_active && submission.scheduler != Scheduler::Script => {
            writeln!(text, "\nnothing runs: `depthloom jobs retry {name}` resumes")
        }
        () => Ok(()),
    };
    text
}

/// How to see the states.
pub(crate) fn hint(folder: &Path) -> String {
    let name = name_of(folder);
    format!("`depthloom jobs {name}` shows how far they are; `depthloom jobs retry {name}` lists what is missing.")
}

fn last_lines(text: &str) -> String {
    let lines: Vec<&str> = text.lines().collect();
    lines[lines.len().saturating_sub(ERROR_LINES)..].join("\n")
}
