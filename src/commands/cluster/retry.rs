//! `depthloom jobs retry`: submits jobs again that are not complete.

use std::collections::BTreeMap;

use depthloom_graphs::counted;
use depthloom_jobs::{JobId, JobState, Scheduler, SubmitLock, damage, slurm, states};
use depthloom_terminal::{CliError, ExitCode, print, say};

use super::submit::check_options;
use super::{SubmissionFolder, local, name_of};
use crate::args::RetryArgs;

/// Submits what is not complete, and does not run.
pub(crate) fn retry(found: &SubmissionFolder, args: &RetryArgs) -> Result<ExitCode, CliError> {
    let SubmissionFolder { folder, submission } = found;
    check_options(&args.options, submission.scheduler)?;
    let lock = SubmitLock::take(folder)?;
    let mut states = states(submission, folder)?;
    // A result can be damaged although its folder is there.
    for (job, state) in &mut states {
        if *state == JobState::Finished
            && let Some(message) = damage(&submission.result(folder, *job), false)
        {
            *state = JobState::Failed { message };
        }
    }
    if states.values().all(|state| *state == JobState::Finished) {
        say(format_args!("all jobs are finished: {}", submission.out.display()));
        return Ok(ExitCode::Success);
    }
    let missing: Vec<JobId> = states
        .iter()
        .filter(|(_, state)| !state.is_active() && **state != JobState::Finished)
        .map(|(job, _)| *job)
        .collect();
    let list = |text: &str| -> String {
        let names: Vec<String> = missing.iter().map(|job| submission.name(*job)).collect();
        format!("{text}: {}\n", names.join(" "))
    };
    if missing.is_empty() {
        say("all jobs that are not finished run or wait");
        return Ok(ExitCode::Success);
    }
    if args.dry_run {
        print(list("to submit"))?;
        return Ok(ExitCode::Success);
    }
    match submission.scheduler {
        Scheduler::Slurm => resubmit(found, args, &states),
        Scheduler::Local => local::run(found, lock, args.parallel.map(usize::from), allows_exec(found)),
        Scheduler::Script => {
            let mut text = list("not complete");
            for job in missing {
                let script = slurm::shell_quoted(&slurm::script_path(folder, job.step).display().to_string());
                text.push_str(&format!("sh {script} {}\n", job.job));
            }
            print(text)?;
            Ok(ExitCode::Success)
        }
    }
}

/// Whether the submission's scripts may start programs.
fn allows_exec(SubmissionFolder { folder, .. }: &SubmissionFolder) -> bool {
    std::fs::read_to_string(slurm::script_path(folder, 0)).is_ok_and(|script| script.contains(" --allow-exec "))
}

/// Submits jobs to Slurm again. Waiting jobs of later steps are cancelled first, because they wait for jobs that ended.
fn resubmit(
    SubmissionFolder { folder, submission }: &SubmissionFolder,
    args: &RetryArgs,
    states: &BTreeMap<JobId, JobState>,
) -> Result<ExitCode, CliError> {
    let mut submission = submission.clone();
    if !args.options.is_empty() {
        submission.options.clone_from(&args.options);
    }
    let first =
        states.iter().filter(|(_, state)| !state.is_active() && **state != JobState::Finished).map(|(job, _)| job.step);
    let first = first.min().unwrap_or_default();
    let waits = |job: &JobId| matches!(states[job], JobState::Waiting { is_queued: true, .. });
    let newest = |submission: &depthloom_jobs::Submission, id: &JobId| {
        let arrays = submission.slurm.iter().rev();
        arrays
            .clone()
            .find(|array| array.step == id.step && array.jobs.contains(&id.job))
            .map(|array| array.task(id.job))
    };
    let later: Vec<String> =
        states.keys().filter(|job| job.step > first && waits(job)).filter_map(|job| newest(&submission, job)).collect();
    slurm::cancel(&later)?;
    let size = slurm::array_size();
    let (mut after, mut count) = (Vec::new(), 0);
    for step in first..submission.steps.len() {
        let of_step: Vec<(&JobId, &JobState)> = states.iter().filter(|(job, _)| job.step == step).collect();
        let stays = |id: &JobId, state: &JobState| state.is_active() && !(step > first && waits(id));
        let active = of_step.iter().filter(|(job, state)| stays(job, state));
        let mut next: Vec<String> = active.filter_map(|(job, _)| newest(&submission, job)).collect();
        let jobs: Vec<usize> = of_step
            .iter()
            .filter(|(job, state)| **state != JobState::Finished && !stays(job, state))
            .map(|(job, _)| job.job)
            .collect();
        let arrays = slurm::submit(&submission, folder, step, &jobs, &after, size)?;
        count += jobs.len();
        next.extend(arrays.iter().map(|array| array.id.to_string()));
        submission.slurm.extend(arrays);
        submission.write(folder)?;
        if !next.is_empty() {
            after = next;
        }
    }
    say(format_args!(
        "{} submitted; `depthloom jobs {}` shows how far they are",
        counted(count as u64, "job"),
        name_of(folder)
    ));
    Ok(ExitCode::Success)
}
