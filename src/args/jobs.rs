//! Options of `submit` and `jobs`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use clap_complete::engine::ArgValueCompleter;
use depthloom_jobs::Scheduler;

use super::{ExecArgs, ExperimentArgs, RunsFolder, SplitBy};
use crate::completion::{folders, runs};

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/cluster.md",
    "submit first.yaml --to local --shards 2" => "as processes on this machine, one after the other or at once",
    "submit first.yaml --dry-run --shards 4 -- --partition=cpu --time=2:00:00" => "print the scripts for Slurm",
    "jobs first" => "how far the jobs are",
])]
pub(crate) struct SubmitArgs {
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// Run the jobs in `slurm` (default), as processes here (`local`), or write a `script` for another scheduler.
    #[arg(
        long,
        value_enum,
        value_name = "WHERE",
        default_value = "slurm",
        hide_default_value = true,
        hide_possible_values = true
    )]
    pub to: SchedulerOption,

    /// Split the work into N shards (default: 8; at most one per frame or variant).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub shards: Option<u32>,

    /// Split by `frames` (default) or by `variants`.
    ///
    /// By frames, ordered nodes run in the last job. By variants, each shard computes everything of its variants.
    #[arg(
        long,
        value_enum,
        value_name = "WHAT",
        default_value = "frames",
        hide_default_value = true,
        hide_possible_values = true
    )]
    pub by: SplitBy,

    /// Give each job N cores (default: those that the scheduler gives it; 1 with `--to local`).
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,

    /// Run at most N jobs at once, with `--to local` (default: number of cores / workers).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub parallel: Option<u16>,

    /// Request time and memory from the measurements of this run (default: request nothing).
    ///
    /// It is an earlier run of the experiment, for example of a few frames. Three times the predicted time and 1.5
    /// times the memory are requested. `--time` and `--mem` after `--` take precedence.
    #[arg(long, value_name = "RUN", add = ArgValueCompleter::new(runs))]
    pub from: Option<PathBuf>,

    /// Record shards in this folder of the job's machine first.
    ///
    /// A complete shard is copied to the folder of runs. So is an interrupted one, from which the next job resumes. The
    /// folder must be on a fast local disk, e.g. `/tmp`.
    #[arg(long, value_name = "DIR")]
    pub scratch: Option<PathBuf>,

    /// Write the last run to this folder (default: `<runs>/<experiment>/<UTC time>`).
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Continue after a frame failed.
    ///
    /// What depends on the frame is left out, as with `run`. The jobs of failed frames count as finished.
    #[arg(long)]
    pub keep_going: bool,

    /// Do not write `report.html`.
    #[arg(long)]
    pub no_page: bool,

    /// Show images of this many frames in `report.html`, as with `run`.
    #[arg(long, value_name = "COUNT", conflicts_with = "no_page", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub page_frames: Option<u32>,

    /// Call depthloom by this command in the scripts (default: the path of this program).
    ///
    /// For example `apptainer exec depthloom.sif depthloom`.
    #[arg(long, value_name = "COMMAND")]
    pub program: Option<String>,

    /// Write this line of shell into the scripts, before the command. Can be repeated.
    ///
    /// For example `module load onnxruntime`.
    #[arg(long, value_name = "LINE")]
    pub setup: Vec<String>,

    /// Print the scripts and commands; write and submit nothing.
    #[arg(long)]
    pub dry_run: bool,

    #[command(flatten)]
    pub exec: ExecArgs,

    #[command(flatten)]
    pub folder: RunsFolder,

    /// Pass these options to `sbatch`, for every job: `--partition=cpu`.
    #[arg(last = true, value_name = "SBATCH OPTIONS")]
    pub options: Vec<String>,
}

/// Where jobs run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SchedulerOption {
    /// Job arrays of Slurm.
    Slurm,
    /// Processes on this machine.
    Local,
    /// Scripts for another scheduler.
    Script,
}

impl From<SchedulerOption> for Scheduler {
    fn from(option: SchedulerOption) -> Self {
        match option {
            SchedulerOption::Slurm => Self::Slurm,
            SchedulerOption::Local => Self::Local,
            SchedulerOption::Script => Self::Script,
        }
    }
}

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, disable_help_subcommand = true)]
#[command(after_long_help = examples![
    guide: "how-to/cluster.md",
    "jobs" => "the newest submission",
    "jobs retry first" => "submit what failed or was stopped again",
    "jobs cancel first" => "end what runs or waits",
])]
pub(crate) struct JobsArgs {
    /// Run this command (default: show the states of the jobs).
    #[command(subcommand)]
    pub command: Option<JobsCommand>,

    #[command(flatten)]
    pub submission: SubmissionArg,

    #[command(flatten)]
    pub folder: RunsFolder,

    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

/// A submission.
#[derive(Debug, Args)]
pub(crate) struct SubmissionArg {
    /// Use the submission of this experiment, or in this folder (default: the newest).
    #[arg(value_name = "EXPERIMENT")]
    pub name: Option<PathBuf>,
}

/// The commands of `jobs`.
#[derive(Debug, Subcommand)]
pub(crate) enum JobsCommand {
    /// Submit failed, stopped and damaged jobs again.
    ///
    /// Interrupted jobs resume. Jobs that cannot start any more, because a job before them failed, are submitted again
    /// too.
    Retry(RetryArgs),
    /// End running and waiting jobs.
    ///
    /// A running job stores what it has; `jobs retry` resumes it.
    Cancel(CancelArgs),
    /// Run a job; the scripts call this.
    #[command(hide = true)]
    Start(StartArgs),
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/cluster.md",
    "jobs retry" => "of the newest submission",
])]
pub(crate) struct RetryArgs {
    #[command(flatten)]
    pub submission: SubmissionArg,

    /// Print what would be submitted; submit nothing.
    #[arg(long)]
    pub dry_run: bool,

    /// Run at most N jobs at once, of a submission with `--to local` (default: number of cores / workers).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub parallel: Option<u16>,

    /// Pass these options to `sbatch` instead of those of the submission: `--time=4:00:00`.
    #[arg(last = true, value_name = "SBATCH OPTIONS")]
    pub options: Vec<String>,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/cluster.md",
    "jobs cancel" => "of the newest submission",
])]
pub(crate) struct CancelArgs {
    #[command(flatten)]
    pub submission: SubmissionArg,
}

#[derive(Debug, Args)]
pub(crate) struct StartArgs {
    /// Run a job of the submission in this folder.
    pub folder: PathBuf,

    /// Run a job of this step, from 1.
    #[arg(long)]
    pub step: usize,

    /// Run this job of the step, from 0.
    #[arg(long)]
    pub job: usize,

    #[command(flatten)]
    pub exec: ExecArgs,
}
