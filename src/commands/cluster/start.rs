//! `depthloom jobs start`: runs a job of a submission; the scripts call it.

use clap::Parser as _;
use std::path::Path;

use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::Ready;
use depthloom_graphs::{Registry, counted};
use depthloom_jobs::{JobEnd, JobId, ProgressFile, Shard, ShardFolder, Submission, damage};
use depthloom_recording::{Condition, Recording};
use depthloom_runs::RECORDING;
use depthloom_terminal::{CliError, ExitCode, say};

use super::{absolute, name_of, scratch};
use crate::allow_exec;
use crate::args::{Cli, Command, ExecArgs, RunArgs, StartArgs};
use crate::execution::carry_out;
use crate::execution::shard::{compute, needs_reuse, shard_folder};
use crate::experiment::load_texts;
use crate::signals;

/// Runs a job, and reports its progress in the folder of the submission.
pub(crate) fn start(args: &StartArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    needs_reuse()?;
    let folder = absolute(&args.folder)?;
    let submission = Submission::read(&folder)?;
    let job = job(args, &submission)?;
    let directory = &submission.directory;
    std::env::set_current_dir(directory).map_err(|error| {
        CliError::because(ExitCode::Usage, format_args!("failed to enter {}", directory.display()), &error)
    })?;
    let progress = ProgressFile::start(&folder, job);
    let done = perform(&submission, &folder, job, args.exec, registry, &progress);
    match &done {
        Ok(exit) => progress.end(JobEnd::Finished, *exit as i32, ""),
        Err(stop) if stop.exit == ExitCode::Interrupted => {
            progress.end(JobEnd::Interrupted, stop.exit as i32, &stop.to_string());
        }
        Err(stop) => progress.end(JobEnd::Failed, stop.exit as i32, &stop.to_string()),
    }
    done
}

fn job(args: &StartArgs, submission: &Submission) -> Result<JobId, CliError> {
    let step =
        args.step.checked_sub(1).filter(|step| submission.steps.get(*step).is_some_and(|step| args.job < step.jobs()));
    let step = step.ok_or_else(|| {
        let what = format!("the submission has no job {} of step {}", args.job, args.step);
        CliError::usage(what, "steps are counted from 1, jobs from 0; `depthloom jobs` lists them")
    })?;
    Ok(JobId { step, job: args.job })
}

fn perform(
    submission: &Submission,
    folder: &Path,
    job: JobId,
    exec: ExecArgs,
    registry: &Registry,
    progress: &ProgressFile,
) -> Result<ExitCode, CliError> {
    let is_run = submission.steps[job.step].is_run();
    let out = submission.result(folder, job);
    let args = run_args(submission, is_run)?;
    let loaded = load_texts(&args.experiment, registry, true, submission.files.clone())?;
    allow_exec::decide(exec, Some((&args.experiment.experiment, &loaded)))?;
    let shards = shard_folder(&args.folder.path(), &loaded.plan)?;
    if shards.path().file_name() != folder.file_name() {
        let what =
            "the plan is not the submitted one: a file that the experiment names changed since, or depthloom did";
        return Err(CliError::usage(what, "submit the experiment again"));
    }
    // Its own name of the folder, however the script names it.
    let shards = ShardFolder::at(folder);
    if is_run {
        if out.symlink_metadata().is_ok() {
            return existing_run(&out, &loaded.plan);
        }
        check_shards(submission, folder)?;
    }
    let ready = Ready::new(loaded.plan.clone(), registry).map_err(|missing| CliError::of_missing(&missing))?;
    let interrupt = signals::listen("stopping: frames in flight are finished, training is checkpointed")?;
    let Some(shard) = submission.steps[job.step].shards.get(job.job) else {
        return carry_out(&args, loaded, ready, &interrupt, None, progress, &[]).map(|(exit, _)| exit);
    };
    let compute = |out: &Path| compute(&args, loaded, ready, &interrupt, shard, (&shards, out), progress);
    let computed = match &submission.scratch {
        Some(scratch) if !matches!(shard, Shard::Nodes { .. }) => {
            scratch::through(&scratch.join(format!("depthloom-{}", submission.plan)), &out, compute)?
        }
        _ => compute(&out)?,
    };
    if computed.failed > 0 && args.keep_going {
        // The last run reports it.
        let frames = counted(computed.failed, "frame");
        say(format_args!("{frames} failed; values that depend on them are left out"));
        return Ok(ExitCode::Success);
    }
    computed.print()
}

/// The folder of the run is there: an earlier process of this job wrote it, or it belongs to something else.
fn existing_run(out: &Path, plan: &Plan) -> Result<ExitCode, CliError> {
    let is_own = Recording::open(out.join(RECORDING))
        .is_ok_and(|recording| *recording.condition() == Condition::Complete && recording.is_of_experiment(plan));
    if is_own {
        say(format_args!("the run is complete: {}", out.display()));
        return Ok(ExitCode::Success);
    }
    let what = format!("{} exists already, and is not the run of this submission", out.display());
    Err(CliError::usage(what, "move it away, then `depthloom jobs retry` resumes; or submit with another --out"))
}

/// The options of `run` for a job.
fn run_args(submission: &Submission, is_run: bool) -> Result<RunArgs, CliError> {
    let mut words = vec!["depthloom".to_owned(), "run".to_owned()];
    words.extend(submission.arguments.iter().cloned());
    if is_run {
        words.extend(["--out".to_owned(), submission.out.display().to_string()]);
    }
    match Cli::try_parse_from(words) {
        Ok(Cli { command: Command::Run(args), .. }) => Ok(args),
        Ok(_) => Err(CliError::usage("the submission is not that of a run", "submit the experiment again")),
        Err(error) => {
            let what = format!("the submission has options that this depthloom does not know: {error}");
            Err(CliError::usage(what, "submit the experiment again"))
        }
    }
}

/// Refuses to compute in the last run what shards should have computed.
fn check_shards(submission: &Submission, folder: &Path) -> Result<(), CliError> {
    for job in submission.jobs().filter(|job| !submission.steps[job.step].is_run()) {
        if let Some(damage) = damage(&submission.result(folder, job), false) {
            let what = format!("the result of job {} cannot be used: {damage}", submission.name(job));
            let remedy = format!("`depthloom jobs retry {}` computes it again", name_of(folder));
            return Err(CliError::usage(what, remedy));
        }
    }
    Ok(())
}
