//! `depthloom submit`: an experiment as jobs of a cluster.

use std::path::{Path, PathBuf};

use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::open;
use depthloom_graphs::{Registry, counted};
use depthloom_jobs::slurm::{JobCommand, JobRequest};
use depthloom_jobs::{FORMAT, LOGS, Scheduler, ShardFolder, Split, Submission, SubmitLock, slurm, states, steps};
use depthloom_nodes::process::permission::is_allowed;
use depthloom_runs::environment::utc_stamp;
use depthloom_terminal::{CliError, ExitCode, print, say};

use super::requests::requests;
use super::{SubmissionFolder, absolute, local, name_of, show};
use crate::allow_exec;
use crate::args::{SplitBy, SubmitArgs};
use crate::execution::shard::{needs_reuse, shard_folder};
use crate::experiment::{is_file, load};

/// The default number of shards.
const SHARDS: usize = 8;

/// Splits an experiment into jobs, and submits them.
pub(crate) fn submit(args: &SubmitArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    is_file(&args.experiment)?;
    needs_reuse()?;
    let scheduler = Scheduler::from(args.to);
    check_options(&args.options, scheduler)?;
    let loaded = load(&args.experiment, registry, false)?;
    allow_exec::decide(args.exec, Some((&args.experiment.experiment, &loaded)))?;
    let plan = &loaded.plan;
    needs_permission(args, plan)?;
    let runs = absolute(&args.folder.path())?;
    let folder = shard_folder(&runs, plan)?;
    let mut frames = Vec::new();
    for run in &plan.runs {
        // A source that cannot be opened here is reported now, and not by every job.
        let source = open(&run.source, registry).map_err(|missing| CliError::of_missing(&[*missing]))?;
        frames.push(source.frames().len());
    }
    let most = frames.iter().copied().max().unwrap_or_default();
    let split = split(args, most, plan.variants.len())?;
    let out = match &args.out {
        Some(out) => absolute(out)?,
        // With the plan: two submissions may be made in one second.
        None => runs.join(&plan.experiment).join(format!("{}-{}", utc_stamp(), short(&folder))),
    };
    let files = loaded.read.iter().zip(&plan.written);
    let submission = Submission {
        format: FORMAT.to_owned(),
        experiment: plan.experiment.clone(),
        plan: folder.path().file_name().unwrap_or_default().to_string_lossy().into_owned(),
        submitted_utc: utc_stamp(),
        directory: absolute(Path::new("."))?,
        files: files.map(|(path, (_, text))| (path.clone(), text.clone())).collect(),
        arguments: arguments(args, &runs),
        out,
        scheduler,
        split,
        options: args.options.clone(),
        scratch: args.scratch.as_deref().map(absolute).transpose()?,
        steps: steps(plan, split),
        slurm: Vec::new(),
    };
    if scheduler == Scheduler::Local && (args.program.is_some() || !args.setup.is_empty()) {
        return Err(CliError::usage("--program and --setup are for scripts, not for --to local", "leave them out"));
    }
    let requests = match &args.from {
        Some(run) => {
            let recording = args.folder.recording(run, "submit EXPERIMENT --from")?;
            let run = recording.parent().unwrap_or(Path::new("."));
            requests(run, plan, &frames, &submission.steps, args.workers.unwrap_or(1))?
        }
        None => Vec::new(),
    };
    let command = command(&folder, args, requests)?;
    if args.dry_run {
        return dry_run(&submission, &folder, &command);
    }
    // A refused submission leaves no folder.
    keep_from_running_twice(&folder, &submission)?;
    let lock = SubmitLock::take(folder.path())?;
    keep_from_running_twice(&folder, &submission)?;
    write(&submission, &folder, &command)?;
    let found = SubmissionFolder { folder: folder.path().to_owned(), submission };
    say(format_args!("{} in {}", describe(&found.submission), folder.path().display()));
    match scheduler {
        Scheduler::Slurm => {
            let found = submit_to_slurm(found)?;
            drop(lock);
            say(format_args!("`depthloom jobs {}` shows how far they are", found.name()));
            Ok(ExitCode::Success)
        }
        Scheduler::Local => local::run(&found, lock, args.parallel.map(usize::from), args.exec.allow_exec),
        Scheduler::Script => {
            print(instructions(&found.submission, folder.path()))?;
            Ok(ExitCode::Success)
        }
    }
}

/// Refuses options of `sbatch` that cannot be passed on.
pub(super) fn check_options(options: &[String], scheduler: Scheduler) -> Result<(), CliError> {
    if !options.is_empty() && scheduler != Scheduler::Slurm {
        return Err(CliError::usage("options after `--` are those of sbatch, for --to slurm", "leave them out"));
    }
    match slurm::refused_option(options) {
        Some(what) => Err(CliError::usage(what, "leave it out; `depthloom submit --help` has the options that exist")),
        None => Ok(()),
    }
}

/// The beginning of the plan's key.
fn short(folder: &ShardFolder) -> String {
    folder.path().file_name().unwrap_or_default().to_string_lossy().chars().take(6).collect()
}

/// Refuses an experiment that starts programs without permission: every job would fail.
fn needs_permission(args: &SubmitArgs, plan: &Plan) -> Result<(), CliError> {
    let mut nodes = plan.runs.iter().flat_map(|run| run.nodes.iter().map(move |node| (&run.stage, node)));
    match nodes.find(|(_, node)| node.kind.split('/').next() == Some("process")) {
        Some((stage, node)) if !args.exec.allow_exec && !is_allowed() => {
            let what = format!(
                "node `{stage}.{}` starts a program, and an experiment starts no program unless you allow it",
                node.name
            );
            Err(CliError::usage(what, "read what it starts; then submit it with --allow-exec"))
        }
        _ => Ok(()),
    }
}

fn split(args: &SubmitArgs, frames: usize, variants: usize) -> Result<Split, CliError> {
    let wanted = args.shards.map(|shards| shards as usize);
    let (what, most) = match args.by {
        SplitBy::Frames => ("frames", frames),
        SplitBy::Variants => ("variants", variants),
    };
    if let Some(wanted) = wanted.filter(|wanted| *wanted > most) {
        let what = format!("--shards {wanted}: the experiment has {most} {what}");
        return Err(CliError::usage(what, format!("use at most {}", most.max(1))));
    }
    let count = wanted.unwrap_or(SHARDS).min(most).max(1);
    Ok(match args.by {
        SplitBy::Frames => Split::Frames(count),
        SplitBy::Variants => Split::Variants(count),
    })
}

/// The arguments of `run` for every job.
fn arguments(args: &SubmitArgs, runs: &Path) -> Vec<String> {
    let experiment = &args.experiment;
    let mut arguments = vec![experiment.experiment.display().to_string()];
    let pairs = |option: &str, pairs: &[(String, String)]| -> Vec<String> {
        pairs.iter().flat_map(|(path, value)| [option.to_owned(), format!("{path}={value}")]).collect()
    };
    arguments.extend(pairs("--set", &experiment.set));
    arguments.extend(pairs("--matrix", &experiment.matrix));
    arguments.extend(experiment.variants.iter().flat_map(|variant| ["--variant".to_owned(), variant.clone()]));
    arguments.extend(["--runs".to_owned(), runs.display().to_string()]);
    let workers = args.workers.or((args.to == crate::args::SchedulerOption::Local).then_some(1));
    arguments.extend(workers.into_iter().flat_map(|workers| ["--workers".to_owned(), workers.to_string()]));
    arguments.extend(args.keep_going.then(|| "--keep-going".to_owned()));
    arguments.extend(args.no_page.then(|| "--no-page".to_owned()));
    let page_frames = args.page_frames.into_iter();
    arguments.extend(page_frames.flat_map(|frames| ["--page-frames".to_owned(), frames.to_string()]));
    arguments
}

/// Refuses a second submission while jobs of the first one run or wait.
fn keep_from_running_twice(folder: &ShardFolder, new: &Submission) -> Result<(), CliError> {
    let exists = new.out.symlink_metadata().is_ok();
    let refused = || {
        let what = format!("{} exists already", new.out.display());
        Err(CliError::usage(what, "choose another --out, or leave it out"))
    };
    if !folder.path().join(depthloom_jobs::JOBS).is_file() {
        return if exists { refused() } else { Ok(()) };
    }
    let before = Submission::read(folder.path())?;
    let states = states(&before, folder.path())?;
    let active = states.values().filter(|state| state.is_active()).count();
    if active > 0 {
        let what = format!("this experiment was submitted before, and {} run or wait", counted(active as u64, "job"));
        let name = name_of(folder.path());
        let remedy = format!("`depthloom jobs {name}` shows them, `depthloom jobs cancel {name}` ends them");
        return Err(CliError::usage(what, remedy));
    }
    if exists { refused() } else { Ok(()) }
}

/// The command of a script, without the job.
fn command(folder: &ShardFolder, args: &SubmitArgs, requests: Vec<JobRequest>) -> Result<JobCommand, CliError> {
    let program = match &args.program {
        Some(program) => program.clone(),
        None => {
            let program = std::env::current_exe()
                .map_err(|error| CliError::because(ExitCode::Engine, "failed to find this program's file", &error))?;
            slurm::shell_quoted(&program.display().to_string())
        }
    };
    let folder = slurm::shell_quoted(&folder.path().display().to_string());
    let exec = if args.exec.allow_exec { " --allow-exec" } else { "" };
    let command = format!("{program} jobs start {folder}{exec}");
    Ok(JobCommand { setup: args.setup.clone(), command, cores: args.workers, requests })
}

fn write(submission: &Submission, folder: &ShardFolder, command: &JobCommand) -> Result<(), CliError> {
    let failed = |path: &Path, error: &std::io::Error| {
        CliError::of_writing(ExitCode::Usage, format_args!("failed to write {}", path.display()), error)
    };
    let logs = folder.path().join(LOGS);
    std::fs::create_dir_all(&logs).map_err(|error| failed(&logs, &error))?;
    for step in 0..submission.steps.len() {
        let path = slurm::script_path(folder.path(), step);
        let script = slurm::script(submission, folder.path(), step, command);
        depthloom_durable::write(&path, script.as_bytes()).map_err(|error| failed(&path, &error))?;
    }
    submission.write(folder.path())
}

/// Submits all steps, each after the step before.
fn submit_to_slurm(mut found: SubmissionFolder) -> Result<SubmissionFolder, CliError> {
    let size = slurm::array_size();
    let mut after: Vec<String> = Vec::new();
    for step in 0..found.submission.steps.len() {
        let jobs: Vec<usize> = (0..found.submission.steps[step].jobs()).collect();
        let arrays = slurm::submit(&found.submission, &found.folder, step, &jobs, &after, size)?;
        after = arrays.iter().map(|array| array.id.to_string()).collect();
        found.submission.slurm.extend(arrays);
        // After every step: a failure leaves the jobs that were submitted in the file.
        found.submission.write(&found.folder)?;
    }
    Ok(found)
}

fn describe(submission: &Submission) -> String {
    let steps: Vec<String> =
        submission.steps.iter().map(|step| format!("{} ({})", step.name, counted(step.jobs() as u64, "job"))).collect();
    format!("{}: {}", submission.experiment, steps.join(", then "))
}

fn dry_run(submission: &Submission, folder: &ShardFolder, command: &JobCommand) -> Result<ExitCode, CliError> {
    let mut text = format!("{}\n", describe(submission));
    for (step, content) in submission.steps.iter().enumerate() {
        let path: PathBuf = slurm::script_path(folder.path(), step);
        text.push_str(&format!(
            "\n--- {}\n{}",
            path.display(),
            slurm::script(submission, folder.path(), step, command)
        ));
        if submission.scheduler == Scheduler::Slurm {
            let jobs: Vec<usize> = (0..content.jobs()).collect();
            let after = if step > 0 { vec![format!("JOB-OF-STEP-{step}")] } else { Vec::new() };
            let (_, arguments) = slurm::sbatch_arguments(submission, folder.path(), step, &jobs, &after, usize::MAX);
            let words: Vec<String> = arguments.iter().map(|word| slurm::shell_quoted(word)).collect();
            text.push_str(&format!("--- sbatch {}\n", words.join(" ")));
        }
    }
    print(text)?;
    Ok(ExitCode::Success)
}

/// How other schedulers run the scripts.
fn instructions(submission: &Submission, folder: &Path) -> String {
    let mut text =
        String::from("Run these scripts one after the other, each when all jobs of the one before have succeeded:\n");
    for (step, content) in submission.steps.iter().enumerate() {
        let script = slurm::script_path(folder, step);
        let script = slurm::shell_quoted(&script.display().to_string());
        let last = content.jobs() - 1;
        let jobs = content.jobs();
        // PBS refuses an array of one job.
        let pbs = if last == 0 { format!("qsub -- /bin/sh {script} 0") } else { format!("qsub -J 0-{last} {script}") };
        text.push_str(&format!(
            "\nstep {}: {}, {}\n  here        for i in $(seq 0 {last}); do sh {script} $i; done\n  PBS         {pbs}\n  LSF         bsub -J 'step{}[1-{jobs}]' sh {script}\n  Grid Engine qsub -t 1-{jobs} {script}\n",
            step + 1,
            content.name,
            counted(jobs as u64, "job"),
            step + 1,
        ));
    }
    text.push_str(&format!("\n{}\n", show::hint(folder)));
    text
}
