//! Jobs as processes on this machine.

use std::collections::{BTreeMap, VecDeque};
use std::fs::OpenOptions;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use depthloom_graphs::counted;
use depthloom_jobs::{JobEnd, JobId, JobProgress, JobState, Submission, SubmitLock, damage, states};
use depthloom_runner::Interrupt;
use depthloom_terminal::{CliError, ExitCode, print_path, say};
use depthloom_threads::locked;

use super::{SubmissionFolder, name_of};
use crate::signals;

/// The time between two looks at a process.
const POLL: Duration = Duration::from_millis(5);
/// The time between two messages.
const INTERVAL: Duration = Duration::from_secs(5);

/// Runs the steps, one after the other; the lock is held meanwhile.
pub(crate) fn run(
    SubmissionFolder { folder, submission }: &SubmissionFolder,
    lock: SubmitLock,
    parallel: Option<usize>,
    allow_exec: bool,
) -> Result<ExitCode, CliError> {
    let interrupt = signals::listen("stopping: jobs store what they have")?;
    let parallel = parallel.unwrap_or_else(|| parallel_jobs(submission));
    for step in 0..submission.steps.len() {
        let states = settled(folder, submission, step, &interrupt)?;
        let is_missing = |job: &JobId, state: &JobState| {
            *state != JobState::Finished || damage(&submission.result(folder, *job), false).is_some()
        };
        let missing: VecDeque<JobId> = states
            .iter()
            .filter(|(job, state)| job.step == step && is_missing(job, state))
            .map(|(job, _)| *job)
            .collect();
        let failed = run_step(folder, submission, missing, parallel, allow_exec, &interrupt)?;
        if interrupt.stops_admission() {
            let what = format!("interrupted; `depthloom jobs retry {}` resumes", name_of(folder));
            return Err(CliError::new(ExitCode::Interrupted, what));
        }
        if let Some(first) = failed.first() {
            let message = JobProgress::read(folder, *first).map(|progress| progress.message).unwrap_or_default();
            let (count, name) = (counted(failed.len() as u64, "job"), submission.name(*first));
            let what = format!("{count} of step {} failed; {name}: {message}", step + 1);
            let log = submission.log(folder, *first);
            let remedy = format!("see {}; `depthloom jobs retry {}` resumes", log.display(), name_of(folder));
            return Err(CliError::new(ExitCode::Engine, what).remedy(remedy));
        }
    }
    drop(lock);
    print_path("run: ", &submission.out)?;
    // As `run` ends, whose output is in the log.
    let run = JobId { step: submission.steps.len() - 1, job: 0 };
    let code = JobProgress::read(folder, run).map(|progress| progress.exit_code);
    Ok(if code == Some(ExitCode::FrameFailures as i32) { ExitCode::FrameFailures } else { ExitCode::Success })
}

/// How many jobs run at once by default: each has the workers that the submission gives it.
fn parallel_jobs(submission: &Submission) -> usize {
    let mut arguments = submission.arguments.iter();
    let workers = arguments.find(|argument| *argument == "--workers").and_then(|_| arguments.next());
    let workers = workers.and_then(|workers| workers.parse().ok()).unwrap_or(1).max(1);
    (depthloom_runner::Options::default().workers / workers).max(1)
}

/// Runs the jobs of a step. Returns those that failed.
fn run_step(
    folder: &Path,
    submission: &Submission,
    jobs: VecDeque<JobId>,
    parallel: usize,
    allow_exec: bool,
    interrupt: &Interrupt,
) -> Result<Vec<JobId>, CliError> {
    let Some(step) = jobs.front().map(|job| job.step) else { return Ok(Vec::new()) };
    let all = jobs.len();
    let (name, started) = (&submission.steps[step].name, Instant::now());
    let (queue, failed, done) = (Mutex::new(jobs), Mutex::new(Vec::new()), AtomicUsize::new(0));
    let stop = Mutex::new(None);
    thread::scope(|scope| {
        for _ in 0..parallel.min(all) {
            scope.spawn(|| {
                while let Some(job) = next(&queue, interrupt) {
                    match perform(folder, submission, job, allow_exec, interrupt) {
                        Ok(true) => {}
                        Ok(false) => locked(&failed).push(job),
                        Err(error) => {
                            locked(&stop).get_or_insert(error);
                            locked(&queue).clear();
                        }
                    }
                    done.fetch_add(1, Ordering::Relaxed);
                }
            });
        }
        let mut reported = Instant::now();
        while done.load(Ordering::Relaxed) < all && locked(&stop).is_none() && !interrupt.stops_admission() {
            thread::sleep(POLL);
            if reported.elapsed() >= INTERVAL {
                reported = Instant::now();
                say(format_args!("step {} ({name}): {} of {all} jobs", step + 1, done.load(Ordering::Relaxed)));
            }
        }
    });
    if let Some(stop) = locked(&stop).take() {
        return Err(stop);
    }
    let mut failed = std::mem::take(&mut *locked(&failed));
    failed.sort();
    let seconds = started.elapsed().as_secs_f64();
    say(format_args!("step {} ({name}): {} in {seconds:.1} s", step + 1, counted(all as u64, "job")));
    Ok(failed)
}

fn next(queue: &Mutex<VecDeque<JobId>>, interrupt: &Interrupt) -> Option<JobId> {
    if interrupt.stops_admission() { None } else { locked(queue).pop_front() }
}

/// Runs a job in a process of its own; returns whether it succeeded.
fn perform(
    folder: &Path,
    submission: &Submission,
    job: JobId,
    allow_exec: bool,
    interrupt: &Interrupt,
) -> Result<bool, CliError> {
    let log = submission.log(folder, job);
    let failed = |what: &str, error: &std::io::Error| CliError::because(ExitCode::Engine, what, error);
    let program = std::env::current_exe().map_err(|error| failed("failed to find this program's file", &error))?;
    let opened = OpenOptions::new().create(true).append(true).open(&log);
    let output = opened.map_err(|error| failed(&format!("failed to open {}", log.display()), &error))?;
    let errors = output.try_clone().map_err(|error| failed("failed to open the log twice", &error))?;
    let mut command = Command::new(program);
    command.args(["jobs", "start"]).arg(folder);
    command.args(["--step", &(job.step + 1).to_string(), "--job", &job.job.to_string()]);
    command.args(allow_exec.then_some("--allow-exec"));
    // Ctrl-C reaches this process alone, which passes it on: a job that receives two signals abandons its frames.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    command.stdin(Stdio::null()).stdout(output).stderr(errors);
    let mut child = command.spawn().map_err(|error| failed("failed to start a job", &error))?;
    let mut terminated = false;
    loop {
        match child.try_wait().map_err(|error| failed("failed to wait for a job", &error))? {
            // With `--keep-going`, a run with failed frames ends with another code, and is complete.
            Some(status) => return Ok(status.success() || is_complete(folder, submission, job)),
            None if interrupt.stops_admission() && !terminated => {
                terminated = true;
                terminate(child.id());
            }
            None => thread::sleep(POLL),
        }
    }
}

fn is_complete(folder: &Path, submission: &Submission, job: JobId) -> bool {
    JobProgress::read(folder, job).is_some_and(|progress| progress.ending == JobEnd::Finished)
        && damage(&submission.result(folder, job), false).is_none()
}

/// The states when no job of a step runs any more: those of an earlier process, which was killed, may.
fn settled(
    folder: &Path,
    submission: &Submission,
    step: usize,
    interrupt: &Interrupt,
) -> Result<BTreeMap<JobId, JobState>, CliError> {
    let mut is_reported = false;
    loop {
        let states = states(submission, folder)?;
        let running = states.iter().filter(|(job, state)| job.step == step && state.is_active()).count();
        if running == 0 || interrupt.stops_admission() {
            return Ok(states);
        }
        if !is_reported {
            say(format_args!("waiting for {} that an earlier process started", counted(running as u64, "job")));
            is_reported = true;
        }
        thread::sleep(Duration::from_millis(200));
    }
}

/// Sends SIGTERM to a process.
#[cfg(unix)]
pub(crate) fn terminate(process: u32) {
    let process = i32::try_from(process).ok().and_then(rustix::process::Pid::from_raw);
    if let Some(process) = process {
        let _ = rustix::process::kill_process(process, rustix::process::Signal::TERM);
    }
}

/// Windows has no such signal.
#[cfg(not(unix))]
pub(crate) fn terminate(_process: u32) {}
