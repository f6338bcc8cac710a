//! `depthloom jobs cancel`: ends running and waiting jobs.

use std::collections::BTreeSet;

use depthloom_graphs::counted;
use depthloom_jobs::{JobProgress, JobState, Scheduler, host, slurm, states};
use depthloom_terminal::{CliError, ExitCode, say};

use super::{SubmissionFolder, name_of};

/// Ends the jobs of a submission.
pub(crate) fn cancel(SubmissionFolder { folder, submission }: &SubmissionFolder) -> Result<ExitCode, CliError> {
    let states = states(submission, folder)?;
    let active: Vec<_> = states.iter().filter(|(_, state)| state.is_active()).map(|(job, _)| *job).collect();
    if active.is_empty() {
        say("no job runs or waits");
        return Ok(ExitCode::Success);
    }
    if submission.scheduler == Scheduler::Slurm {
        let steps: BTreeSet<usize> = active.iter().map(|job| job.step).collect();
        let arrays = submission.slurm.iter().filter(|array| steps.contains(&array.step));
        slurm::cancel(&arrays.map(|array| array.id.to_string()).collect::<Vec<_>>())?;
    } else {
        let here = host();
        let running = active.iter().filter(|job| matches!(states[job], JobState::Running { .. }));
        for progress in running.filter_map(|job| JobProgress::read(folder, *job)).filter(|job| job.host == here) {
            super::local::terminate(progress.process);
        }
    }
    say(format_args!(
        "ending {}; `depthloom jobs retry {}` resumes them",
        counted(active.len() as u64, "job"),
        name_of(folder)
    ));
    Ok(ExitCode::Success)
}
